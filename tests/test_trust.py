from dataclasses import replace

import numpy as np
import pytest

from semcal_cli.classes import NO_CLASS
from semcal_cli.observations import Observations
from semcal_cli.poses import Pose
from semcal_cli.refinement import ExactClimb, ExactConfig, PyramidConfig, refine
from semcal_cli.trust import doubts


def test_a_good_drive_leaves_no_doubt(street_observations: Observations, street_truth: Pose) -> None:
    assert doubts(street_observations, street_truth) == []
    assert doubts(street_observations.of_frames([1]), street_truth) == []


def test_pictures_of_other_frames(street_observations: Observations, street_truth: Pose) -> None:
    images = list(street_observations.image_classes)
    exchanged = replace(street_observations, image_classes=images[1:] + images[:1])
    found = doubts(exchanged, street_truth)
    assert any(line.startswith("pictures of other frames fit the clouds almost as well: ") for line in found)


def test_frames_that_are_alike_are_not_held_against_a_pose(
    street_observations: Observations, street_truth: Pose
) -> None:
    standing = street_observations.of_frames([2, 2, 2])
    assert doubts(standing, street_truth) == []


def test_labels_that_tell_no_direction(street_observations: Observations, street_truth: Pose) -> None:
    rng = np.random.default_rng(0)
    shuffled = replace(
        street_observations, point_classes=[rng.permutation(ids) for ids in street_observations.point_classes]
    )
    found = doubts(shuffled, street_truth)
    assert any("degrees labels fit almost as well: " in line for line in found)


@pytest.mark.parametrize("scale", [0.9, 1.1])
def test_wrong_intrinsics_are_named(
    street_observations: Observations, street_truth: Pose, scale: float
) -> None:
    camera = street_observations.camera
    (fx, _, cx), (_, fy, cy), last = camera.K
    wrong = camera.model_copy(update={"K": ((fx * scale, 0.0, cx), (0.0, fy * scale, cy), last)})
    seen = replace(street_observations, camera=wrong)
    climbed = refine(
        seen, street_truth, ExactClimb(seen, ExactConfig(), 0), PyramidConfig(coarsest_block_deg=3.0)
    )
    (line,) = doubts(seen, climbed.T_camera_lidar)
    assert line.startswith("the intrinsics look wrong (fx by ")


def test_nothing_in_the_picture_is_no_crash(street_observations: Observations, street_truth: Pose) -> None:
    blank = [np.full_like(image, NO_CLASS) for image in street_observations.image_classes]
    assert doubts(replace(street_observations, image_classes=blank), street_truth) == []
