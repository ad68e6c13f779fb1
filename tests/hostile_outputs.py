"""Hostile outputs, numbers and options of single commands."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from hostile_commands import Hostile
from hostile_files import absent, pipe
from test_calibration import POSE, make_calibration

from semcal_cli.result.calibration_document import write_calibration

NOTHING = r"^$"
SAID = b"said before\n"
VERIFY = ("verify", "drive", "drive", "--quiet", "--max-translation-m", "1e-4", "--junit")
"""Verifies the small drive with a limit far below what it can tell, whatever its intervals are."""
INCONCLUSIVE = 4
"""Exit code of this verification."""
BATCH = ("batch", "drive", "other", "-o", "results", "--")
NO_RESULTS = absent("results", "x")


def nothing(folder: Path) -> None:
    """Makes nothing beside the drives."""


def stdout_goes_on(*parts: str) -> Callable[[Path], object]:
    """Asserts that standard output holds what was said before, then these parts, one after the other."""

    def check(folder: Path) -> None:
        rest = (folder / ".stdout").read_text()
        for part in (SAID.decode(), *parts):
            before, found, rest = rest.partition(part)
            assert found, part
            assert part != SAID.decode() or not before
        assert not (folder / "-").exists()

    return check


def drive_with(*keys: str | int, value: object) -> Callable[[Path], object]:
    """Makes the drive with another value at a key."""

    def make(folder: Path) -> None:
        path = folder / "drive" / "drive.yaml"
        document = yaml.safe_load(path.read_text())
        set_value(document, keys, value)
        path.write_text(yaml.safe_dump(document))

    return make


def calibration_with(*keys: str | int, value: object) -> Callable[[Path], object]:
    """Makes a calibration with another value at a key, in `c.json`."""

    def make(folder: Path) -> None:
        path = folder / "c.json"
        write_calibration(make_calibration(POSE), path)
        document = json.loads(path.read_text())
        set_value(document, keys, value)
        path.write_text(json.dumps(document))

    return make


def set_value(document: Any, keys: tuple[str | int, ...], value: object) -> None:
    for key in keys[:-1]:
        document = document[key]
    document[keys[-1]] = value


def rig(folder: Path) -> None:
    """Makes a rig of the drives."""
    (folder / "rig").mkdir()
    (folder / "rig" / "rig.yaml").write_text("semcal_rig: 1\ncameras: {a: ../drive, b: ../other}\n")


def every_failure_has_a_reason(folder: Path) -> None:
    """Asserts that the summary says why each drive failed."""
    lines = (folder / "results" / "summary.jsonl").read_text().splitlines()
    assert all(json.loads(line)["reasons"][0] for line in lines)


def is_still_a_pipe(folder: Path) -> None:
    """Asserts that the pipe was not replaced."""
    assert (folder / "pipe").is_fifo()


def junit(name: str, line: str = NOTHING, exit_code: int = INCONCLUSIVE) -> Hostile:
    """Verifies with a JUnit file of this name, which is standard output."""
    check = stdout_goes_on("<?xml", "</testsuite>", "inconclusive")
    return Hostile(nothing, (*VERIFY, name), line, exit_code, said_before=SAID, check=check)


STREAMS: dict[str, Hostile] = {
    **{f"junit {name}": junit(name) for name in ("-", "/dev/fd/1")},
    "several outputs into one stream": Hostile(
        nothing,
        ("calibrate", "drive", "-q", "-o", "-", "--log", "-", "--report", "/dev/stdout"),
        "^verdict trusted: ",
        0,
        said_before=SAID,
        check=stdout_goes_on('"stages"', "semcal_calibration: 1", "<!doctype html>", "</html>"),
    ),
    "a page on standard output": Hostile(
        nothing,
        ("report", "drive", "drive", "-o", "-"),
        r"^/dev/stdout$",
        0,
        said_before=SAID,
        check=stdout_goes_on("<!doctype html>", "</html>"),
    ),
    "a plot without a suffix": Hostile(
        calibration_with("status", value="trusted"),
        ("fleet", "c.json", "--plot", "-"),
        r"^semcal: error: /dev/stdout: found suffix '', expected \.png or \.svg$",
    ),
    "the file of standard output by its name": Hostile(
        nothing,
        (*VERIFY, ".stdout"),
        r"^semcal: error: \.stdout: found the file that the shell writes to; choose another name$",
    ),
    "a descriptor that is not open": Hostile(
        nothing,
        (*VERIFY, "/dev/fd/77"),
        r"/dev/fd/77: found a descriptor that is not open, expected one to write",
    ),
    "a descriptor to read from": Hostile(
        nothing,
        (*VERIFY, "/dev/stdin"),
        r"/dev/stdin: found a descriptor that is open only for reading, expected one to",
    ),
    "a pipe that nothing reads": Hostile(
        pipe("pipe"),
        (*VERIFY, "pipe"),
        r"^semcal: error: pipe: found a pipe that nothing reads, expected a reader$",
        check=is_still_a_pipe,
    ),
    "a full device": Hostile(
        nothing, (*VERIFY, "/dev/full"), r"/dev/full: cannot be written: no space left on device$"
    ),
}

NUMBERS: dict[str, Hostile] = {
    "huge distortion": Hostile(
        drive_with("camera", "distortion", value=[1e308] * 5),
        ("inspect", "drive"),
        r"camera\.distortion\[0\]: found 1e\+308, needed at most 1000000000000\.0$",
    ),
    "a huge focal length": Hostile(
        drive_with("camera", "K", 0, 0, value=1e308),
        ("inspect", "drive"),
        r"K\[0\]\[0\]: found 1e\+308, needed",
    ),
    "a tiny focal length": Hostile(
        drive_with("camera", "K", 1, 1, value=5e-324),
        ("inspect", "drive"),
        r"K: found fy 5e-324, needed at least",
    ),
    **{
        f"a huge covariance for {command[0]}": Hostile(
            calibration_with("uncertainty", "covariance", 0, 0, value=1e308),
            command,
            r"c\.json: uncertainty\.covariance\[0\]\[0\]: found 1e\+308, needed at most 1e\+40$",
        )
        for command in (
            ("report", "drive", "c.json", "-o", "x.html"),
            ("fleet", "c.json"),
            ("batch", "drive", "-o", "results", "--", "--init", "c.json"),
        )
    },
    "a tiny standard error": Hostile(
        calibration_with("uncertainty", "sigma_camera_center_m", value=[5e-324] * 3),
        ("report", "drive", "c.json", "-o", "x.html", "-q"),
        NOTHING,
        0,
    ),
    "a lens that folds on its axis": Hostile(
        lambda folder: (
            drive_with("camera", "distortion", value=[0.0, 0.0, 1e6, 0.0])(folder),
            calibration_with("status", value="trusted")(folder),
        ),
        ("report", "drive", "c.json", "-o", "x.html", "-q"),
        NOTHING,
        0,
    ),
}

OPTIONS: dict[str, Hostile] = {
    "a start that is not there": Hostile(
        nothing, (*BATCH, "--init", "none.yaml"), r"^semcal: error: none.yaml: no such", check=NO_RESULTS
    ),
    "the help of the command": Hostile(nothing, (*BATCH, "--help"), NOTHING, 0, check=NO_RESULTS),
    "options that one drive does not take": Hostile(
        rig,
        ("batch", "rig/rig.yaml", "-o", "results", "--", "--init", "drive"),
        r"^summary +results/summary.csv, results/summary.jsonl$",
        check=every_failure_has_a_reason,
    ),
}

OUTPUTS: dict[str, Hostile] = STREAMS | NUMBERS | OPTIONS
