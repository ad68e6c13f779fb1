"""The evolution strategy that looks for higher maxima around a pose."""

from __future__ import annotations

import numpy as np
import pytest

from semcal_cli.estimation.refine.evolution import evolve
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import pose_at

SHAPE = np.diag([1.0, 1.0, 9.0, 0.01, 0.01, 0.01])
SUMMIT = np.array([0.02, -0.03, 0.15, 0.003, -0.002, 0.001])


def rugged(T: Pose) -> float:
    """A hill whose summit is `SUMMIT`, with waves on its slopes that stop whoever follows them."""
    T_summit = pose_at(np.eye(4), SUMMIT)
    away = compare_poses(T, T_summit)
    waves = np.cos(np.radians(200.0) * np.array(away.offsets) / [0.01, 0.01, 0.01, 0.1, 0.1, 0.1])
    return float(0.03 * waves.sum() - (away.camera_center_m / 0.1) ** 2 - (away.rotation_deg / 0.2) ** 2)


@pytest.mark.parametrize("seed", range(3))
def test_a_summit_beyond_waves_is_found(seed: int) -> None:
    found = evolve(rugged, np.eye(4), SHAPE, seed)
    away = compare_poses(found, pose_at(np.eye(4), SUMMIT))
    assert away.camera_center_m < 0.03  # from 15 cm
    assert away.rotation_deg < 0.05
    np.testing.assert_array_equal(evolve(rugged, np.eye(4), SHAPE, seed), found)


def test_nothing_better_leaves_the_start() -> None:
    T = pose_at(np.eye(4), SUMMIT)
    assert evolve(lambda _: 1.0, T, SHAPE, 0) is T
