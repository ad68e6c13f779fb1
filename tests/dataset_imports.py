"""Imports of the tiny data sets of `dataset_trees`, and what every drive they write has to hold."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from commands import invoke
from dataset_trees import TREES, Tree

from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.frames import Frame
from semcal_cli.errors import InputError

PRINTED = 1e-9  # digits of the generated calibration files


def run_import(name: str, *arguments: object) -> str:
    """Run the command; what it writes to standard error."""
    result = invoke("import", name, *arguments)
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.stderr


def complaint(name: str, *arguments: object) -> str:
    with pytest.raises(InputError) as error:
        run_import(name, *arguments)
    return str(error.value)


class Import:
    """A tiny data set, which is imported with its own arguments and further ones."""

    def __init__(self, name: str, folder: Path, make: Callable[[Path], Tree] | None = None) -> None:
        self.name, self.out, self.stderr = name, folder / "drive", ""
        self.tree = (make or TREES[name])(folder / "tree")
        self.root = self.tree.root

    def run(self, *arguments: object) -> Drive:
        self.stderr = run_import(self.name, self.root, *self.tree.arguments, *arguments, "-o", self.out)
        return read_drive(self.out)

    def complaint(self, *arguments: object) -> str:
        """What is said of an import that writes nothing; the root of the tree is {root}."""
        before = sorted(self.out.parent.rglob("*"))
        found = complaint(self.name, self.root, *self.tree.arguments, *arguments, "-o", self.out)
        assert sorted(self.out.parent.rglob("*")) == before
        return found.replace(str(self.root), "{root}")

    def check(self) -> None:
        """A plain import finds what the tree has."""
        drive, tree = self.run(), self.tree
        np.testing.assert_allclose(drive.T_camera_lidar, tree.T_camera_lidar, atol=PRINTED)
        assert drive.camera.K[0][0] > 0.0
        assert all(frame.image_labels or frame.image for frame in drive.frames)
        check_files(drive)
        points, image = (drive.classes.points, drive.classes.image) if drive.classes else ({}, {})
        assert {key: list(points[key]) for key in tree.points} == tree.points
        assert {key: list(image[key]) for key in tree.image} == tree.image
        assert (list(drive.ignore.points), list(drive.ignore.image)) == tree.ignored


def check_files(drive: Drive) -> None:
    """What a drive names is there, by relative paths."""
    files = [file for frame in drive.frames for file in named_files(frame)]
    assert [file for file in files if Path(file).is_absolute() or not drive.resolve(file).is_file()] == []


def named_files(frame: Frame) -> list[str]:
    named = (frame.points, frame.point_labels, frame.image_labels, frame.image)
    return [file for file in named if file]


def written_cloud(drive: Drive, frame: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) and labels (N,) of a converted cloud."""
    points = np.fromfile(drive.resolve(drive.frames[frame].points), dtype="<f4").reshape(-1, 4)
    return points[:, :3], np.fromfile(drive.resolve(str(drive.frames[frame].point_labels)), dtype="<u4")
