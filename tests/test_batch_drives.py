"""Where the drives of a batch come from, where their results go, and which camera a drive is of."""

import io
from pathlib import Path

import pytest
from refined import with_camera

from semcal_cli.errors import InputError
from semcal_cli.many.batch.tasks import Task, describe_result, find_drives, folder_of
from semcal_cli.result.calibration_document import CalibrationDocument, write_calibration
from semcal_cli.result.provenance import camera_hash


def test_where_drives_come_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("b/2", "b/10", "a"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "drive.yaml").touch()
    (tmp_path / "list.txt").write_text("# of today\nb/2\n\nb/1*\n")
    stdin = io.TextIOWrapper(io.BytesIO(b"a\n./b/2/drive.yaml\n"))
    assert find_drives(["b/*"], None) == ["b/10", "b/2"]
    assert find_drives(["list.txt"], None) == ["b/10", "b/2"]
    assert find_drives(["-"], stdin) == ["a", "b/2/drive.yaml"]
    assert find_drives(["b/2", "./b/2/", "b/2/drive.yaml"], None) == ["b/2"]
    assert find_drives(["missing"], None) == ["missing"]  # a line of the summary, not the end of all
    for names in (["c/*"], ["-"]):
        with pytest.raises(InputError, match="found no"):
            find_drives(names, None)
    folders = [folder_of(name) for name in ("b/2", "b/2/drive.yaml", "/data/x", "../y", ".")]
    assert list(map(str, folders)) == ["b/2", "b/2", "data/x", "__/y", "_"]


@pytest.mark.parametrize("is_kept", [True, False])
def test_a_drive_has_the_camera_that_its_transform_belongs_to(
    street: Path, refined: CalibrationDocument, tmp_path: Path, is_kept: bool
) -> None:
    """Not the one that it began with, so that drives with different estimates do not pass for one camera."""
    given, found = refined.input.camera, refined.used_camera
    task = Task("street", str(street), str(tmp_path), "calibrate")
    write_calibration(with_camera(refined, given, found, is_kept=is_kept), task.result)
    assert describe_result(task, 0).camera == camera_hash(found if is_kept else given)
