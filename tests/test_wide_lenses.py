"""From nothing, where the image is no plane: lenses that see beside and behind themselves."""

import dataclasses
from pathlib import Path

import pytest
from conftest import STREET

from semcal_cli.config import ExactConfig, InitializationConfig, PyramidConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.estimation.refine.pyramid import ExactEstimator, refine_pose
from semcal_cli.estimation.search.mounting_search import search_mountings
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.reading import load_observations
from semcal_cli.synthetic.synthesis import synthesize

# Three times what was measured: a pixel is a third of a degree.
RIGHT_DEG = 0.06
RIGHT_CM = 1.0


@pytest.mark.parametrize(
    ("lens", "size"),
    [("fisheye", (640, 480)), ("omnidirectional", (640, 480)), ("equirectangular", (1024, 512))],
)
def test_the_mounting_of_a_wide_lens_is_found(tmp_path: Path, lens: str, size: tuple[int, int]) -> None:
    config = dataclasses.replace(STREET, num_frames=2, lens=lens, width=size[0], height=size[1])
    synthesize(config, tmp_path / "drive")
    drive = read_drive(tmp_path / "drive")
    observations = load_observations(drive)
    initial = search_mountings(observations, InitializationConfig(), seed=0)
    estimator = ExactEstimator(observations, ExactConfig(), seed=0)
    refinement = refine_pose(observations, initial.T_camera_lidar, estimator, PyramidConfig())
    error = compare_poses(refinement.T_camera_lidar, read_transform(drive.root))
    assert refinement.converged
    assert error.rotation_deg < RIGHT_DEG
    assert error.camera_center_cm < RIGHT_CM
