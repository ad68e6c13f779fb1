"""Imports of the tiny data sets of `dataset_trees`, and what every drive they write has to hold."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from dataset_trees import (
    Tree,
)

from semcal_cli.cli import semcal
from semcal_cli.drive.document import Drive, Frame, read_drive
from semcal_cli.errors import InputError

PRINTED = 1e-9  # digits of the generated calibration files


def run_import(name: str, *arguments: object) -> str:
    """Run the command; what it writes to standard error."""
    result = CliRunner().invoke(semcal, ["import", name, *map(str, arguments)])
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.stderr


def imported(name: str, tree: Tree, folder: Path, *arguments: object) -> Drive:
    run_import(name, tree.root, *tree.arguments, *arguments, "-o", folder)
    return read_drive(folder)


def check_import(name: str, tree: Tree, folder: Path) -> Drive:
    drive = imported(name, tree, folder)
    np.testing.assert_allclose(drive.T_camera_lidar, tree.T_camera_lidar, atol=PRINTED)
    assert drive.camera.K[0][0] > 0.0
    for frame in drive.frames:
        assert [file for file in named_files(frame) if Path(file).is_absolute()] == []
        assert frame.image_labels or frame.image
    check_files(drive)
    points, image = (drive.classes.points, drive.classes.image) if drive.classes else ({}, {})
    assert {key: list(points[key]) for key in tree.points} == tree.points
    assert {key: list(image[key]) for key in tree.image} == tree.image
    assert (list(drive.ignore.points), list(drive.ignore.image)) == tree.ignored
    return drive


def named_files(frame: Frame) -> list[str]:
    named = (frame.points, frame.point_labels, frame.image_labels, frame.image)
    return [file for file in named if file]


def check_files(drive: Drive) -> None:
    """What a drive names is there."""
    files = [file for frame in drive.frames for file in named_files(frame)]
    assert [file for file in files if not drive.resolve(file).is_file()] == []


def written_cloud(drive: Drive, frame: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) and labels (N,) of a converted cloud."""
    points = np.fromfile(drive.resolve(drive.frames[frame].points), dtype="<f4").reshape(-1, 4)
    return points[:, :3], np.fromfile(drive.resolve(str(drive.frames[frame].point_labels)), dtype="<u4")


def complaint(name: str, *arguments: object) -> str:
    with pytest.raises(InputError) as error:
        run_import(name, *arguments)
    return str(error.value)
