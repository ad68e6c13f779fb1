"""Mistakes in writing or reading a transform that explain how far it is from an estimate."""

from __future__ import annotations

from typing import get_args

import numpy as np

from semcal_cli.config.directions import Direction
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import (
    OPTICAL_AXES,
    compare_poses,
    inverse,
    pose_from_quaternion,
    quaternion_xyzw,
)

SAME_DEG, SAME_M = 3.0, 0.3
"""Largest rotation and distance between the estimate and a transform after its supposed mistake is corrected."""
INVERSE = "the inverse, T_lidar_camera"
"""Mistake that the option for the direction corrects."""
DIRECTIONS: tuple[str, ...] = get_args(Direction)


def remedy(mistake: str, stated: InitialPose) -> str:
    """Describe how to correct a mistake that a transform looks like."""
    others = dict(zip(DIRECTIONS, DIRECTIONS[::-1], strict=True))
    if mistake.endswith(INVERSE) and stated.direction in others:
        return f"run again with --direction {others[stated.direction]}"
    return f"correct {stated.name}"


def likely_mistakes(T_stated: Pose, T_estimate: Pose) -> list[str]:
    """List the mistakes that explain the difference between a given transform (4, 4) and the estimate (4, 4)."""
    if compare_poses(T_stated, T_estimate).is_within(SAME_DEG, SAME_M):
        return []
    optical_body = np.eye(4)
    optical_body[:3, :3] = OPTICAL_AXES.T
    x, y, z, w = quaternion_xyzw(T_stated)
    center, place = T_stated.copy(), T_stated[:3, 3].tolist()
    center[:3, 3] = 0.001 * T_stated[:3, 3]
    poses_by_mistake = {
        INVERSE: inverse(T_stated),
        "T_body_lidar of a camera's body frame, x forward and z up": optical_body @ T_stated,
        "T_lidar_body of a camera's body frame, x forward and z up": optical_body @ inverse(T_stated),
        "a quaternion w x y z that was read as x y z w": pose_from_quaternion((y, z, w, x), place),
        "a quaternion x y z w that was read as w x y z": pose_from_quaternion((w, x, y, z), place),
        "a translation in millimetres": center,
    }
    return [
        f"this looks like {name}"
        for name, T in poses_by_mistake.items()
        if compare_poses(T, T_estimate).is_within(SAME_DEG, SAME_M)
    ]
