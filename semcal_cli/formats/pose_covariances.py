"""Poses of the camera in the LiDAR frame with their covariance, as ROS and GTSAM define it.

The uncertainty of semcal is that of a twist xi = (rho, phi) on the left of T_camera_lidar, along the camera's axes.
Since exp(xi) T_camera_lidar is the inverse of T_lidar_camera exp(-xi), it is the same twist on the right of
T_lidar_camera, with the opposite sign, which no covariance shows.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from semcal_cli.errors import InputError
from semcal_cli.formats.document_formats import entry_format, under
from semcal_cli.formats.format import FormatOptions, Source
from semcal_cli.formats.pose import XYZ, XYZW, MatrixNotation, NumbersNotation, rounded
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.geometry.poses import inverse

ROS, GTSAM = "pose-with-covariance", "gtsam"
ROS_POSE = NumbersNotation({"position": XYZ, "orientation": XYZW}, are_named=True)
GTSAM_POSE = MatrixNotation("T_lidar_camera")
TANGENT = "T_lidar_camera * Expmap(xi), xi = (rotation x y z, translation x y z) along the camera's axes"
"""What the covariance of GTSAM's file is of, in the file."""
ROTATION_FIRST = [3, 4, 5, 0, 1, 2]
"""GTSAM's order of a twist (rho, phi)."""


def ros_covariance(T_camera_lidar: Pose, covariance: Matrix) -> Matrix:
    """Compute the covariance of a geometry_msgs/PoseWithCovariance.

    Position and rotation are along and about the axes of the fixed frame, here the LiDAR's. The position is that of the
    camera itself, which its own rotation does not move. So this is not the adjoint, which would state how the origin of
    the fixed frame moves.

    Args:
        T_camera_lidar: (4, 4), metres.
        covariance: (6, 6) of xi = (rho, phi) on its left, metres and radians, along the camera's axes.

    Returns:
        (6, 6) of x, y, z and the rotation about X, Y, Z, metres and radians, in the LiDAR frame.
    """
    R_lidar_camera = T_camera_lidar[:3, :3].T
    turn = np.kron(np.eye(2), R_lidar_camera)
    turned = turn @ covariance @ turn.T
    return np.asarray(0.5 * (turned + turned.T))  # symmetric to the last bit


def gtsam_covariance(covariance: Matrix) -> Matrix:
    """Compute the covariance of a GTSAM Pose3 T_lidar_camera.

    Args:
        covariance: (6, 6) of xi = (rho, phi) on the left of T_camera_lidar, metres and radians, camera frame.

    Returns:
        (6, 6) of (rotation, translation) on the right of T_lidar_camera, radians and metres, along the camera's axes.
    """
    return covariance[np.ix_(ROTATION_FIRST, ROTATION_FIRST)]


def _covariance(name: str, options: FormatOptions) -> Matrix:
    """Return the covariance to write.

    Raises:
        InputError: none is known, or it is not believed.
    """
    if options.covariance is None:
        needed = "expected a calibration of semcal that states one and is trusted"
        raise InputError(f"{options.option('to')} {name}: found no uncertainty that is believed, {needed}")
    return options.covariance


def _make_ros(T_camera_lidar: Pose, options: FormatOptions) -> dict[str, Any]:
    covariance = ros_covariance(T_camera_lidar, _covariance(ROS, options))
    pose: dict[str, Any] = {}
    ROS_POSE.put(pose, inverse(T_camera_lidar))
    return {"pose": pose, "covariance": covariance.ravel().tolist()}


def _is_ros(source: Source) -> bool:
    pose = source.mapping.get("pose")
    return (
        "covariance" in source.mapping and isinstance(pose, dict) and {"position", "orientation"} <= {*pose}
    )


def _make_gtsam(T_camera_lidar: Pose, options: FormatOptions) -> dict[str, Any]:
    covariance = gtsam_covariance(_covariance(GTSAM, options))
    return {
        GTSAM_POSE.key: rounded(inverse(T_camera_lidar)),
        "tangent": TANGENT,
        "covariance": covariance.tolist(),
    }


POSE_WITH_COVARIANCE = entry_format(
    ROS,
    "p_lidar = T p_camera: pose.position, pose.orientation (x y z w) and covariance of a "
    "geometry_msgs/PoseWithCovariance, along and about the axes of the LiDAR",
    _is_ros,
    under("pose"),
    ROS_POSE,
    maps_camera=True,
    make=_make_ros,
)
POSE3 = entry_format(
    GTSAM,
    "p_lidar = T p_camera: T_lidar_camera and covariance of a GTSAM Pose3, rotation first, along the camera's axes",
    lambda source: {GTSAM_POSE.key, "tangent"} <= source.mapping.keys(),
    under(),
    GTSAM_POSE,
    maps_camera=True,
    make=_make_gtsam,
    as_json=True,
)
