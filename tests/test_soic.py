"""SOIC, the rival: as good as its idea, and clear about what it needs."""

from dataclasses import replace

import numpy as np
import pytest

from semcal_cli import core
from semcal_cli.drive.camera import core_camera
from semcal_cli.errors import CalibrationError
from semcal_cli.experiments.soic import Soic
from semcal_cli.experiments.soic_config import SoicConfig
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses, pose_from_mounting
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.observations import LabelledCloud, Observations
from semcal_cli.synthetic.label_noise import with_wrong_labels


@pytest.fixture(scope="module")
def soic(street_observations: Observations) -> Soic:
    return Soic(street_observations, SoicConfig())


def test_comes_back_from_two_degrees(soic: Soic, street_truth: Pose) -> None:
    for seed in range(2):
        T_init = displace(street_truth, 2.0, 0.2, np.random.default_rng(seed))
        minimum = soic.minimize(T_init)
        assert minimum.converged
        assert minimum.cost_px == pytest.approx(soic.cost(minimum.T_camera_lidar))
        assert minimum.cost_px < 0.2 * soic.cost(T_init)
        error = compare_poses(minimum.T_camera_lidar, street_truth)
        assert error.rotation_deg < 0.5
        assert error.camera_center_cm < 10.0


@pytest.mark.parametrize("block_px", [1, 2])
def test_the_cost_is_the_distance_to_the_pixels_of_the_class(
    street_observations: Observations, street_truth: Pose, block_px: int
) -> None:
    """Of a few points, by brute force: distances of pixels, means of blocks, bilinear between their centres."""
    from scipy.ndimage import distance_transform_edt, map_coordinates

    seen = street_observations.with_clouds(
        LabelledCloud(cloud.points[::200], cloud.classes[::200]) for cloud in street_observations.clouds
    )
    names = [name for name in seen.point_class_names if name in seen.image_class_names]
    costs: dict[str, list[float]] = {}
    for frame in seen.frame_observations:
        points, ids, image = frame.cloud.points, frame.cloud.classes, frame.image.classes
        pixels = core.project_points(core_camera(seen.camera), points, street_truth).pixels
        for name in names:
            place, of_pixels = seen.point_class_names.index(name), seen.image_class_names.index(name)
            u, v = pixels[(ids == place) & np.isfinite(pixels).all(1)].T
            if (image == of_pixels).any():
                field = distance_transform_edt(image != of_pixels)
                blocks = field.reshape(field.shape[0] // block_px, block_px, -1, block_px).mean((1, 3))
                where = [(v + 0.5) / block_px - 0.5, (u + 0.5) / block_px - 0.5]
                costs.setdefault(name, []).extend(map_coordinates(blocks, where, order=1, mode="nearest"))
    expected = np.mean([np.mean(of_class) for of_class in costs.values() if of_class])
    cost = Soic(seen, SoicConfig(block_px=block_px)).cost(street_truth)
    assert cost == pytest.approx(expected, rel=1e-4)


def test_wrong_labels_leave_no_better_place_unfound(
    street_observations: Observations, street_truth: Pose
) -> None:
    """Where the cost is rugged, it is at least no higher than at the truth."""
    wrong = with_wrong_labels(street_observations, 0.1, np.random.default_rng(2))
    soic = Soic(wrong, SoicConfig())
    minimum = soic.minimize(displace(street_truth, 2.0, 0.2, np.random.default_rng(0)))
    assert minimum.cost_px < 1.01 * soic.cost(street_truth)


def test_a_pose_at_which_nothing_is_seen_is_an_error(soic: Soic, street_truth: Pose) -> None:
    with pytest.raises(CalibrationError, match="no overlap: no point of any class projects into the image"):
        soic.minimize(pose_from_mounting([0.0, -90.0, 0.0], [0.0, 0.0, 0.0]))


def test_names_that_differ_are_an_error(street_observations: Observations) -> None:
    others = [f"image {name}" for name in street_observations.image_class_names]
    with pytest.raises(CalibrationError, match="found 0 class names that points and pixels of a frame share"):
        Soic(replace(street_observations, image_class_names=others), SoicConfig())
