"""A drive with a knocked camera: each part is calibrated as a drive of its own, and the page shows each frame."""

from pathlib import Path

import pytest
from laboratory.raw_drive import RawDrive

from semcal_cli.api.calls import calibrate
from semcal_cli.drive.document import read_drive
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.report import read_report_input, write_report
from semcal_cli.result.calibration_document import CalibrationDocument, write_calibration


@pytest.fixture(scope="module")
def loaded(knocked_drive: Path) -> LoadedDrive:
    return load(knocked_drive)


@pytest.fixture(scope="module")
def whole(loaded: LoadedDrive) -> CalibrationDocument:
    return calibrate(loaded)


@pytest.fixture(scope="module")
def parts(loaded: LoadedDrive, knocked: RawDrive) -> list[CalibrationDocument]:
    """The calibrations of the frames before and after the knock."""
    return [calibrate(loaded.of_frames(part)) for part in (range(knocked.knock), range(knocked.knock, 8))]


def test_each_part_is_a_drive_of_its_own(
    whole: CalibrationDocument, parts: list[CalibrationDocument], knocked: RawDrive
) -> None:
    assert whole.status == "not_trusted"
    assert [part.num_frames for part in whole.parts] == [part.quality.num_frames for part in parts]
    assert [frame for part in parts for frame in part.input.frames] == [*whole.input.frames]
    for part, truth in zip(parts, knocked.truths, strict=True):
        assert part.status == "trusted"
        assert part.parts == ()
        error = compare_poses(part.pose, truth)
        assert error.rotation_deg < 0.1
        assert error.camera_center_cm < 1.5


def test_the_report_shows_each_frame(
    knocked_drive: Path,
    street: Path,
    whole: CalibrationDocument,
    parts: list[CalibrationDocument],
    tmp_path: Path,
) -> None:
    def page(calibration: CalibrationDocument) -> str:
        write_calibration(calibration, tmp_path / "c.yaml")
        write_report(read_report_input(read_drive(knocked_drive), tmp_path / "c.yaml"), tmp_path / "r.html")
        return (tmp_path / "r.html").read_text()

    of_whole = page(whole)
    assert "The frames fit 2 poses" in of_whole
    assert "intervals contain the pose of their part" in of_whole
    assert "the result rests on all, and is known far better" not in of_whole
    assert of_whole.count('<g class="step">') == 6
    of_part = page(parts[0])
    assert "intervals contain the result" in of_part
    assert '<g class="step">' not in of_part
    one = read_drive(street)
    one = one.model_copy(update={"frames": one.frames[:1]})
    write_report(read_report_input(one, street), tmp_path / "r.html")
    assert "Frame by frame" not in (tmp_path / "r.html").read_text()
