"""What is said of a pose by itself: its distance, the motion, and other seeds."""

import numpy as np
import pytest
from conftest import make_pose
from scipy.spatial.transform import Rotation

from semcal_cli import core
from semcal_cli.checks.families import check_pose
from semcal_cli.checks.folds_disagree import CHANCE, compare_folds
from semcal_cli.checks.motion_unstated import check_motion
from semcal_cli.checks.seeds import compare_seeds
from semcal_cli.findings.finding import Finding
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import camera_center
from semcal_cli.observations.observations import Observations
from semcal_cli.pipeline.cross_validation import split_scenes
from semcal_cli.result.sections import CrossValidation
from semcal_cli.result.uncertainty import Uncertainty


def test_motion_and_limits_that_hold_a_pose_are_said(
    street_observations: Observations, street_truth: Pose
) -> None:
    assert check_motion(None) == check_motion(3.0) == ()
    (moved,) = check_motion(7.04)
    assert moved.sentence == (
        "the LiDAR's motion is not compensated, so half of the points are off by 7.0 pixels or more (limit 3): "
        "run `semcal odometry DRIVE`, give motion.poses or motion.twist, or write `motion: {speed_m_s: 0"
        "}` if the rig stood still"
    )
    agreement = core.agreement(street_observations.core, street_truth)
    T = np.eye(4)
    T[:3, 3] = [0.0, 0.9, 0.0]
    assert check_pose(T, agreement, 1.0) == ()
    (held,) = check_pose(T, agreement, 0.9)
    assert held.sentence.startswith("the camera reached 0.9 m from the LiDAR, the limit of --max-baseline-m")


def test_seeds_that_lead_elsewhere_are_said() -> None:
    stated = Uncertainty(
        covariance=((0.0,) * 6,) * 6,
        degrees_of_freedom=(9.0,) * 6,
        sigma_camera_center_m=(0.1,) * 3,
        sigma_translation_m=(0.1,) * 3,
        sigma_rotation_deg=(0.5,) * 3,
        half_width_95_camera_center_m=(0.3, 0.2, 0.0),
        half_width_95_rotation_deg=(1.0,) * 3,
    )
    T = make_pose((0.3, -1.2, 0.5), (0.4, -0.2, 0.1))
    moved = make_pose((0.0, 0.0, 0.0), (-0.2, 0.0, 0.0)) @ T
    turned = T.copy()
    turned[:3, :3] = Rotation.from_euler("z", 1.5, degrees=True).as_matrix() @ T[:3, :3]
    turned[:3, 3] = -turned[:3, :3] @ camera_center(T)
    found, findings = compare_seeds(T, [moved, None, turned], stated)
    assert [finding.found for finding in findings] == [
        "1 of 4 seeds failed",
        "1 of 4 seeds ended outside the 95 % interval, up to 20 cm and 1.5 degrees away",
    ]
    assert (found.num_seeds, found.num_failed) == (4, 1)
    assert found.spread_camera_center_m == pytest.approx((np.std([0.0, 0.2, 0.0], ddof=1), 0.0, 0.0))
    assert found.spread_rotation_deg == pytest.approx((0.0, 0.0, np.std([0.0, 0.0, 1.5], ddof=1)))
    assert found.farthest_camera_center_m == pytest.approx(0.2)
    assert found.farthest_rotation_deg == pytest.approx(1.5)
    # Of 30 cm along x the clock, which all seeds share, makes 25.
    of_clock = np.diag([(0.25 / 1.96) ** 2, 0.0, 0.0, 0.0, 0.0, 0.0])
    _, (alone,) = compare_seeds(T, [moved], stated, of_clock)
    assert alone.found == "1 of 2 seeds ended outside the 95 % interval, up to 20 cm and 0 degrees away"
    assert compare_seeds(T, [moved], stated)[1] == ()
    none, findings = compare_seeds(T, [None], None)
    assert (none.num_failed, none.spread_camera_center_m, len(findings)) == (1, None, 1)


def test_folds_share_no_scene_and_are_about_as_long() -> None:
    scenes = [0, 0, 0, 3, 4, 5, 5, 7]
    folds = split_scenes(scenes, 2)
    assert sorted(frame for fold in folds for frame in fold) == list(range(8))
    assert [len(fold) for fold in folds] == [4, 4]
    assert not {scenes[frame] for frame in folds[0]} & {scenes[frame] for frame in folds[1]}


def test_folds_that_differ_by_chance_pass_and_others_are_said() -> None:
    rng, sigmas = np.random.default_rng(3), np.full((3, 6), (0.01, 0.02, 0.01, 0.1, 0.05, 0.2))

    def compared(scale: float) -> tuple[CrossValidation, tuple[Finding, ...]]:
        return compare_folds(scale * sigmas * rng.normal(size=sigmas.shape), sigmas, np.full((3, 6), 25.0))

    by_chance = [compared(1.0) for _ in range(400)]
    pulls = [result.pulls for result, _ in by_chance if result.pulls is not None]
    assert len(pulls) == 400
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(pulls), axis=0)), 1.0, atol=0.1)
    assert sum(bool(findings) for _, findings in by_chance) <= 2.5 * CHANCE * 400
    told = [findings for _, findings in (compared(6.0) for _ in range(40)) if findings]
    assert len(told) >= 36
    assert all("3 parts of the drive differ " in finding.sentence for (finding,) in told)
    lost, findings = compare_folds(np.zeros((1, 6)), sigmas[:1], np.ones((1, 6)), 1)
    assert (lost.num_folds, lost.num_failed, lost.pulls, findings) == (2, 1, None, ())
    exact = np.hstack([np.zeros((3, 1)), sigmas[:, 1:]])
    known, findings = compare_folds(exact * rng.normal(size=exact.shape), exact, np.full((3, 6), 25.0))
    assert known.pulls is not None
    assert (known.pulls[0], findings) == (0.0, ())
