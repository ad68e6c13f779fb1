"""Twists (rho, phi): small motions on the left of T_camera_lidar, metres and radians along the camera's axes.

Source: Solà, Deray and Atchuthan, *A micro Lie theory for state estimation in robotics* (arXiv 1812.01537).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from semcal_cli.geometry.arrays import Matrix, Pose, TwistVector, Vector, Vectors
from semcal_cli.geometry.poses import camera_center, cross_matrix, rotation_difference

SMALL_ANGLE = 1e-4
"""Angle in radians below which the second-order term of the inverse Jacobian is smaller than the rounding."""
SMALL_TURN = 1e-3
"""Angle in radians up to which sin(angle / 2) / angle is computed by its series."""


def rotation_matrix(rotation_vector: Vector) -> Matrix:
    """Compute the matrix exp(phi), (3, 3), of a rotation vector in radians, by its unit quaternion.

    The arithmetic is SciPy's, without the time that SciPy takes to load.
    """
    x, y, z = rotation_vector.tolist()
    angle = math.sqrt(x * x + y * y + z * z)
    square = angle * angle
    small = 0.5 - square / 48.0 + square * square / 3840.0
    scale = math.sin(angle / 2.0) / angle if angle > SMALL_TURN else small
    x, y, z, w = scale * x, scale * y, scale * z, math.cos(angle / 2.0)
    return np.array(
        [
            [x * x - y * y - z * z + w * w, 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), -x * x + y * y - z * z + w * w, 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), -x * x - y * y + z * z + w * w],
        ]
    )


def apply_twist(T: Pose, twist: TwistVector) -> Pose:
    """Rotate a pose by exp(phi), then shift it by rho. This equals exp(xi) T to first order."""
    return apply_motion(T, rotation_matrix(twist[3:]), twist[:3])


def adjoint(T: Pose) -> Matrix:
    """Compute the adjoint (6, 6) of a transform (4, 4): T exp(xi) = exp(Ad xi) T with xi = (rho, phi)."""
    R = T[:3, :3]
    return np.block([[R, cross_matrix(T[:3, 3]) @ R], [np.zeros((3, 3)), R]])


def displace(T: Pose, angle_deg: float, distance_m: float, rng: np.random.Generator) -> Pose:
    """Turn a camera by an angle about a random axis, and move its centre by a distance in a random direction."""
    axis, direction = rng.standard_normal((2, 3))
    rotation = rotation_matrix(np.radians(angle_deg) * axis / np.linalg.norm(axis))
    moved: Pose = np.eye(4)
    moved[:3, :3] = rotation @ T[:3, :3]
    center = camera_center(T) + distance_m * direction / np.linalg.norm(direction)
    moved[:3, 3] = -moved[:3, :3] @ center
    return moved


def apply_motion(T: Pose, rotation: Matrix, translation: Vector) -> Pose:
    """Apply a rotation (3, 3), then a translation (3,), on the left of a pose."""
    moved: Pose = np.eye(4)
    moved[:3, :3] = rotation @ T[:3, :3]
    moved[:3, 3] = rotation @ T[:3, 3] + translation
    return moved


def inverse_left_jacobian(rotation_vector: Vector) -> Matrix:
    """Compute J_l^-1 of SO(3), (3, 3): the change of log(exp(delta) R) with delta (Solà et al., eq. 146)."""
    cross = cross_matrix(rotation_vector)
    angle = float(np.linalg.norm(rotation_vector))
    if angle < SMALL_ANGLE:
        return np.eye(3) - 0.5 * cross
    factor = 1.0 / angle**2 - (1.0 + np.cos(angle)) / (2.0 * angle * np.sin(angle))
    return np.asarray(np.eye(3) - 0.5 * cross + factor * cross @ cross)


def local_coordinates(poses: Sequence[Pose], T_reference: Pose) -> Vectors:
    """Compute local coordinates (N, 6), (rho, phi), of poses about a reference, which are twists to first order.

    With the camera centre c, rho = -R_ref (c - c_ref) and phi = log(R R_ref^T).
    """
    T, R_reference = np.asarray(poses), T_reference[:3, :3]
    centers = -np.einsum("nji,nj->ni", T[:, :3, :3], T[:, :3, 3])
    turns = [rotation_difference(pose, T_reference) for pose in T]
    return np.hstack([(camera_center(T_reference) - centers) @ R_reference.T, turns])


def camera_motions(coordinates: Vectors) -> Vectors:
    """Convert local coordinates (N, 6) to motions (N, 6) of the camera along and about its axes, metres and degrees.

    A twist on the left of T_camera_lidar moves the camera by the opposite twist.
    """
    return np.hstack([-coordinates[:, :3], -np.degrees(coordinates[:, 3:])])


def pose_at(T_reference: Pose, coordinates: TwistVector) -> Pose:
    """Compute the pose (4, 4) that has these local coordinates about a reference."""
    T: Pose = np.eye(4)
    T[:3, :3] = rotation_matrix(coordinates[3:]) @ T_reference[:3, :3]
    T[:3, 3] = -T[:3, :3] @ (camera_center(T_reference) - T_reference[:3, :3].T @ coordinates[:3])
    return T
