"""`semcal verify --max-delay-ms`: the camera's clock beside the transform, in every place that shows checks."""

import json
import shutil
from pathlib import Path

import junitparser
import numpy as np
import pytest
from conftest import edited, run
from refined import clock, of_another_drive

import semcal_cli as semcal_package
from semcal_cli import core
from semcal_cli.config import AdjustmentConfig, CalibrationConfig, Limits, RefinementConfig
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import DRIVE_FILE, read_drive
from semcal_cli.errors import InputError
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.formats import read_transform
from semcal_cli.observations.loading import load
from semcal_cli.pipeline.verdict import CLOCK, figures, judge_clock, overall_offsets, sufficient_limits
from semcal_cli.report import read_report_input
from semcal_cli.report.page import both_overlays
from semcal_cli.result.calibration_document import CalibrationDocument, write_calibration
from semcal_cli.result.uncertainty import CHECK_NAMES
from semcal_cli.synthetic.synthesis import synthesize

PASS, FAIL, INCONCLUSIVE = 0, 3, 4
CLOSE_MS = 2.0
"""Error of the clock that six small images tell."""
MAX_CURVED_M = 0.02
"""How far points of the farthest range are off that are moved at a constant twist, as a path that curves is not."""
NOT_DETERMINED = "the time offset is not determined: drive at different speeds, with turns"
DRIVES = {
    "right": ("mixed", 0.0, 6),
    "late": ("mixed", 20.0, 6),
    "steady": ("steady", 0.0, 4),
    "one": ("mixed", 0.0, 1),
}


