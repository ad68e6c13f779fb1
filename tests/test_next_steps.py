"""What follows a command: lines that a shell takes as they stand, and the cue of a calibration for who reads it."""

import shlex
from pathlib import Path

import pytest
import yaml
from commands import invoke
from test_calibration import POSE, make_calibration

from semcal_cli.cli.tables import labelled
from semcal_cli.config import AUTO
from semcal_cli.documentation import ADDRESS
from semcal_cli.drive.document import read_drive
from semcal_cli.result.applied import cues_applied
from semcal_cli.result.next_steps import after_calibration

DRIVE, RESULT = Path("my drive"), Path("my drive/c.yaml")


@pytest.mark.parametrize(
    ("status", "stages", "lines"),
    [
        (
            "trusted",
            ("initial", "refined"),
            [
                "next             semcal overlay 'my drive' 'my drive/c.yaml' -o 'my drive/c_overlay'",
                "for a robot      semcal convert 'my drive/c.yaml' --to ros2-static-transform",
                "later            semcal verify NEW_DRIVE 'my drive/c.yaml'",
            ],
        ),
        (
            "not_trusted",
            ("initial", "refined"),
            [
                "next             semcal inspect 'my drive'",
                "                 semcal view 'my drive' 'my drive/c.yaml'",
                f"why              {ADDRESS}/troubleshooting/",
            ],
        ),
        (
            "not_assessed",
            ("initial",),
            [
                "next             semcal refine 'my drive' --init 'my drive/c.yaml' -o 'my drive/c_refined.yaml'"
            ],
        ),
    ],
)
def test_each_verdict_names_what_follows(status: str, stages: tuple[str, ...], lines: list[str]) -> None:
    made = make_calibration(POSE)
    stage = made.stages["initial"]
    made = made.model_copy(
        update={
            "status": status,
            "stages": dict.fromkeys(stages, stage),
            "input": made.input.model_copy(update={"drive": "drive.yaml"}),
        }
    )
    assert [labelled(*step) for step in after_calibration(made, RESULT)] == lines


def test_each_kind_of_reason_leads_to_its_entry() -> None:
    doubted = make_calibration(POSE).model_copy(
        update={
            "status": "not_trusted",
            "reasons": ("one", "two", "three"),
            "topics": ("overlap", "clocks", "overlap"),
        }
    )
    assert after_calibration(doubted, RESULT)[2:] == [
        ("why", f"{ADDRESS}/troubleshooting/#overlap"),
        ("", f"{ADDRESS}/troubleshooting/#clocks"),
    ]


def test_what_is_printed_next_runs(drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The commands are pasted by a script: a drive whose name has a space, and a result beside it."""
    monkeypatch.chdir(tmp_path)
    named = drive.rename(tmp_path / "a drive")
    done = invoke("initialize", named.name, "-o", "start.yaml")
    (line,) = [each for each in done.stderr.splitlines() if each.startswith("next")]
    program, *words = shlex.split(line.removeprefix("next"))
    assert program == "semcal"
    done = invoke(*words)
    assert done.exit_code == 0, done.output
    steps = {each[:17].strip(): shlex.split(each[17:])[1:] for each in done.stderr.splitlines()[-3:]}
    for label in ("next", "for a robot"):
        assert invoke(*steps[label]).exit_code == 0
    assert len([*Path("start_refined_overlay").glob("*.png")]) == len(read_drive(named).frames)


@pytest.mark.parametrize(
    ("cues", "missing", "expected"),
    [
        (("segments",), (), ("segments",)),
        (("segments", "edges"), ("image_labels",), ("edges",)),
        (("segments",), ("image_labels",), AUTO),
        (("labels",), (), AUTO),
        (("features",), (), AUTO),
    ],
)
def test_the_cue_of_a_calibration_is_taken_as_far_as_the_files_allow(
    drive: Path, cues: tuple[str, ...], missing: tuple[str, ...], expected: tuple[str, ...]
) -> None:
    made = make_calibration(POSE)
    options = {"cues": {cue: {} for cue in cues}}
    made = made.model_copy(update={"settings": made.settings.model_copy(update={"options": options})})
    spec = read_drive(drive)
    spec = spec.model_copy(
        update={"frames": tuple(f.model_copy(update=dict.fromkeys(missing)) for f in spec.frames)}
    )
    assert cues_applied(made, AUTO, spec) == expected
    assert cues_applied(made, ("intensity",), spec) == ("intensity",)
    assert cues_applied(None, AUTO, spec) == AUTO


def test_verify_compares_what_the_calibration_did(drive: Path, made: Path, tmp_path: Path) -> None:
    """On a drive with labels of both sides, which `auto` would take."""
    document = yaml.safe_load((made / "c.yaml").read_text())
    document["settings"]["options"]["cues"] = {"edges": {}}
    (tmp_path / "edges.yaml").write_text(yaml.safe_dump(document))
    verified = invoke("verify", drive, tmp_path / "edges.yaml")
    assert verified.exit_code in (0, 3, 4), verified.output
    assert "by edges" in verified.stderr
    assert "by edges" not in invoke("verify", drive, tmp_path / "edges.yaml", "--cue", "labels").stderr


def test_the_page_names_what_follows(made: Path) -> None:
    page = (made / "r.html").read_text()
    assert f"<code>semcal convert {made}/c.yaml --to ros2-static-transform</code>" in page
