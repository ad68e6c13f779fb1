"""`calibrate --refine-intrinsics` and `--estimate-delay` through the real command, beside its other options."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import Cli
from test_hostile_commands import SMALL

from semcal_cli import pipeline
from semcal_cli.config import CalibrationConfig, JointlyConfig, RefinementConfig
from semcal_cli.errors import InputError
from semcal_cli.result.calibration import Calibration, read_calibration
from semcal_cli.synthetic.synthesis import synthesize

OPEN = "not determined: drive at different speeds, and turn"
NAMES = ("--refine-intrinsics", "fx,fy,k1")


def calibrated(drive: Path, result: Path, cli: Cli, *options: str) -> tuple[Calibration, str]:
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
        ("--split",),
        ("--repeat", "2"),
        ("--cue", "segments"),
        ("--estimator", "mine"),
        ("--intrinsics-sigma", "1e3", "1e3"),
        ("--intrinsics-sigma", "1e-9", "1e-9"),
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


@pytest.mark.parametrize(
    ("jointly", "message"),
    [
        (JointlyConfig(("k9",)), r"--refine-intrinsics: found 'k9', needed names of plumb_bob: fx, fy, "),
        (
            JointlyConfig(with_delay=True),
            r"motion: found no direction of motion, needed poses or a twist for ",
        ),
    ],
)
def test_what_cannot_be_estimated_is_told_before_the_search(
    street: Path, monkeypatch: pytest.MonkeyPatch, jointly: JointlyConfig, message: str
) -> None:
    monkeypatch.setattr(pipeline.calibration, "initialize", lambda *_: pytest.fail("searched"))
    config = CalibrationConfig(refinement=RefinementConfig(jointly=jointly))
    with pytest.raises(InputError, match=message):
        pipeline.calibrate(street, config)


def test_several_that_are_not_determined_are_listed(tmp_path: Path, cli: Cli) -> None:
    synthesize(replace(SMALL, lens="narrow"), tmp_path / "drive")
    names = ("--refine-intrinsics", "fx,fy,cx,cy,k1,k2")
    _, said = calibrated(tmp_path / "drive", tmp_path / "c.yaml", cli, *names)
    assert re.search(
        r"note ((\w\w, )+\w\w and )?\w\w (is|are) not determined by these frames and stays? ", said
    ), said