@pytest.fixture(scope="module")
def moving(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Drives by name."""
    root = tmp_path_factory.mktemp("moving")
    for name, (motion, delay_ms, num_frames) in DRIVES.items():
        config = SynthConfig(
            num_frames=num_frames, seed=11, width=640, height=360, motion=motion, delay_ms=delay_ms
        )  # type: ignore[arg-type]
        synthesize(config, root / name)
    return root


def exactly_triggered(drive: Path, folder: Path) -> Path:
    """The drive of a camera that the LiDAR triggers."""
    copy = shutil.copytree(drive, folder / "triggered")
    with (copy / "drive.yaml").open("a") as file:
        file.write("time_offset_sigma_s: 0\n")
    return copy


def test_other_estimates_leave_the_clock_as_open(moving: Path) -> None:
    """Intrinsics that are estimated and not kept say nothing of it."""
    jointly = AdjustmentConfig(intrinsics=("fx", "fy"))
    config = CalibrationConfig(cues=("labels",), refinement=RefinementConfig(jointly=jointly))
    start = InitialPose(read_transform(moving / "steady"), "truth")
    found = semcal_package.calibrate(moving / "steady", config, initial_pose=start)
    assert found.uncertainty is not None
    assert max(found.uncertainty.half_width_95_camera_center_m) > 0.3
    assert "wide-interval" in found.topics


def test_seeds_are_compared_by_what_the_interval_holds(
    moving: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """That of a clock that was estimated is no part of it, so nothing of it is taken off."""
    late = moving / "late"
    options = ("--init", late, "--estimate-delay", "--repeat", 2, "-o", tmp_path / "c.yaml", "-q")
    code, _, err = run(capfd, "calibrate", late, *options)
    assert code == 0, err


@pytest.mark.parametrize("options", [(), ("--max-delay-ms", 5)])
def test_a_late_clock_at_one_speed_fails_no_transform(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], options: tuple[object, ...]
) -> None:
    """24 cm of the camera's place are what 20 ms cost at 12 m/s; with and without the clock's own check."""
    config = SynthConfig(num_frames=4, seed=5, width=640, height=360, motion="steady", delay_ms=20.0)
    synthesize(config, tmp_path / "late")
    code, out, _ = run(capfd, "verify", tmp_path / "late", tmp_path / "late", *options, "--json", "-q")
    found = json.loads(out)
    assert (code, found["verdict"]) == (INCONCLUSIVE, "inconclusive")
    assert "wide-interval" in found["topics"]
    assert ("clocks" in found["topics"]) == bool(options)  # asked for, and not determined
    (overall,) = (each for each in found["checks"] if each["name"] == "camera centre overall")
    assert abs(overall["offset"]) > 20.0
    assert overall["half_width"] is None
    assert any(
        "the clock was not checked: all frames have the same motion." in note for note in found["notes"]
    )


@pytest.mark.parametrize(
    ("name", "code", "expected"),
    [
        ("right", PASS, "pass"),
        ("late", FAIL, "fail"),
        ("steady", INCONCLUSIVE, "inconclusive"),
        ("one", INCONCLUSIVE, "inconclusive"),
    ],
)
def test_verdicts_on_the_clock(
    moving: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str, code: int, expected: str
) -> None:
    drive, xml = exactly_triggered(moving / name, tmp_path), tmp_path / "a.xml"
    found, out, _ = run(capfd, "verify", drive, drive, "--max-delay-ms", 5, "--json", "--junit", xml, "-q")
    report = json.loads(out)
    assert (found, report["verdict"]) == (code, expected), out
    *others, check = report["checks"]
    assert {each["verdict"] for each in others} == {"pass"}
    assert (check["name"], check["unit"], check["allowed"], check["verdict"]) == (CLOCK, "ms", 5.0, expected)
    (suite,) = junitparser.JUnitXml.fromfile(str(xml))
    assert suite.tests == len(others) + 1 == 9
    if expected == "inconclusive":
        assert (check["offset"], check["half_width"]) == (0.0, None)
        assert (report["reasons"], report["topics"]) == ([NOT_DETERMINED], ["clocks"])
        assert NOT_DETERMINED not in report["notes"]
        assert 'message="not determined, allowed 5 ms"' in xml.read_text()
    else:
        assert check["offset"] == pytest.approx(DRIVES[name][1], abs=CLOSE_MS)
        assert check["half_width"] < 5.0
        assert report["reasons"] == []


def test_what_is_said_of_a_clock_alone(
    moving: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    late, page = moving / "late", tmp_path / "v.html"
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    code, out, err = run(capfd, "verify", late, late, "--max-delay-ms", 5, "--report", page, "-q")
    *others, first, second, verdict = out.splitlines()
    (check,) = (line for line in others if line.startswith(CHECK_NAMES[CLOCK]))
    assert code == FAIL
    assert check.endswith("ms  allowed 5 ms     fail")
    assert f"{first} {second}" == (
        "The transform still holds on this drive, but the camera's clock is off. Calibrate again with "
        "--estimate-delay, or find out what changed the clock."
    )
    assert verdict.startswith("verdict          fail: clock off by 2")
    assert verdict.endswith(" ms, allowed 5 ms")
    assert "::error title=semcal verify::fail; clock 2" in err
    assert "images later (clock)" in page.read_text()
    one = exactly_triggered(moving / "one", tmp_path)
    code, out, _ = run(capfd, "verify", one, one, "--max-delay-ms", 5, "--report", page)
    assert code == INCONCLUSIVE
    assert " not determined    allowed 5 ms     inconclusive" in out
    assert out.splitlines()[-1] == "verdict          inconclusive: clock not determined, allowed 5 ms"
    assert "cannot show whether the camera&#39;s clock is right" in page.read_text()
    assert '#clocks">why this comes up</a>' in page.read_text()


def test_an_interval_about_the_limit_decides_nothing() -> None:
    assert [judge_clock(offset, 0.002, 0.005).verdict for offset in (0.0033, 0.004, -0.0066, -0.0068)] == [
        "pass",
        "inconclusive",
        "inconclusive",
        "fail",
    ]
    late = judge_clock(-0.0201, 0.001, 0.005)
    assert figures(late) == "-20.1 +- 1.0 ms, allowed 5 ms"
    assert overall_offsets([late]) == ["clock off by -20.1 +- 1.0 ms, allowed 5 ms"]
    assert sufficient_limits([late]) == sufficient_limits([judge_clock(0.0, None, 0.005)]) == []
    assert sufficient_limits([judge_clock(0.004, 0.002, 0.005)]) == ["--max-delay-ms 5.7"]
    assert figures(judge_clock(0.0, None, 0.005)) == "not determined, allowed 5 ms"
    assert overall_offsets([judge_clock(0.0, None, 0.005)]) == ["clock not determined, allowed 5 ms"]


@pytest.fixture(scope="module")
def estimated(moving: Path) -> CalibrationDocument:
    """A calibration whose clock was estimated and kept."""
    jointly = AdjustmentConfig(with_delay=True)
    found = semcal_package.calibrate(
        moving / "late", CalibrationConfig(refinement=RefinementConfig(jointly=jointly))
    )
    assert found.clock is not None
    assert found.clock.is_kept
    return found


def test_each_stage_is_shown_by_the_clock_that_it_was_found_with(
    moving: Path, estimated: CalibrationDocument, tmp_path: Path
) -> None:
    drive = read_drive(moving / "late")
    write_calibration(estimated, tmp_path / "c.yaml")
    overlays = read_report_input(drive, tmp_path / "c.yaml").overlays(20)
    first, last = (view.observations.clouds for view in overlays.views.values())
    for begun, cloud, later in zip(load(drive).observations.clouds, first, last, strict=True):
        assert np.linalg.norm(cloud.points - begun.points, axis=1).max() < MAX_CURVED_M
        assert np.linalg.norm(later.points - begun.points, axis=1).max() > 10.0 * MAX_CURVED_M


def test_the_estimate_of_a_verification_is_shown_by_its_clock(moving: Path) -> None:
    data, start = load(moving / "late"), InitialPose(read_transform(moving / "late"), "it")
    found = semcal_package.verify(data, moving / "late", Limits(delay_s=0.005))
    assert found.verdict == "fail"
    assert found.checks[-1].name == CLOCK
    assert found.time_offset_s == pytest.approx(0.02, abs=1e-3 * CLOSE_MS)
    given, last = both_overlays(found, data, start).views.values()
    assert given.observations.clouds[0] is data.observations.clouds[0]
    agreements = [
        core.agreement(seen.observations.core, last.T_camera_lidar).label_agreement for seen in (given, last)
    ]
    assert agreements[1] > agreements[0]
    with pytest.raises(InputError, match=r"^delay_s: found -1, expected a number from 0 on$"):
        semcal_package.verify(data, moving / "late", Limits(delay_s=-1))


def test_the_clock_of_a_result_is_what_is_judged(
    moving: Path, estimated: CalibrationDocument, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """What remains is judged."""
    result = tmp_path / "calibration.yaml"
    estimated = of_another_drive(estimated)
    write_calibration(estimated, result)
    code, out, _ = run(capfd, "verify", moving / "late", result, "--max-delay-ms", 5, "--json", "-q")
    report = json.loads(out)
    assert code == PASS, report
    assert abs(report["checks"][-1]["offset"]) < CLOSE_MS
    wrong = estimated.model_copy(update={"clock": clock().model_copy(update={"time_offset_s": 0.1})})
    write_calibration(wrong, result)
    code, out, _ = run(capfd, "verify", moving / "late", result, "--max-delay-ms", 5, "--json", "-q")
    assert code == FAIL
    assert json.loads(out)["checks"][-1]["offset"] == pytest.approx(-80.0, abs=CLOSE_MS)


def test_a_drive_without_a_direction_of_motion(
    street: Path, drive: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with edited(drive) as document:
        document["motion"] = {"speed_m_s": 12.0}
    for each in (street, drive):
        code, out, err = run(capfd, "verify", each, street, "--max-delay-ms", 5)
        assert (code, out) == (1, "")
        assert err.splitlines()[-1] == (
            f"semcal: error: {each / DRIVE_FILE}: motion: found no direction of motion, expected poses or a twist for "
            "--max-delay-ms"
        )
