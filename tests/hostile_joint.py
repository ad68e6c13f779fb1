"""Hostile options of what is estimated beside the pose, and hostile results that hold it."""

import json
from collections.abc import Callable
from pathlib import Path

from hostile_commands import Hostile
from hostile_files import absent
from hostile_outputs import drive_with, every_failure_has_a_reason, nothing, set_value
from refined import clock, refined_camera
from test_calibration import POSE, make_calibration

from semcal_cli.drive.document import read_drive
from semcal_cli.result.calibration import write_calibration

CALIBRATE = ("calibrate", "drive", "-q", "-o", "out.yaml")
NAMES = ("--refine-intrinsics", "fx,fy")
NO_RESULT = absent("out.yaml", "x")
OF_LENS = "fx, fy, cx, cy, k1, k2, p1, p2, k3$"


def refused(line: str, *options: str, make: Callable[[Path], object] = nothing) -> Hostile:
    """Gives options to `calibrate`, which end in a line and write nothing."""
    return Hostile(make, (*CALIBRATE, *options), line, check=NO_RESULT)


def all_round(folder: Path) -> None:
    """Makes the drive's camera equirectangular."""
    drive_with("camera", "model", value="equirectangular")(folder)
    drive_with("camera", "distortion", value=[])(folder)


def result_with(keys: str, value: object) -> Callable[[Path], object]:
    """Makes a calibration with a camera and a clock, and another value at keys joined by dots, in `c.json`."""

    def make(folder: Path) -> None:
        path, camera = folder / "c.json", read_drive(folder / "drive").camera
        record = make_calibration(POSE)
        estimated = {"camera": refined_camera(camera, camera.zoomed(1.01)), "clock": clock()}
        estimated["input"] = record.input.model_copy(update={"camera": camera})
        write_calibration(record.model_copy(update=estimated), path)
        document = json.loads(path.read_text())
        set_value(document, tuple(int(key) if key.isdigit() else key for key in keys.split(".")), value)
        path.write_text(json.dumps(document))

    return make


def diagonal(count: int, value: float = 1.0) -> list[list[float]]:
    """Makes a diagonal matrix, which is a covariance unless a value is below zero."""
    return [[value if row == column else 0.0 for column in range(count)] for row in range(count)]


OPTIONS: dict[str, Hostile] = {
    "k1 of a picture all round": refused(
        r"--refine-intrinsics: found 'k1', needed names of equirectangular: fx, fy, cx, cy$",
        *("--refine-intrinsics", "fx,k1"),
        make=all_round,
    ),
    "a speed alone for the clock": refused(
        r"motion: found no direction of motion, needed poses or a twist for --estimate-delay$",
        "--estimate-delay",
        make=drive_with("motion", value={"speed_m_s": 12.0}),
    ),
    "intrinsics of many drives": Hostile(
        nothing,
        ("batch", "drive", "other", "-o", "results", "--", "--refine-intrinsics", "k9"),
        r"^summary +results/summary.csv, results/summary.jsonl$",
        check=every_failure_has_a_reason,
    ),
    "no motion for the clock of a verification": Hostile(
        nothing,
        ("verify", "drive", "drive", "-q", "--max-delay-ms", "5"),
        r"drive\.yaml: motion: found no direction of motion, needed poses or a twist for --max-delay-ms$",
    ),
}

