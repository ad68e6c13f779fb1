"""`semcal calibrate --split`: a drive with a knocked camera, and its parts."""

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from commands import invoke
from laboratory.raw_drive import RawDrive

from semcal_cli import pipeline
from semcal_cli.drive import loading
from semcal_cli.drive.document import read_drive
from semcal_cli.drive.loading import LoadedDrive, load
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.pipeline.parts import split
from semcal_cli.report import read_report_input, write_report
from semcal_cli.result.calibration import Calibration, read_calibration


@pytest.fixture(scope="module")
def results(knocked_drive: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path, int]:
    """What the command makes of a knocked drive, and how often it reads the frames."""
    out, num_reads = tmp_path_factory.mktemp("split"), 0
    load_cues = loading.load_cues

    def counted(*arguments: Any, **settings: Any) -> Any:
        nonlocal num_reads
        num_reads += 1
        return load_cues(*arguments, **settings)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loading, "load_cues", counted)
        found = invoke("calibrate", knocked_drive, "--split", "-o", out / "c.yaml", "--log", out / "log.json")
    return found, out, num_reads


def test_each_part_is_a_drive_of_its_own(results: tuple[Result, Path, int], knocked: RawDrive) -> None:
    found, out, num_reads = results
    assert found.exit_code == 0, found.output
    assert num_reads == 1
    assert sorted(path.name for path in out.iterdir()) == sorted(
        f"{name}{part}.{suffix}"
        for name, suffix in (("c", "yaml"), ("log", "json"))
        for part in ("", "_part_1", "_part_2")
    )
    whole = read_calibration(out / "c.yaml")
    assert whole.status == "not_trusted"
    assert [part.num_frames for part in whole.parts] == [knocked.knock, 8 - knocked.knock]
    first = 0
    for number, truth in enumerate(knocked.truths, start=1):
        part = read_calibration(out / f"c_part_{number}.yaml")
        assert part.status == "trusted"
        assert part.parts == ()
        error = compare_poses(part.pose, truth)
        assert error.rotation_deg < 0.1
        assert error.camera_center_cm < 1.5
        count = whole.parts[number - 1].num_frames
        assert part.input.frames == whole.input.frames[first : first + count]
        assert part.quality.num_frames == count
        # The drive.yaml and three files of each frame.
        assert len(part.input.sha256) == 1 + 3 * count
        assert part.input.sha256.items() <= whole.input.sha256.items()
        assert part.settings == whole.settings
        stages = json.loads((out / f"log_part_{number}.json").read_text())["stages"]
        assert [stage["name"] for stage in stages] == ["initial", "refined", "polished", "assessed"]
        first += count
    assert f"[part 2: {8 - knocked.knock} frames, 000005.bin to 000007.bin]" in found.output
    assert found.output.count("verdict          trusted: +- ") == 2


def test_a_drive_of_one_pose_has_no_parts(street: Path, tmp_path: Path) -> None:
    found = invoke("calibrate", street, "--split", "-o", tmp_path / "c.yaml")
    assert found.exit_code == 0
    assert found.output.splitlines()[-1] == "parts            none: no camera movement was found"
    assert [path.name for path in tmp_path.iterdir()] == ["c.yaml"]
    assert invoke("calibrate", street, "-o", tmp_path / "plain.yaml").exit_code == 0
    assert (tmp_path / "plain.yaml").read_bytes() == (tmp_path / "c.yaml").read_bytes()


def test_the_worst_part_decides(
    knocked_drive: Path, results: tuple[Result, Path, int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = results[1]
    whole, *parts = (read_calibration(out / f"c{part}.yaml") for part in ("", "_part_1", "_part_2"))
    doubted = parts[0].model_copy(update={"status": "not_trusted", "reasons": ("why",)})
    answers: list[Calibration | Exception] = []

    def answer(*_: object, **__: object) -> Calibration:
        found = answers.pop(0)
        if isinstance(found, Exception):
            raise found
        return found

    monkeypatch.setattr(pipeline, "calibrate", answer)
    answers[:] = [whole, doubted, parts[1]]
    assert invoke("calibrate", knocked_drive, "--split", "-o", tmp_path / "a.yaml").exit_code == 3
    answers[:] = [whole, CalibrationError("no overlap"), parts[1]]
    failed = invoke("calibrate", knocked_drive, "--split", "-o", tmp_path / "b.yaml")
    assert str(failed.exception) == "1 of 2 parts failed; part 1: no overlap"
    assert sorted(path.name for path in tmp_path.glob("b*")) == ["b.yaml", "b_part_2.yaml"]


def test_a_part_replaces_no_input(street: Path, tmp_path: Path) -> None:
    start = tmp_path / "c_part_2.yaml"
    start.write_bytes((street / "drive.yaml").read_bytes())
    found = invoke("calibrate", street, "--split", "--init", start, "-o", tmp_path / "c.yaml")
    assert isinstance(found.exception, InputError)
    assert "c_part_2.yaml: found a file that this run reads or writes" in str(found.exception)
    assert list(tmp_path.iterdir()) == [start]


def test_parts_are_of_the_frames_of_the_calibration(
    knocked_drive: Path, results: tuple[Result, Path, int]
) -> None:
    whole = read_calibration(results[1] / "c.yaml")
    data = load(knocked_drive)
    parts = split(data, whole)
    assert [len(part.drive.frames) for part in parts] == [part.observations.num_frames for part in parts]
    frames = [frame for part in parts for frame in part.observations.frame_observations]
    assert all(one is other for one, other in zip(frames, data.observations.frame_observations, strict=True))
    few: LoadedDrive = data.of_frames(range(6))
    with pytest.raises(InputError, match="found a calibration of 8 other frames, needed one of the 6 loaded"):
        split(few, whole)


def test_the_report_shows_each_frame(
    knocked_drive: Path, street: Path, results: tuple[Result, Path, int], tmp_path: Path
) -> None:
    report = read_report_input(read_drive(knocked_drive), results[1] / "c.yaml")
    write_report(report, tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text()
    assert "The frames fit 2 poses" in page
    assert "intervals contain the pose of their part" in page
    assert page.count('<g class="step">') == 6
    part = read_report_input(read_drive(knocked_drive), results[1] / "c_part_1.yaml")
    write_report(part, tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text()
    assert "intervals contain the result" in page
    assert '<g class="step">' not in page
    one = read_drive(street)
    one = one.model_copy(update={"frames": one.frames[:1]})
    write_report(read_report_input(one, street), tmp_path / "r.html")
    assert "Frame by frame" not in (tmp_path / "r.html").read_text()
