"""Outputs that are no regular files, as a shell hands them over."""

import os
import shlex
import subprocess
from pathlib import Path

import pytest
from hostile_commands import SEMCAL

from semcal_cli.cli.output_checks import check_outputs
from semcal_cli.errors import InputError
from semcal_cli.files.output_files import descriptor, write_text

CONVERT = '"${semcal[@]}" convert "$drive" --to opencalib -o'
JUNIT = '"${semcal[@]}" verify "$drive" "$drive" --quiet --junit'
TRANSFORM, VERDICT = "T: ", "</testsuite>"


def bash(script: str, drive: Path, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a script that may use `semcal` and `$drive`, in a folder that it may write to."""
    head = f"semcal=({shlex.join(SEMCAL)}); drive={shlex.quote(str(drive))}; set -o pipefail\n"
    return subprocess.run(
        ["bash", "-c", head + script],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        stdin=subprocess.DEVNULL,
    )


@pytest.mark.parametrize(
    ("script", "part"),
    [
        (f"echo before > f; {CONVERT} /dev/stdout >> f; echo after >> f", TRANSFORM),
        (f"(echo before; {CONVERT} /dev/stderr; echo after) > f 2>&1", TRANSFORM),
        (f"(echo before >&3; {CONVERT} /dev/fd/3; echo after >&3) 3> f", TRANSFORM),
        (f"echo before > f; {CONVERT} /dev/fd/3 3>> f; echo after >> f", TRANSFORM),
        (f"echo before > f; {JUNIT} /dev/stdout >> f; echo after >> f", VERDICT),
    ],
)
def test_what_the_shell_wrote_stays(street: Path, tmp_path: Path, script: str, part: str) -> None:
    found = bash(script, street, tmp_path)
    text = (tmp_path / "f").read_text()
    assert text.startswith("before\n"), found
    assert text.endswith("after\n")
    assert text.count(part) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["f"]


def test_pipes_with_a_reader(street: Path, tmp_path: Path) -> None:
    """A named pipe whose reader comes later, and the pipe of a process substitution."""
    script = f"mkfifo pipe; (sleep 1; cat pipe > f) & {CONVERT} pipe && wait && [ -p pipe ]"
    assert bash(script, street, tmp_path).returncode == 0
    assert (tmp_path / "f").read_text().startswith(TRANSFORM)
    assert bash(f"{CONVERT} >(cat > g); wait $!", street, tmp_path).returncode == 0
    assert (tmp_path / "g").read_text().startswith(TRANSFORM)


@pytest.mark.parametrize("command", [f"{CONVERT} -", '"${semcal[@]}" inspect "$drive"'])
def test_a_reader_that_goes_ends_the_command_quietly(street: Path, tmp_path: Path, command: str) -> None:
    found = bash(f"{command} | true", street, tmp_path)
    assert found.stderr == ""
    assert found.returncode == 1


@pytest.mark.parametrize(
    "command",
    [
        f"{JUNIT} -",
        '"${semcal[@]}" convert "$drive" --to text',
        '"${semcal[@]}" calibrate "$drive" -o -',
        '"${semcal[@]}" refine "$drive" --init "$drive" -o c.yaml --json',
    ],
)
def test_a_closed_standard_output_is_named(command: str, street: Path, tmp_path: Path) -> None:
    found = bash(f"{command} >&-", street, tmp_path)
    assert (
        found.stderr
        == "semcal: error: /dev/stdout: found a descriptor that is not open, expected one to write to\n"
    )
    assert found.returncode == 1
    assert not [*tmp_path.iterdir()]


def test_a_folder_that_is_only_read_is_named_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "old.yaml").touch()
    os.mkfifo(tmp_path / "pipe")
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != tmp_path)
    for name in ("old.yaml", "new.yaml"):
        path = tmp_path / name
        with pytest.raises(InputError) as refused:
            check_outputs([], path)
        assert str(refused.value) == f"{path}: no permission to write to its folder {tmp_path}"
    check_outputs([], tmp_path / "pipe")  # into which the content goes


def test_descriptors_are_told_by_their_names() -> None:
    names = {
        "/dev/stdout": 1,
        "/dev/stderr": 2,
        "/dev/fd/12": 12,
        "/proc/self/fd/7": 7,
        "/dev/null": None,
        "-": None,
    }
    assert {name: descriptor(Path(name)) for name in names} == names


def test_python_s_own_output_comes_first(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    print("first", end=" ")
    write_text("second", Path("/dev/stdout"))
    print(" third", end="")
    assert capfd.readouterr().out == "first second third"
