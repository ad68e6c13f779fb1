import dataclasses
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from conftest import make_pose

from semcal_cli import core, pipeline
from semcal_cli.checks.families import check_stages
from semcal_cli.config import PolishConfig, PyramidConfig, RefinementConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.estimation.refine.polish import polish_pose, split
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.cues.segments import STARTS
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.observations import NO_CLASS, Observations

CONFIG = PolishConfig()
PIXEL_OFF = make_pose((0.002, -0.003, 0.002), (0.01, 0.01, -0.01))

# Three times what four frames of 640 x 360 were measured to end at.
MAX_ROTATION_DEG = 0.06
MAX_CENTER_CM = 1.0


@pytest.mark.parametrize("num_frames", [4, 1])
def test_a_pixel_off_ends_at_the_truth(
    street_observations: Observations, street_truth: Pose, num_frames: int
) -> None:
    """Held out are regions of the images."""
    few = street_observations.of_frames(range(num_frames))
    polished = polish_pose(few, PIXEL_OFF @ street_truth, CONFIG)
    assert polished.is_accepted
    assert polished.is_settled
    slack = 1.0 if num_frames == 4 else 4.0
    error = compare_poses(polished.T_camera_lidar, street_truth)
    assert error.rotation_deg < slack * MAX_ROTATION_DEG
    assert error.camera_center_cm < slack * MAX_CENTER_CM


def test_frames_are_held_out_where_there_are_enough(
    street_observations: Observations, street_truth: Pose
) -> None:
    config = dataclasses.replace(CONFIG, min_frames=3)
    kept, held_out = split(street_observations, config)
    assert (kept.num_frames, held_out.num_frames) == (3, 1)
    assert polish_pose(street_observations, PIXEL_OFF @ street_truth, config).is_accepted


def test_regions_that_are_held_out_are_whole(street_observations: Observations) -> None:
    kept, held_out = split(street_observations, CONFIG)
    for frames in zip(street_observations.images, kept.images, held_out.images, strict=True):
        whole, one, other = (image.classes for image in frames)
        assert not ((one != NO_CLASS) & (other != NO_CLASS)).any()
        np.testing.assert_array_equal(np.minimum(one, other), whole)
        assert 0.25 < (other != NO_CLASS).sum() / (whole != NO_CLASS).sum() < 0.42


@pytest.fixture(scope="module")
def torn(street_observations: Observations) -> Observations:
    """The kept frames are labelled as a turned camera would see them, the held-out one, the third, is not."""
    return street_observations.with_images(
        image if index == 2 else image.with_classes(np.roll(image.classes, 4, axis=1))
        for index, image in enumerate(street_observations.images)
    )


def test_held_out_data_reject_what_only_the_kept_data_like(torn: Observations, street_truth: Pose) -> None:
    config = dataclasses.replace(CONFIG, min_frames=3)
    polished = polish_pose(torn, street_truth, config)
    assert not polished.is_accepted
    (finding,) = check_stages(None, polished, None)
    assert re.match(
        r"the polish was rejected; held-out data agree \d+\.\d standard errors worse after it \(limit 3\): ",
        finding.sentence,
    )
    np.testing.assert_array_equal(polished.T_camera_lidar, street_truth)
    assert polished.held_out.held_out_sigma_nats is not None
    assert polished.held_out.held_out_gain_nats < -config.max_loss * polished.held_out.held_out_sigma_nats


def test_the_best_of_several_tops_may_lose_more(torn: Observations, street_truth: Pose) -> None:
    """Held-out data took part in its choice, so they lose by any other."""
    config = dataclasses.replace(CONFIG, min_frames=3)
    check = polish_pose(torn, street_truth, config).held_out
    assert check.held_out_sigma_nats is not None
    loss = -check.held_out_gain_nats / check.held_out_sigma_nats
    between = dataclasses.replace(config, max_loss=0.9 * loss, max_loss_of_tops=1.1 * loss)
    assert not polish_pose(torn, street_truth, between).is_accepted
    assert polish_pose(dataclasses.replace(torn, starts=STARTS), street_truth, between).is_accepted


@pytest.mark.parametrize("blank", [{0, 1, 3}, {2}])
def test_frames_without_labels_test_no_polish(
    street_observations: Observations, street_truth: Pose, blank: set[int]
) -> None:
    """All kept frames are blank, or all that are held out."""
    some = street_observations.with_images(
        image.with_classes(np.full_like(image.classes, NO_CLASS)) if index in blank else image
        for index, image in enumerate(street_observations.images)
    )
    polished = polish_pose(some, street_truth, dataclasses.replace(CONFIG, min_frames=3))
    assert str(polished.held_out.held_out_gain_nats) == "0.0"
    assert [finding.topic for finding in check_stages(None, polished, None)] == ["polish-not-tested"]


def test_threads_do_not_change_a_bit(street_observations: Observations, street_truth: Pose) -> None:
    found = []
    for num_threads in (1, 2):
        core.set_num_threads(num_threads)
        found.append(polish_pose(street_observations, PIXEL_OFF @ street_truth, CONFIG))
    np.testing.assert_array_equal(found[0].T_camera_lidar, found[1].T_camera_lidar)
    assert found[0].held_out == found[1].held_out


@pytest.mark.parametrize(
    ("accepted", "settled", "converged", "reasons"),
    [
        (True, True, True, []),
        (True, True, False, []),
        (True, False, True, ["the polish had not settled"]),
        (False, True, True, ["the polish was rejected"]),
        (False, False, True, ["the polish was rejected"]),
        (False, True, False, ["the polish was rejected", "the refinement had not settled"]),
    ],
)
def test_the_pose_that_counts_is_the_one_that_has_to_settle(
    street: Path,
    street_observations: Observations,
    street_truth: Pose,
    monkeypatch: pytest.MonkeyPatch,
    accepted: bool,
    settled: bool,
    converged: bool,
    reasons: list[str],
) -> None:
    # As if held-out data had to get better by a lot, and poses had to move by less than nothing.
    polish_config = PolishConfig(max_loss=3.0 if accepted else -1e6, settled_px=0.1 if settled else -1.0)
    pyramid = partial(PyramidConfig, max_final_drift=1e6 if converged else -1.0)
    monkeypatch.setattr(pipeline.pose_stages, "PyramidConfig", pyramid)
    data = LoadedDrive(read_drive(street), street_observations)
    initial = pipeline.start_at(data, InitialPose(street_truth, "truth"))
    stages = pipeline.refine_and_polish(data, initial, RefinementConfig(polish=polish_config))
    assert stages.refined is not None
    is_kept = np.array_equal(stages.T_camera_lidar, stages.refined.T_camera_lidar)
    assert is_kept != accepted
    assert len(stages.findings) == len(reasons)
    for finding, reason in zip(stages.findings, reasons, strict=True):
        assert finding.sentence.startswith(reason)
