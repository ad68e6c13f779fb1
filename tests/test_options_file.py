"""Options from a file: the same result as when they are typed, and errors that name the file and the key."""

import json
from pathlib import Path

import pytest
from commands import invoke

HEAD = "semcal_options: 1\n"
NO_SUCH = "`semcal calibrate` takes no such option from a file"


def test_options_of_a_file_are_those_that_are_typed(street: Path, tmp_path: Path) -> None:
    """Files in it are relative to its folder, what is typed comes first, and a drive needs no topic of a recording."""
    (tmp_path / "team").mkdir()
    (tmp_path / "team/start.yaml").symlink_to(street / "drive.yaml")
    file = tmp_path / "team/options.yaml"
    options = "init: start.yaml, cue: labels, frames: '0:2', seed: 5, no-polish: true, points: /top"
    file.write_text(f"{HEAD}calibrate: {{{options}}}\nverify: {{max-rotation-deg: 0.1}}\n")
    words = ("--init", street, "--cue", "labels", "--frames", "0:2", "--no-polish")
    typed = invoke("calibrate", street, *words, "--seed", "3", "--json")
    read = invoke("calibrate", street, "--config", file, "--seed", "3", "--json")
    assert typed.exit_code == read.exit_code == 0, read.output
    results = [json.loads(done.stdout) for done in (typed, read)]
    for result in results:
        del result["input"]  # names files as they were given
    assert results[0] == results[1]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("calibrate: {}", "add `semcal_options: 1`"),
        ("semcal_options: true", "found version True, expected `semcal_options: 1`"),
        (f"{HEAD}batch: {{}}", "found 'batch', expected a command that has --config"),
        (f"{HEAD}calib: {{}}", "found 'calib', expected a command that has --config"),
        (f"{HEAD}calibrate: {{cues: edges}}", f"calibrate.cues: {NO_SUCH}"),
        (f"{HEAD}calibrate: {{config: a}}", f"calibrate.config: {NO_SUCH}"),
        (f"{HEAD}calibrate: {{help-all: true}}", f"calibrate.help-all: {NO_SUCH}"),
        (f"{HEAD}calibrate: {{max-frames: -5}}", "calibrate.max-frames: -5 is not in the range x>=1."),
        (f"{HEAD}calibrate: {{force: 1}}", "calibrate.force: found 1, expected true or false"),
        (f"{HEAD}calibrate: {{exclude: a}}", "calibrate.exclude: found 'a', expected a list"),
        (
            f"{HEAD}calibrate: {{exclude: [1.0]}}",
            "calibrate.exclude: found the number 1; write names in quotes",
        ),
        (f"{HEAD}calibrate: {{init: ''}}", "calibrate.init: found nothing, expected a value"),
        (f"{HEAD}calibrate: {{seed: [1]}}", "calibrate.seed: found [1], expected one value"),
        (f"{HEAD}calibrate: {{seed: }}", "calibrate.seed: found None, expected a number or a text"),
        (f"{HEAD}calibrate: edges", "calibrate: found 'edges', expected a mapping of options"),
    ],
)
def test_a_wrong_file_is_one_line(content: str, message: str, street: Path, tmp_path: Path) -> None:
    file = tmp_path / "options.yaml"
    file.write_text(content)
    done = invoke("calibrate", street, "--config", file)
    assert done.exit_code == 1
    assert str(done.exception) == f"{file}: {message}"


def test_a_contradiction_names_the_file(street: Path, tmp_path: Path) -> None:
    file = tmp_path / "options.yaml"
    file.write_text(
        f"{HEAD}calibrate: {{init: a.yaml, report: a.html}}\nverify: {{json: true, junit: '-'}}\n"
    )
    done = invoke("calibrate", street, "--config", file, "--from-nothing")
    assert done.exit_code == 2
    said = " ".join(done.output.split())
    assert f"--from-nothing cannot be used with --init. {file} states some options." in said
    many = invoke("batch", street, "-o", tmp_path / "out", "--", "--config", file)
    said = " ".join(many.output.split())
    assert f"--report cannot be used with many drives. {file} states some options." in said
    both = invoke("verify", street, street, "--config", file)
    assert (both.exit_code, "--json and --junit would both write to standard output" in both.output) == (
        2,
        True,
    )
