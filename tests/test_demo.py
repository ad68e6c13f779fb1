"""`semcal demo --real`: KITTI in its two layouts, from import to a verdict, and what is no KITTI."""

from pathlib import Path

from commands import invoke
from conftest import real

from semcal_cli.drive.document import read_drive
from semcal_cli.result.calibration_document import read_calibration


def test_kitti_object_is_trusted_from_import_to_report(tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = invoke("demo", out, "--real", real("kitti_object"))
    assert done.exit_code == 0, done.output
    assert read_calibration(out / "calibration.yaml").status == "trusted"
    assert all((out / name).is_file() for name in ("report.html", "overlay.png"))
    assert "error against the transform that KITTI publishes:" in done.stderr
    assert f"semcal overlay {out}/drive {out}/calibration.yaml" in done.stderr


def test_of_kitti_raw_the_longest_sequence_is_taken(tmp_path: Path) -> None:
    """Of a camera that is not the usual one; five frames of one street are too few to trust."""
    done = invoke("demo", tmp_path / "out", "--real", real("kitti_raw_right"))
    assert done.exit_code in (0, 3), done.output
    assert len(read_drive(tmp_path / "out/drive").frames) == 5


def test_another_folder_is_told_what_was_needed(tmp_path: Path) -> None:
    done = invoke("demo", tmp_path / "out", "--real", tmp_path)
    assert done.exit_code == 1
    assert str(done.exception).endswith(f"in {tmp_path}, expected a folder of KITTI object or KITTI raw")
    assert not (tmp_path / "out").exists()
