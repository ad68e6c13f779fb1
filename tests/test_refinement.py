import dataclasses

import numpy as np
import pytest
import torch
from conftest import make_pose

from semcal_cli.checks.settled import check_refinement
from semcal_cli.config import FAR_DEG, ExactConfig, PyramidConfig
from semcal_cli.config.mine_config import MineConfig
from semcal_cli.drive.camera import Camera
from semcal_cli.errors import CalibrationError
from semcal_cli.estimation.refine.mine import MineEstimator
from semcal_cli.estimation.refine.pyramid import ExactEstimator, LevelOptimizer, pyramid_factors, refine_pose
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.observations import Observations

# Three times what four frames of 640 x 360 were measured to end at.
MAX_ROTATION_DEG = 0.1
MAX_CENTER_CM = 1.5

BAD_START = make_pose((0.12, -0.15, 0.1), (0.3, -0.3, 0.2))  # 12 degrees and half a metre
A_METRE_OFF = make_pose((0.05, -0.05, 0.05), (0.7, -0.5, 0.5))  # and 5 degrees
FROM_AFAR = PyramidConfig(coarsest_block_deg=FAR_DEG)
SHORT = MineConfig(steps_per_level=20, warm_up_steps=10)


def make_optimizer(
    estimator: str, observations: Observations, seed: int = 0, mine: MineConfig | None = None
) -> LevelOptimizer:
    if estimator == "exact":
        return ExactEstimator(observations, ExactConfig(), seed)
    return MineEstimator(observations, mine or MineConfig(), seed)


@pytest.mark.parametrize(
    ("estimator", "start"), [("exact", BAD_START), ("exact", A_METRE_OFF), ("mine", BAD_START)]
)
def test_a_bad_start_ends_at_the_truth(
    street_observations: Observations, street_truth: Pose, estimator: str, start: Pose
) -> None:
    optimizer = make_optimizer(estimator, street_observations)
    refinement = refine_pose(street_observations, start @ street_truth, optimizer, FROM_AFAR)
    error = compare_poses(refinement.T_camera_lidar, street_truth)
    assert error.rotation_deg < MAX_ROTATION_DEG
    assert error.camera_center_cm < MAX_CENTER_CM
    assert refinement.converged


@pytest.mark.parametrize("estimator", ["exact", "mine"])
def test_the_seed_decides_every_bit(
    street_observations: Observations, street_truth: Pose, estimator: str
) -> None:
    first, second, other = (
        refine_pose(
            street_observations,
            street_truth,
            make_optimizer(estimator, street_observations, seed, SHORT),
            PyramidConfig(),
        ).T_camera_lidar
        for seed in (4, 4, 5)
    )
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize("estimator", ["exact", "mine"])
def test_a_pose_that_still_moves_has_not_settled(
    street_observations: Observations, street_truth: Pose, estimator: str
) -> None:
    optimizer: LevelOptimizer
    if estimator == "exact":
        hasty = ExactConfig(steps=8, step_size=2.0, final_step=1.0)
        optimizer = ExactEstimator(street_observations, hasty, seed=0)
    else:
        optimizer = MineEstimator(
            street_observations, MineConfig(steps_per_level=8, learning_rate_pose=2.0, final_rate=1.0), seed=0
        )
    refinement = refine_pose(street_observations, BAD_START @ street_truth, optimizer, PyramidConfig())
    assert not refinement.converged
    (finding,) = check_refinement(refinement)
    assert finding.sentence.startswith("the refinement had not settled; the pose still moved points by ")


def test_disjoint_ids_carry_the_same_information(
    street_observations: Observations, street_truth: Pose
) -> None:
    swapped = street_observations.with_images(
        image.with_classes(np.where(image.classes == 255, 255, 24 - image.classes).astype(np.uint8))
        for image in street_observations.images
    )
    renamed = dataclasses.replace(swapped, image_class_names=tuple(f"x{i}" for i in range(25)))
    refinement = refine_pose(renamed, street_truth, make_optimizer("exact", renamed), PyramidConfig())
    assert compare_poses(refinement.T_camera_lidar, street_truth).rotation_deg < MAX_ROTATION_DEG


@pytest.mark.parametrize("estimator", ["exact", "mine"])
def test_a_camera_that_looks_away_has_no_overlap(street_observations: Observations, estimator: str) -> None:
    looking_up = np.eye(4)  # The camera's z axis along the LiDAR's: into the sky.
    with pytest.raises(
        CalibrationError, match=r"no overlap: 0 of \d+ points land on pixels that can be compared with them, "
    ):
        refine_pose(
            street_observations, looking_up, make_optimizer(estimator, street_observations), PyramidConfig()
        )


@pytest.mark.parametrize("estimator", ["exact", "mine"])
def test_points_that_leave_the_image_raise_nothing(
    street_observations: Observations, street_truth: Pose, estimator: str
) -> None:
    """A crop of the images has fewer border pixels' worth of points: a start to its side must not run away."""
    u, v, width, height = 200, 120, 160, 120
    camera = street_observations.camera
    (fx, _, cx), (_, fy, cy), _ = camera.K
    K = ((fx, 0.0, cx - u), (0.0, fy, cy - v), (0.0, 0.0, 1.0))
    cropped = dataclasses.replace(
        street_observations.with_images(
            image.with_classes(image.classes[v : v + height, u : u + width])
            for image in street_observations.images
        ),
        camera=camera.model_copy(update={"width": width, "height": height, "K": K}),
    )
    start = make_pose((0.0, 0.05, 0.0), (0.0, 0.0, 0.0)) @ street_truth  # a seventh of the crop to the side
    refinement = refine_pose(cropped, start, make_optimizer(estimator, cropped), FROM_AFAR)
    assert compare_poses(refinement.T_camera_lidar, street_truth).rotation_deg < 0.5


def test_cuda_gives_the_same_answer(street_observations: Observations, street_truth: Pose) -> None:
    if not torch.cuda.is_available():
        pytest.skip("no CUDA device")
    optimizer = MineEstimator(street_observations, MineConfig(), seed=0, device="cuda")
    refinement = refine_pose(street_observations, BAD_START @ street_truth, optimizer, FROM_AFAR)
    assert compare_poses(refinement.T_camera_lidar, street_truth).rotation_deg < MAX_ROTATION_DEG


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
def test_the_pyramid_follows_lens_and_image(width: int, height: int, focal: float, coarsest: int) -> None:
    camera = Camera(
        model="plumb_bob",
        width=width,
        height=height,
        K=((focal, 0.0, 0.0), (0.0, focal, 0.0), (0.0, 0.0, 1.0)),
    )
    factors = pyramid_factors(camera, FROM_AFAR)
    assert factors[0] == coarsest
    assert factors[-1] == 1


def test_a_mirror_in_the_lens_is_no_longer_focal_length() -> None:
    """Seen from xi behind the sphere, the middle of the image is smaller by 1 + xi."""
    K = ((960.0, 0.0, 639.5), (0.0, 960.0, 479.5), (0.0, 0.0, 1.0))
    mirror = Camera(model="omnidirectional", width=1280, height=960, K=K, parameters={"xi": 2.0})
    K = ((320.0, 0.0, 639.5), (0.0, 320.0, 479.5), (0.0, 0.0, 1.0))
    fisheye = Camera(model="fisheye", width=1280, height=960, K=K)
    assert pyramid_factors(mirror, FROM_AFAR) == pyramid_factors(fisheye, FROM_AFAR) == [16, 8, 4, 2, 1]
