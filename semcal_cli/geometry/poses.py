"""Rigid transforms as 4 x 4 matrices, `p_a = T_a_b @ p_b`, float64, metres, and the difference of two of them.

The core computes what every calibration needs, because loading SciPy takes longer than many stages.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from semcal_cli import core
from semcal_cli.errors import InputError
from semcal_cli.geometry.arrays import Matrix, Pose, Vector

RIGID_TOLERANCE = 1e-3
"""Maximum error of a rotation written by hand: three or four decimals pass, a wrong matrix does not."""

ROUND_OFF = 1e-12
"""Maximum error of a rotation that a program computed and wrote to the last bit."""

MIN_COS_PITCH = 1e-7
"""Cosine of the pitch below which roll and yaw turn about the same axis."""

OPTICAL_AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Rotation from a camera's optical frame (right, down, forward) to its body frame (forward, left, up)."""


def check_rigid(T: Pose) -> None:
    """Check that a matrix is a rigid transform, to `RIGID_TOLERANCE`.

    Args:
        T: (4, 4), finite.

    Raises:
        ValueError: the last row is not 0 0 0 1, or the upper left 3 x 3 block is not a rotation.
    """
    if T[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise ValueError(f"found last row {T[3].tolist()}, needed [0, 0, 0, 1]")
    with np.errstate(all="ignore"):
        determinant, residual = np.linalg.det(T[:3, :3]), _residual(T)
    if not (determinant > 0.0 and residual <= RIGID_TOLERANCE):
        raise ValueError(
            f"found determinant {determinant:.6g} and R R^T off the identity by {residual:.2g}, "
            f"expected a rotation: determinant 1 and R R^T within {RIGID_TOLERANCE} of the identity"
        )


def as_transform(value: ArrayLike, name: str) -> Pose:
    """Copy a rigid transform that a program passes, and remove its rounding.

    Args:
        value: (4, 4) numbers.
        name: Name of the transform in messages.

    Raises:
        InputError: it is not a rigid transform.
    """
    try:
        is_complex = np.iscomplexobj(value)  # NumPy would drop the imaginary parts with a warning
        T: Pose | None = None if is_complex else np.array(value, np.float64)
    except (TypeError, ValueError):
        T = None
    if T is None:
        raise InputError(f"{name}: found no array of real numbers, expected a 4 x 4 matrix")
    if T.shape != (4, 4):
        raise InputError(f"{name}: found shape {T.shape}, expected a 4 x 4 matrix")
    if not np.isfinite(T).all():
        raise InputError(f"{name}: found values that are not finite, expected a rigid transform")
    try:
        check_rigid(T)
    except ValueError as error:
        raise InputError(f"{name}: {error}") from None
    return orthonormal(T)


def _residual(T: Pose) -> float:
    """Compute the maximum difference of R R^T from the identity."""
    return float(np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max())


def orthonormal(T: Pose) -> Pose:
    """Remove the rounding of a rotation that `check_rigid` accepts; one within `ROUND_OFF` is returned unchanged."""
    return T if _residual(T) <= ROUND_OFF else nearest_rigid(T)


def nearest_rigid(T: Pose) -> Pose:
    """Replace an approximate rotation by the nearest rotation (orthogonal Procrustes, by SVD)."""
    U, _, Vt = np.linalg.svd(T[:3, :3])
    rigid: Pose = T.copy()
    rigid[:3, :3] = U @ Vt
    return rigid


def pose_from_quaternion(quaternion_xyzw: Sequence[float], translation: Sequence[float]) -> Pose:
    """Build a transform from a unit quaternion and a translation in metres.

    Raises:
        ValueError: the quaternion's norm is not 1 within `RIGID_TOLERANCE`.
    """
    norm = math.hypot(*quaternion_xyzw)
    if not abs(norm - 1.0) <= RIGID_TOLERANCE:
        raise ValueError(f"found a quaternion of norm {norm:.6g}, needed norm 1 within {RIGID_TOLERANCE}")
    from scipy.spatial.transform import Rotation

    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(quaternion_xyzw).as_matrix()
    T[:3, 3] = translation
    return T


def pose_from_mounting(rpy_deg: Sequence[float], center_m: Sequence[float]) -> Pose:
    """Build T_camera_lidar from the mounting of a camera as measured by hand.

    Args:
        rpy_deg: Roll, pitch and yaw of the camera's body frame (x forward, y left, z up) in the LiDAR frame, as in
            URDF: R = Rz(yaw) Ry(pitch) Rx(roll). Yaw turns to the left, pitch looks down, roll leans to the right.
        center_m: (3,) camera centre in the LiDAR frame, metres.
    """
    from scipy.spatial.transform import Rotation

    T_lidar_camera = np.eye(4)
    T_lidar_camera[:3, :3] = Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix() @ OPTICAL_AXES
    T_lidar_camera[:3, 3] = center_m
    return inverse(T_lidar_camera)


def mounting_rpy_deg(T_camera_lidar: Pose) -> Vector:
    """Compute roll, pitch and yaw (3,) of a camera's body frame in the LiDAR frame: see `pose_from_mounting`."""
    T_lidar_body = inverse(T_camera_lidar)
    T_lidar_body[:3, :3] = T_lidar_body[:3, :3] @ OPTICAL_AXES.T
    return np.degrees(rpy(T_lidar_body))


def rpy(T: Pose) -> list[float]:
    """Compute roll, pitch and yaw of a pose (4, 4) or rotation (3, 3), radians, as in URDF.

    R = Rz(yaw) Ry(pitch) Rx(roll).
    """
    R = (T[:3, :3] + 0.0).tolist()  # no -0.0
    cos_pitch = math.hypot(R[0][0], R[1][0])
    pitch = math.atan2(0.0 - R[2][0], cos_pitch)
    if cos_pitch < MIN_COS_PITCH:  # Only the sum or difference of roll and yaw is defined.
        return [math.atan2(0.0 - R[1][2], R[1][1]), pitch, 0.0]
    return [math.atan2(R[2][1], R[2][2]), pitch, math.atan2(R[1][0], R[0][0])]


def rotation_vector_deg(T: Pose) -> Vector:
    """Compute the rotation vector (3,): its direction is the axis, its length the angle in degrees."""
    return np.degrees(rotation_difference(T, np.eye(4)))


def quaternion_xyzw(T: Pose) -> Vector:
    """Return the rotation as a unit quaternion (4,) with w >= 0."""
    return np.array(core.quaternion(T))


def inverse(T_a_b: Pose) -> Pose:
    """Invert a rigid transform: T_b_a."""
    T_b_a = np.eye(4)
    T_b_a[:3, :3] = T_a_b[:3, :3].T
    T_b_a[:3, 3] = -T_a_b[:3, :3].T @ T_a_b[:3, 3]
    return T_b_a


def cross_matrix(vector: Vector) -> Matrix:
    """Make the matrix (3, 3) [a]_x of the cross product, [a]_x b = a x b."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def camera_center(T_camera_lidar: Pose) -> Vector:
    """Compute the camera centre (3,) in the LiDAR frame, -R^T t, metres."""
    return inverse(T_camera_lidar)[:3, 3]


def rotation_difference(T_a: Pose, T_b: Pose) -> Vector:
    """Compute the rotation vector (3,) log(R_a R_b^T), radians, that takes T_b's rotation to T_a's."""
    *axis, w = quaternion_xyzw(T_a @ inverse(T_b))
    sine = math.hypot(*axis)
    scale = 2.0 * math.atan2(sine, w) / sine if sine > 0.0 else 2.0
    return scale * np.array(axis)


def rotation_error_deg(T_a: Pose, T_b: Pose) -> float:
    """Compute the geodesic angle between two rotations, in degrees."""
    return float(np.degrees(np.linalg.norm(rotation_difference(T_a, T_b))))


def baseline_m(T_camera_lidar: Pose) -> float:
    """Compute the distance between the camera centre and the origin of the LiDAR frame, metres."""
    x, y, z = T_camera_lidar[:3, 3].tolist()
    distance_m: float = (x * x + y * y + z * z) ** 0.5
    return distance_m


def within_baseline(T_camera_lidar: Pose, max_baseline_m: float) -> Pose:
    """Move the camera towards the LiDAR until it is within the maximum distance."""
    distance_m = baseline_m(T_camera_lidar)
    if distance_m <= max_baseline_m:
        return T_camera_lidar
    limited = T_camera_lidar.copy()
    limited[:3, 3] *= max_baseline_m / distance_m
    return limited


def check_baseline(name: str, T_camera_lidar: Pose, max_baseline_m: float) -> None:
    """Check that a transform puts the camera within the maximum distance from the LiDAR.

    Raises:
        InputError: the camera is farther away; the message begins with `name`.
    """
    distance_m = baseline_m(T_camera_lidar)
    if distance_m > max_baseline_m:
        raise InputError(
            f"{name}: found the camera {distance_m:g} m from the LiDAR, needed at most {max_baseline_m:g} m; "
            f"--max-baseline-m sets the limit"
        )


@dataclass(frozen=True)
class PoseError:
    """The difference of `T_camera_lidar` from `T_reference`, in radians and metres, and as it is printed."""

    rotation_rad: float
    """Geodesic angle between the rotations."""
    camera_center_m: float
    """Distance between the camera centres in the LiDAR frame."""
    rotation_xyz_rad: tuple[float, ...]
    """Rotation vector of R R_ref^T, along the axes of the camera."""
    camera_center_xyz_m: tuple[float, ...]
    """Camera centre minus reference centre, along the axes of the reference camera."""

    @property
    def offsets(self) -> Vector:
        """Differences along and about the axes of the camera (6,), metres and degrees, like intervals."""
        return np.array([*self.camera_center_xyz_m, *self.rotation_xyz_deg])

    @property
    def rotation_deg(self) -> float:
        """Geodesic angle between the rotations, to be printed."""
        return math.degrees(self.rotation_rad)

    @property
    def rotation_xyz_deg(self) -> tuple[float, ...]:
        """Rotation vector, to be printed."""
        return tuple(math.degrees(angle) for angle in self.rotation_xyz_rad)

    @property
    def camera_center_cm(self) -> float:
        """Distance between the camera centres, to be printed."""
        return 100.0 * self.camera_center_m

    @property
    def camera_center_xyz_cm(self) -> tuple[float, ...]:
        """Difference of the camera centres, to be printed."""
        return tuple(100.0 * length for length in self.camera_center_xyz_m)

    def is_within(self, angle_deg: float, distance_m: float) -> bool:
        """Whether the calibration is no farther off than an angle and a distance of the camera centre."""
        return self.rotation_deg <= angle_deg and self.camera_center_m <= distance_m

    def describe(self) -> dict[str, Any]:
        """Return the figures as documents and JSON have them, in degrees and centimetres."""
        return {
            "rotation_deg": self.rotation_deg,
            "camera_center_cm": self.camera_center_cm,
            "rotation_xyz_deg": list(self.rotation_xyz_deg),
            "camera_center_xyz_cm": list(self.camera_center_xyz_cm),
        }


def compare_poses(T_camera_lidar: Pose, T_reference: Pose) -> PoseError:
    """Measure a calibration against a reference; both map LiDAR to camera."""
    rotation_xyz_rad = rotation_difference(T_camera_lidar, T_reference)
    center_lidar_m = camera_center(T_camera_lidar) - camera_center(T_reference)
    return PoseError(
        rotation_rad=float(np.linalg.norm(rotation_xyz_rad)),
        camera_center_m=float(np.linalg.norm(center_lidar_m)),
        rotation_xyz_rad=tuple(rotation_xyz_rad.tolist()),
        camera_center_xyz_m=tuple((T_reference[:3, :3] @ center_lidar_m).tolist()),
    )
