import dataclasses

import numpy as np
import pytest
from conftest import make_pose

from semcal_cli.drive import Camera
from semcal_cli.errors import CalibrationError
from semcal_cli.metrics import compare_poses
from semcal_cli.observations import Observations
from semcal_cli.poses import Pose
from semcal_cli.refinement import RefinementConfig, pyramid_factors, refine

# Three times what four frames of 640 x 360 were measured to end at.
MAX_ROTATION_DEG = 0.1
MAX_CENTER_CM = 1.5

BAD_START = make_pose((0.04, -0.05, 0.03), (0.3, -0.3, 0.2))  # 4 degrees and half a metre
SHORT = RefinementConfig(steps_per_level=20, warm_up_steps=10)


def test_a_bad_start_ends_at_the_truth(street_observations: Observations, street_truth: Pose) -> None:
    refinement = refine(street_observations, BAD_START @ street_truth, RefinementConfig(), seed=0)
    error = compare_poses(refinement.T_camera_lidar, street_truth)
    assert error.rotation_deg < MAX_ROTATION_DEG
    assert error.camera_center_cm < MAX_CENTER_CM
    assert refinement.converged


def test_the_seed_decides_every_bit(street_observations: Observations, street_truth: Pose) -> None:
    first, second, other = (refine(street_observations, street_truth, SHORT, seed) for seed in (4, 4, 5))
    np.testing.assert_array_equal(first.T_camera_lidar, second.T_camera_lidar)
    assert not np.array_equal(first.T_camera_lidar, other.T_camera_lidar)


def test_a_pose_that_still_moves_has_not_settled(
    street_observations: Observations, street_truth: Pose
) -> None:
    hasty = RefinementConfig(steps_per_level=8, learning_rate_pose=2.0, final_rate=1.0)
    assert not refine(street_observations, BAD_START @ street_truth, hasty, seed=0).converged


def test_disjoint_ids_carry_the_same_information(
    street_observations: Observations, street_truth: Pose
) -> None:
    swapped = [
        np.where(image == 255, 255, 24 - image).astype(np.uint8)
        for image in street_observations.image_classes
    ]
    renamed = dataclasses.replace(
        street_observations, image_classes=swapped, image_class_names=tuple(f"x{i}" for i in range(25))
    )
    refinement = refine(renamed, street_truth, SHORT, seed=0)
    assert compare_poses(refinement.T_camera_lidar, street_truth).rotation_deg < 1.0


def test_a_camera_that_looks_away_has_no_overlap(street_observations: Observations) -> None:
    looking_up = np.eye(4)  # The camera's z axis along the LiDAR's: into the sky.
    with pytest.raises(
        CalibrationError, match=r"no overlap: 0 of \d+ labelled points land on labelled pixels"
    ):
        refine(street_observations, looking_up, SHORT, seed=0)


@pytest.mark.parametrize(
    ("width", "height", "focal", "coarsest"),
    [
        (1280, 720, 640.0, 32),
        (1920, 1200, 2813.0, 64),
        (640, 360, 320.0, 16),
        (64, 48, 60.0, 2),
        (8, 8, 8.0, 1),
    ],
)
def test_the_pyramid_follows_lens_and_picture(
    street_observations: Observations, width: int, height: int, focal: float, coarsest: int
) -> None:
    camera = Camera(
        model="plumb_bob",
        width=width,
        height=height,
        K=((focal, 0.0, 0.0), (0.0, focal, 0.0), (0.0, 0.0, 1.0)),
    )
    factors = pyramid_factors(dataclasses.replace(street_observations, camera=camera), RefinementConfig())
    assert factors[0] == coarsest
    assert factors[-1] == 1
