"""`calibrate --refine-intrinsics` and `--estimate-delay` through the real command, beside its other options."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import Cli
from hostile_outputs import set_value
from refined import clock, refined_camera
from test_calibration import POSE, make_calibration
from test_hostile_commands import SMALL

from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError
from semcal_cli.result.calibration_document import CalibrationDocument, read_calibration, write_calibration
from semcal_cli.synthetic.synthesis import synthesize

OPEN = "not determined: drive at different speeds, with turns"
NAMES = ("--refine-intrinsics", "fx,fy,k1")


def calibrated(drive: Path, result: Path, cli: Cli, *options: str) -> tuple[CalibrationDocument, str]:
    """Calibrate from the reference: the result, and standard error in one line."""
    code, _, err = cli("calibrate", drive, "--init", drive, "-o", result, *options)
    assert code in (0, 3), err
    return read_calibration(result), " ".join(err.split())


@pytest.mark.parametrize(("motion", "num_frames"), [("steady", 3), ("mixed", 1)])
def test_a_clock_that_is_not_determined(tmp_path: Path, cli: Cli, motion: str, num_frames: int) -> None:
    """At one twist in all frames, or with one frame, a delay looks like another place of the camera."""
    synthesize(replace(SMALL, motion=motion, num_frames=num_frames), tmp_path / "drive")  # type: ignore[arg-type]
    found, said = calibrated(tmp_path / "drive", tmp_path / "c.yaml", cli, "--estimate-delay")
    assert found.clock is not None
    assert (found.clock.is_determined, found.clock.is_kept) == (False, False)
    assert (found.clock.time_offset_s, found.clock.half_width_95_s, found.clock.meaning) == (0.0, None, OPEN)
    assert found.clock.joint_covariance is None
    assert f"clock {OPEN}" in said
    assert "joint" not in found.stages


@pytest.mark.parametrize(
    "options",
    [
        ("--repeat", "2", "--intrinsics-sigma", "1e3", "1e3"),
        ("--cue", "segments", "--max-frames", "2"),
        ("--estimator", "mine", "--intrinsics-sigma", "1e-9", "1e-9"),
    ],
)
def test_options_that_go_together(street: Path, tmp_path: Path, cli: Cli, options: tuple[str, ...]) -> None:
    """Every name that was asked for is answered, whether it is determined or not."""
    found, _ = calibrated(street, tmp_path / "c.yaml", cli, *NAMES, *options)
    assert found.camera is not None
    assert list(found.camera.intrinsics) == ["fx", "fy", "k1"]
    for each in found.camera.intrinsics.values():
        assert (each.sigma is None) == (not each.is_determined)
        assert each.is_determined or each.found == each.given
    assert (found.repeatability is not None) == ("--repeat" in options)
    assert found.camera.is_kept == ("joint" in found.stages)


def test_cameras_of_a_rig_have_intrinsics_of_their_own(rig: Path, tmp_path: Path, cli: Cli) -> None:
    code, _, err = cli("calibrate", rig, "-o", tmp_path / "out", *NAMES, "-q")
    assert code in (0, 3), err
    results = sorted((tmp_path / "out").rglob("camera_?.yaml"))
    assert len(results) == 2, [*(tmp_path / "out").rglob("*")]
    for path in results:
        camera = read_calibration(path).camera
        assert camera is not None
        assert list(camera.intrinsics) == ["fx", "fy", "k1"]


def test_several_that_are_not_determined_are_listed(tmp_path: Path, cli: Cli) -> None:
    synthesize(replace(SMALL, lens="narrow"), tmp_path / "drive")
    names = ("--refine-intrinsics", "fx,fy,cx,cy,k1,k2")
    _, said = calibrated(tmp_path / "drive", tmp_path / "c.yaml", cli, *names)
    assert re.search(
        r"note ((\w\w, )+\w\w and )?\w\w (is|are) not determined by these frames and stays? ", said
    ), said


def diagonal(count: int, value: float = 1.0) -> list[list[float]]:
    """Makes a diagonal matrix, which is a covariance unless a value is below zero."""
    return [[value if row == column else 0.0 for column in range(count)] for row in range(count)]


OF_LENS = "fx, fy, cx, cy, k1, k2, p1, p2, k3$"
UNKNOWN_CLOCK = clock(is_determined=False).model_dump()
UNKNOWN = {"given": 0.0, "found": 0.0, "sigma": None, "half_width_95": None, "is_determined": False}
NO_COVARIANCES = (
    (lambda count: diagonal(count, -1.0), "a variance of -1, needed at least 0"),
    (
        lambda count: [[1.0] * count, *diagonal(count)[1:]],
        "entries that differ by 1 across the diagonal, expected a symmetric matrix",
    ),
    (
        lambda count: [[2.0 - float(i == j) for j in range(count)] for i in range(count)],
        "an eigenvalue of -1, expected a positive semidefinite matrix",
    ),
)
WRONG: list[tuple[str, object, str]] = [
    ("camera", 5, r"camera: found 5, expected a mapping$"),
    ("camera.found.model", "pinhole", r"camera\.found\.model: found 'pinhole', expected "),
    (
        "camera.found.K.0.0",
        -1.0,
        r"camera\.found\.K: found focal lengths -1\.0 and \S+, expected both above 0$",
    ),
    (
        "camera.intrinsics.fx.half_width_95",
        -1.0,
        r"camera\.intrinsics\.fx\.half_width_95: found -1(\.0)?, needed at least 0",
    ),
    ("camera.intrinsics.fx.found", 1e308, r"camera\.intrinsics\.fx\.found: found 1e\+308, needed at most "),
    ("camera.is_kept", "yes", r"camera\.is_kept: found 'yes', expected "),
    (
        "camera.intrinsics",
        {"k9": UNKNOWN},
        rf"camera: found intrinsics k9, expected names of plumb_bob: {OF_LENS}",
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
        r"camera\.joint_covariance: found 9 rows with 8 to 8 entries, expected as many entries as rows$",
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
        r"camera\.found: found plumb_bob of 1 x \d+ pixels, expected plumb_bob of \d+ x \d+ pixels, "
        r"as in input\.camera$",
    ),
    (
        "clock.joint_covariance",
        [[0.0] * 7] * 8,
        r"clock\.joint_covariance: found a list of 8, needed at most 7",
    ),
    ("clock.time_offset_s", 86400.0, r"clock\.time_offset_s: found 86400(\.0)?, needed at most "),
    ("clock.time_offset_s", "late", r"clock\.time_offset_s: found 'late', expected a number$"),
    ("clock.meaning", None, r"clock\.meaning: found nothing, expected text$"),
    (
        "clock.meaning",
        "late\nor \x1b[31mearly",
        r"clock\.meaning: found 'late\\nor \\x1b\[31mearly', expected one line of text$",
    ),
    (
        "clock.sigma_s",
        None,
        r"clock: found one that is determined with sigma_s None and half_width_95_s 0\.0012, expected both if ",
    ),
    (
        "clock.is_determined",
        False,
        r"clock: found one that is not determined with sigma_s 0\.0006 and half_width_95_s 0\.0012, expected both if ",
    ),
    (
        "clock",
        UNKNOWN_CLOCK | {"is_kept": True},
        r"clock: found a clock that is kept and not determined, expected one that is determined$",
    ),
    (
        "clock",
        UNKNOWN_CLOCK | {"joint_covariance": diagonal(7)},
        r"clock: found a joint_covariance of a clock that is not determined, expected null$",
    ),
    (
        "uncertainty.covariance.0.1",
        1e-6,
        r"uncertainty\.covariance: found entries that differ by 1e-06 across the diagonal, expected a "
        "symmetric matrix$",
    ),
    (
        "uncertainty.covariance.2.2",
        -1e-6,
        r"uncertainty\.covariance: found a variance of -1e-06, needed at least 0$",
    ),
    (
        "uncertainty.covariance",
        [[1.0 if {i, j} == {0, 1} else 0.0 for i in range(6)] for j in range(6)],
        r"uncertainty\.covariance: found an eigenvalue of -1, expected a positive semidefinite matrix$",
    ),
    (
        "quality.mutual_information_nats",
        1e308,
        r"quality\.mutual_information_nats: found 1e\+308, needed at most 1e\+100$",
    ),
    *(
        (f"{key}.joint_covariance", make(count), rf"{key}\.joint_covariance: found {line}$")
        for key, count in (("camera", 10), ("clock", 7))
        for make, line in NO_COVARIANCES
    ),
]
"""Keys of a result joined by dots, a wrong value, and the message, which names file, key and value."""


@pytest.mark.parametrize(
    ("keys", "value", "line"), WRONG, ids=[f"{keys}-{number}" for number, (keys, *_) in enumerate(WRONG)]
)
def test_a_wrong_value_of_a_result_is_named(
    street: Path, tmp_path: Path, keys: str, value: object, line: str
) -> None:
    camera, record, path = read_drive(street).camera, make_calibration(POSE), tmp_path / "c.json"
    estimated = {"camera": refined_camera(camera, camera.zoomed(1.01)), "clock": clock()}
    estimated["input"] = record.input.model_copy(update={"camera": camera})
    write_calibration(record.model_copy(update=estimated), path)
    read_calibration(path)
    document = json.loads(path.read_text())
    set_value(document, tuple(int(key) if key.isdigit() else key for key in keys.split(".")), value)
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=rf"^{re.escape(str(path))}: {line}"):
        read_calibration(path)