UNKNOWN_CLOCK = clock(is_determined=False).model_dump()
UNKNOWN = {"given": 0.0, "found": 0.0, "sigma": None, "half_width_95": None, "is_determined": False}
NO_COVARIANCES = (
    (lambda count: diagonal(count, -1.0), "a variance of -1, needed at least 0"),
    (
        lambda count: [[1.0] * count, *diagonal(count)[1:]],
        "entries that differ by 1 across the diagonal, needed a symmetric matrix",
    ),
    (
        lambda count: [[2.0 - float(i == j) for j in range(count)] for i in range(count)],
        "an eigenvalue of -1, needed a positive semidefinite matrix",
    ),
)
WRONG: list[tuple[str, object, str]] = [
    ("camera", 5, r"camera: found 5, needed a mapping$"),
    ("camera.found.model", "pinhole", r"camera\.found\.model: found 'pinhole', needed "),
    (
        "camera.found.K.0.0",
        -1.0,
        r"camera\.found\.K: found focal lengths -1\.0 and \S+, needed both above 0$",
    ),
    (
        "camera.intrinsics.fx.half_width_95",
        -1.0,
        r"camera\.intrinsics\.fx\.half_width_95: found -1(\.0)?, needed at least 0",
    ),
    ("camera.intrinsics.fx.found", 1e308, r"camera\.intrinsics\.fx\.found: found 1e\+308, needed at most "),
    ("camera.is_kept", "yes", r"camera\.is_kept: found 'yes', needed "),
    (
        "camera.intrinsics",
        {"k9": UNKNOWN},
        rf"camera: found intrinsics k9, needed names of plumb_bob: {OF_LENS}",
    ),
    ("camera.intrinsics", {}, r"camera\.intrinsics: found a mapping of 0, needed at least 1$"),
    (
        "camera.joint_covariance",
        [[0.0] * 6] * 6,
        r"camera\.joint_covariance\[0\]: found a list of 6, needed at least 7",
    ),
    (
        "camera.joint_covariance",
        [[0.0] * 8] * 9,
        r"camera\.joint_covariance: found 9 rows with 8 to 8 entries, needed as many as rows$",
    ),
    (
        "camera.joint_covariance",
        diagonal(9),
        r"camera\.joint_covariance: found 9 rows, needed 10: six of the pose, one for each intrinsic, ",
    ),
    ("camera.sure", True, r"camera: unknown key 'sure'; the nearest known key is 'is_kept'$"),
    (
        "camera.found.width",
        1,
        r"camera\.found: found plumb_bob of 1 x \d+ pixels, needed plumb_bob of \d+ x \d+ pixels, as in input\.camera$",
    ),
    (
        "clock.joint_covariance",
        [[0.0] * 7] * 8,
        r"clock\.joint_covariance: found a list of 8, needed at most 7",
    ),
    ("clock.time_offset_s", 86400.0, r"clock\.time_offset_s: found 86400(\.0)?, needed at most "),
    ("clock.time_offset_s", "late", r"clock\.time_offset_s: found 'late', needed a number$"),
    ("clock.meaning", None, r"clock\.meaning: found nothing, needed text$"),
    (
        "clock.meaning",
        "late\nor \x1b[31mearly",
        r"clock\.meaning: found 'late\\nor \\x1b\[31mearly', needed one line of text$",
    ),
    (
        "clock.sigma_s",
        None,
        r"clock: found one that is determined with sigma_s None and half_width_95_s 0\.0012, needed both if ",
    ),
    (
        "clock.is_determined",
        False,
        r"clock: found one that is not determined with sigma_s 0\.0006 and half_width_95_s 0\.0012, needed both if ",
    ),
    (
        "clock",
        UNKNOWN_CLOCK | {"is_kept": True},
        r"clock: found a clock that is kept and not determined, needed one that is determined$",
    ),
    (
        "clock",
        UNKNOWN_CLOCK | {"joint_covariance": diagonal(7)},
        r"clock: found a joint_covariance of a clock that is not determined, needed null$",
    ),
    *(
        (f"{key}.joint_covariance", make(count), rf"{key}\.joint_covariance: found {line}$")
        for key, count in (("camera", 10), ("clock", 7))
        for make, line in NO_COVARIANCES
    ),
]
"""Keys of a result joined by dots, a wrong value, and the message, which names file, key and value."""
REPORT = ("report", "drive", "c.json", "-o", "x.html", "-q")
READ: dict[str, Hostile] = {
    f"{number}. {keys} of a result": Hostile(
        result_with(keys, value), REPORT, rf"^semcal: error: c\.json: {line}"
    )
    for number, (keys, value, line) in enumerate(WRONG)
}

JOINT: dict[str, Hostile] = OPTIONS | READ
