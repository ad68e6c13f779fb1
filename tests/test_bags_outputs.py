"""What an import of a recording leaves in its folder: all of its files or none, and those of others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from bag_imports import image, imported, refused, small
from bags import write_drive_as_bag

from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError
from semcal_cli.importing.bags.bag_import import import_bag
from semcal_cli.importing.bags.image_messages import image_file
from semcal_cli.importing.bags.topics import BagRequest


def test_a_refused_import_leaves_no_folder_that_it_made(tmp_path: Path) -> None:
    path, kept = small(tmp_path / "bag", image=image("yuv420")), tmp_path / "kept"
    kept.mkdir()
    for out in (tmp_path / "new/drive", tmp_path / "new/drive/front.yaml", kept / "drive", kept):
        assert "found no usable pair" in refused(path, out)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["bag", "kept"]


def test_an_import_replaces_nothing_that_it_reads(tmp_path: Path) -> None:
    path, file = small(tmp_path), tmp_path / "camera.yaml"
    file.write_text("mine")
    for out, settings in ((path / "metadata.yaml", {}), (file, {"intrinsics": file})):
        before = out.read_bytes()
        assert "found a file that this import reads" in refused(path, out, **settings)
        assert out.read_bytes() == before
    (tmp_path / "folder.yaml").mkdir()
    assert "is a folder" in refused(path, tmp_path / "folder.yaml")
    assert sorted(each.name for each in tmp_path.iterdir()) == ["bag", "camera.yaml", "folder.yaml"]
    with pytest.raises(InputError, match="found twice among the parts"):
        import_bag(BagRequest([path, path]), tmp_path / "twice")


def test_only_a_drive_of_the_same_recording_is_replaced(synthetic: Drive, tmp_path: Path) -> None:
    """Whichever of its frames are chosen, and wherever frames are looked for."""
    path, out = small(tmp_path, count=9), tmp_path / "drive"
    imported(path, out, max_frames=1)
    late = imported(path, out, max_frames=3)
    assert len(late["frames"]) == 3
    del late["frames"][0]
    (out / "drive.yaml").write_text(yaml.safe_dump(late))
    imported(path, out, max_frames=1, every_s=0.4)
    (tmp_path / "other").mkdir()
    other = write_drive_as_bag(synthetic, tmp_path / "other", "ros1")
    before = {file: file.read_bytes() for file in out.rglob("*") if file.is_file()}
    with pytest.raises(
        InputError, match=r"drive\.yaml: found a drive of other data; choose another -o, or --force"
    ):
        import_bag(BagRequest([other]), out)
    assert {file: file.read_bytes() for file in out.rglob("*") if file.is_file()} == before
    import_bag(BagRequest([other]), out, force=True)


def test_a_refused_import_leaves_no_file(
    synthetic: Drive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, written = write_drive_as_bag(synthetic, tmp_path, "ros1"), []

    def refuse(*arguments: Any) -> Any:
        written.append(arguments)
        if len(written) == 3:
            raise InputError("no space left")
        return image_file(*arguments)

    monkeypatch.setattr("semcal_cli.importing.bags.recorded_frames.image_file", refuse)
    (tmp_path / "drive").mkdir()
    with pytest.raises(InputError, match="no space left"):
        import_bag(BagRequest([path]), tmp_path / "drive")
    assert [*(tmp_path / "drive").iterdir()] == []


def test_an_interrupted_import_leaves_nothing_half_written(
    synthetic: Drive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_drive_as_bag(synthetic, tmp_path, "ros1")
    written = []

    def stop(*arguments: Any) -> Any:
        written.append(arguments)
        if len(written) == 3:
            raise KeyboardInterrupt
        return image_file(*arguments)

    monkeypatch.setattr("semcal_cli.importing.bags.recorded_frames.image_file", stop)
    with pytest.raises(KeyboardInterrupt):
        import_bag(BagRequest([path]), tmp_path / "drive")
    assert not (tmp_path / "drive/drive.yaml").exists()
    monkeypatch.undo()
    imported(path, tmp_path / "drive")
    imported(path, tmp_path / "whole")
    names = [
        sorted(str(file.relative_to(out)) for file in out.rglob("*"))
        for out in (tmp_path / "drive", tmp_path / "whole")
    ]
    assert names[0] == names[1]
