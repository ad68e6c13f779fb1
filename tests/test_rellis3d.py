"""The main job on a real frame, through the real command."""

import subprocess
import sysconfig
from pathlib import Path

import pytest
from conftest import edited, real

from semcal_cli import core
from semcal_cli.cli.outputs import EXIT_NOT_TRUSTED
from semcal_cli.drive.document import read_drive
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import rotation_error_deg
from semcal_cli.observations.reading import load_observations
from semcal_cli.result.calibration_document import read_calibration

PUBLISHED_IS_TRUE_TO_DEG = 1.5
SEMCAL = Path(sysconfig.get_path("scripts")) / "semcal"


@pytest.fixture(scope="module")
def rellis(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for results, and in it the drive without its reference."""
    source = real("rellis3d_000104")
    folder = tmp_path_factory.mktemp("rellis")
    with edited(source, folder) as document:
        del document["T_camera_lidar"]
        (frame,) = document["frames"]
        document["frames"] = [{key: str(source / name) for key, name in frame.items()}]
    return folder


def calibrate(*arguments: object) -> int:
    return subprocess.run([SEMCAL, "calibrate", *map(str, arguments)], check=False).returncode


def check_against_published(result: Path, rellis3d: Path) -> None:
    T_camera_lidar, T_published = read_calibration(result).pose, read_transform(rellis3d)
    observations = load_observations(read_drive(rellis3d)).core
    found, published = (core.agreement(observations, T) for T in (T_camera_lidar, T_published))
    assert found.mutual_information > published.mutual_information
    assert rotation_error_deg(T_camera_lidar, T_published) < PUBLISHED_IS_TRUE_TO_DEG


def test_from_nothing_with_any_number_of_threads(rellis: Path, rellis3d: Path) -> None:
    results = [rellis / f"threads_{n}.yaml" for n in (1, 2)]
    for num_threads, result in enumerate(results, start=1):
        # One frame of a narrow lens hardly rules out mountings that share half of the view.
        assert calibrate(rellis, "-o", result, "--threads", num_threads) in (0, EXIT_NOT_TRUSTED)
    check_against_published(results[0], rellis3d)
    assert results[0].read_bytes() == results[1].read_bytes()


def test_from_a_bad_older_calibration(rellis: Path, rellis3d: Path) -> None:
    older = rellis3d / "transforms_older.yaml"
    assert rotation_error_deg(read_transform(older), read_transform(rellis3d)) > PUBLISHED_IS_TRUE_TO_DEG
    result = rellis / "older.json"
    # One frame hardly bends along the optical axis, nor does it tell the focal length.
    assert calibrate(rellis, "-o", result, "--init", older) in (0, EXIT_NOT_TRUSTED)
    check_against_published(result, rellis3d)
