"""The evolution strategy that looks for higher maxima around a pose."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from semcal_cli import threads
from semcal_cli.estimation.refine.evolution import NUM_POSES, PATIENCE, evolve
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import camera_center, compare_poses
from semcal_cli.geometry.twists import pose_at

SHAPE = np.diag([1.0, 1.0, 9.0, 0.01, 0.01, 0.01])
SUMMIT = np.array([0.02, -0.03, 0.15, 0.003, -0.002, 0.001])


def rugged(T: Pose) -> float:
    """A hill whose summit is `SUMMIT`, 15 cm from the origin, with waves that stop whoever follows the slope."""
    away = compare_poses(T, pose_at(np.eye(4), SUMMIT))
    waves = np.cos(2.0 * np.pi * np.array(away.offsets) / [0.03, 0.03, 0.03, 0.1, 0.1, 0.1])
    return float(0.15 * waves.sum() - (away.camera_center_m / 0.1) ** 2 - (away.rotation_deg / 0.2) ** 2)


def is_at_summit(T: Pose) -> bool:
    away = compare_poses(T, pose_at(np.eye(4), SUMMIT))
    return away.camera_center_m < 0.04 and away.rotation_deg < 0.12


@pytest.mark.parametrize("seed", range(3))
def test_a_summit_beyond_waves_is_found_by_any_number_of_threads(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = evolve(rugged, np.eye(4), SHAPE, seed)
    assert is_at_summit(found)
    for num_threads in (1, 5):
        monkeypatch.setattr(threads, "_num_threads", num_threads)
        np.testing.assert_array_equal(evolve(rugged, np.eye(4), SHAPE, seed), found)


def test_the_slope_does_not_lead_there() -> None:
    end = minimize(lambda twist: -rugged(pose_at(np.eye(4), twist)), np.zeros(6), method="BFGS")
    assert not is_at_summit(pose_at(np.eye(4), end.x))


@pytest.mark.parametrize(("num_vain", "num_poses"), [(0, NUM_POSES), (1, 2 * NUM_POSES)])
def test_nothing_better_leaves_the_start(num_vain: int, num_poses: int) -> None:
    T, poses = pose_at(np.eye(4), SUMMIT), list[Pose]()

    def flat(pose: Pose) -> float:
        poses.append(pose)
        return 1.0

    assert evolve(flat, T, SHAPE, 0, num_vain) is T
    assert len(poses) == 1 + PATIENCE * num_poses
    # Poses spread farthest along the longest axis, forward.
    spread = np.std([camera_center(pose) for pose in poses[: 1 + num_poses]], axis=0)
    assert np.argmax(spread) == 2
