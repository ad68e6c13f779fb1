"""The format, the cue and the data set of CONTRIBUTING.md work as they stand there."""

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast, get_args

import numpy as np
import pytest
from camera_infos import ROS
from dataset_imports import run_import
from dataset_trees import write, write_cloud, write_ids
from documentation import ROOT, blocks
from format_files import T_ANY

from semcal_cli.config import CueName
from semcal_cli.drive.cues.table import CUES, files_of, load_cues
from semcal_cli.drive.document import read_drive
from semcal_cli.formats import put_transform, read_transform, table, write_transform


def example(word: str) -> dict[str, Any]:
    """What the only block with a word defines."""
    (block,) = (each for each in blocks(ROOT / "CONTRIBUTING.md", "python") if word in each)
    names: dict[str, Any] = {}
    exec(block, names)
    return names


def test_the_format_is_read_written_and_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    format = example("entry_format")["FORMAT"]
    monkeypatch.setattr(table, "FORMATS", (*table.FORMATS, format))
    monkeypatch.setattr("semcal_cli.formats.FORMATS", table.FORMATS)
    path = tmp_path / "rig.yaml"
    write_transform(T_ANY, path, format.name)
    np.testing.assert_allclose(read_transform(path), T_ANY, atol=1e-12)
    path.write_text("# ours\n" + path.read_text())
    put_transform(np.eye(4), path)
    assert path.read_text() == "# ours\nmounting:\n  q: [1.0, 0.0, 0.0, 0.0]\n  t: [0.0, 0.0, 0.0]\n"


def test_the_cue_is_compared_alone_and_beside_labels(street: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(CUES, "brightness", example("grey_values")["CUE"])
    assert "brightness" not in get_args(CueName)
    drive, names = read_drive(street), cast(list[CueName], ["labels", "brightness"])
    alone, labels = (load_cues(drive, [name]) for name in names[::-1])
    assert alone.point_class_names == ["near", "far"]
    assert {len(np.unique(each.classes)) for each in alone.clouds} == {2}
    both = load_cues(drive, names)
    assert both.num_cues == 2
    assert both.point_class_names == [*labels.point_class_names, "near", "far"]
    assert files_of(names) == ["points", "point_labels", "image_labels", "image"]


def test_the_data_set_is_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read = example("joined")["read"]
    monkeypatch.setitem(sys.modules, "semcal_cli.datasets.rellis_3d", SimpleNamespace(read=read))
    write_cloud(tmp_path / "set/clouds/1.bin")
    write_ids(tmp_path / "set/pictures/1.png")
    write(tmp_path / "set/camera.yaml", ROS)
    write_transform(T_ANY, tmp_path / "set/transform.yaml", "semcal")
    run_import("rellis-3d", tmp_path / "set", "-o", tmp_path / "drive")
    drive = read_drive(tmp_path / "drive")
    assert [(frame.points, frame.image) for frame in drive.frames] == [
        ("../set/clouds/1.bin", "../set/pictures/1.png")
    ]
    np.testing.assert_allclose(np.array(drive.T_camera_lidar), T_ANY, atol=1e-12)
