import re
from dataclasses import replace

import numpy as np
import pytest

from semcal_cli import _core
from semcal_cli.assessment.consistency import check_consistency
from semcal_cli.assessment.intrinsics import around_intrinsics, wrong_intrinsics
from semcal_cli.config import ExactConfig, PolishConfig, PyramidConfig
from semcal_cli.drive.observations import NO_CLASS, Observations
from semcal_cli.geometry.poses import Pose
from semcal_cli.refinement.polish import newton
from semcal_cli.refinement.pyramid import ExactEstimator, refine_pose
from semcal_cli.result.checks import findings_among


def sentences(observations: Observations, T_camera_lidar: Pose) -> list[str]:
    return [finding.sentence for finding in findings_among(check_consistency(observations, T_camera_lidar))]


def test_nothing_is_found_against_a_good_drive(street_observations: Observations, street_truth: Pose) -> None:
    assert sentences(street_observations, street_truth) == []
    assert sentences(street_observations.of_frames([1]), street_truth) == []


def test_pictures_of_other_frames(street_observations: Observations, street_truth: Pose) -> None:
    images = street_observations.images
    exchanged = street_observations.with_images(images[1:] + images[:1])
    found = sentences(exchanged, street_truth)
    assert any(
        re.match(r"pictures of other frames fit the clouds \d{3}% as well, needed at most 55%: check ", line)
        for line in found
    )


def test_frames_that_are_alike_are_not_held_against_a_pose(
    street_observations: Observations, street_truth: Pose
) -> None:
    standing = street_observations.of_frames([2, 2, 2])
    assert sentences(standing, street_truth) == []


def test_pixels_of_one_class_have_no_top_to_compare_with(
    street_observations: Observations, street_truth: Pose
) -> None:
    plain = street_observations.with_images(
        image.with_classes(np.zeros_like(image.classes)) for image in street_observations.images
    )
    assert "one-class" in [
        finding.topic for finding in findings_among(check_consistency(plain, street_truth))
    ]


def test_labels_that_tell_no_direction(street_observations: Observations, street_truth: Pose) -> None:
    rng = np.random.default_rng(0)
    shuffled = street_observations.with_clouds(
        cloud.with_classes(rng.permutation(cloud.classes)) for cloud in street_observations.clouds
    )
    found = sentences(shuffled, street_truth)
    assert any(
        re.search(r"degrees points and pictures fit (\d{3}% as well|better than)", line) for line in found
    )


@pytest.mark.parametrize("scale", [0.9, 1.1])
def test_wrong_intrinsics_are_named(
    street_observations: Observations, street_truth: Pose, scale: float
) -> None:
    seen = replace(street_observations, camera=street_observations.camera.zoomed(scale))
    refined = refine_pose(
        seen, street_truth, ExactEstimator(seen, ExactConfig(), 0), PyramidConfig(coarsest_block_deg=3.0)
    )
    (focal,) = sentences(seen, refined.T_camera_lidar)
    around = around_intrinsics(seen, refined.T_camera_lidar)
    (intrinsics,) = findings_among(wrong_intrinsics(around, seen.camera, len(set(seen.scenes))))
    right = "shorter" if scale > 1.0 else "longer"
    assert re.match(
        rf"the focal length looks wrong, points and pictures agree \d+\.\d% better with fx and fy 7% {right}: ",
        focal,
    )
    assert intrinsics.sentence.startswith("the intrinsics look wrong")


def with_twists(observations: Observations, twists_per_s: list[list[float]]) -> Observations:
    pairs = zip(observations.frame_observations, twists_per_s, strict=True)
    moving = tuple(replace(frame, twist_per_s=twist) for frame, twist in pairs)
    return replace(observations, frame_observations=moving)


@pytest.mark.parametrize("delay_s", [-0.1, -0.01, 0.0, 0.01, 0.1])
def test_wrong_clocks_are_told_from_the_motion(
    street_observations: Observations, street_truth: Pose, delay_s: float
) -> None:
    """A car that speeds up and turns sees things where it was when the sweep was stamped."""
    speeds = np.linspace(6.0, 16.0, street_observations.num_frames)
    rates = np.linspace(-0.1, 0.2, street_observations.num_frames)
    twists = [[speed, 0.0, 0.0, 0.0, 0.0, rate] for speed, rate in zip(speeds, rates, strict=True)]
    moved = [
        _core.Trajectory.constant(twist, 0.0).compensate(
            cloud.points, np.full(cloud.num_points, delay_s), 0.0
        )
        for cloud, twist in zip(street_observations.clouds, twists, strict=True)
    ]
    clouds = [c.with_points(points) for c, points in zip(street_observations.clouds, moved, strict=True)]
    seen = with_twists(street_observations.with_clouds(clouds), twists)
    near = refine_pose(
        seen, street_truth, ExactEstimator(seen, ExactConfig(), 0), PyramidConfig(3.0)
    ).T_camera_lidar
    ended = newton(seen, near, PolishConfig()).T_camera_lidar
    found = [line for line in sentences(seen, ended) if line.startswith("the clocks look wrong, ")]
    if delay_s == 0.0:
        assert found == []
    else:
        side = "later" if delay_s > 0.0 else "earlier"
        (line,) = found
        assert f" ms {side} than image_stamp says: check the clocks of camera and LiDAR" in line


def test_a_steady_motion_tells_nothing_of_clocks(
    street_observations: Observations, street_truth: Pose
) -> None:
    twists = [[12.0, 0.0, 0.0, 0.0, 0.0, 0.0]] * street_observations.num_frames
    assert sentences(with_twists(street_observations, twists), street_truth) == []
    standing = [[0.0] * 6] * street_observations.num_frames
    assert sentences(with_twists(street_observations, standing), street_truth) == []


def test_one_class_nearly_everywhere(street_observations: Observations, street_truth: Pose) -> None:
    rng = np.random.default_rng(0)
    seen = street_observations.with_clouds(
        cloud.with_classes(np.where(rng.random(cloud.num_points) < 0.02, cloud.classes, 0).astype(np.uint8))
        for cloud in street_observations.clouds
    )
    found = sentences(seen, street_truth)
    assert found[0].startswith("points in the picture are nearly all of one class, they vary like 1.")


def test_nothing_in_the_picture_is_no_crash(street_observations: Observations, street_truth: Pose) -> None:
    blank = street_observations.with_images(
        image.with_classes(np.full_like(image.classes, NO_CLASS)) for image in street_observations.images
    )
    found = sentences(blank, street_truth)
    assert found == ["none of the pixels are labelled: label them, or check which ids the drive ignores"]
