import numpy as np
import pytest
from conftest import make_pose, poses
from hypothesis import given
from scipy.spatial.transform import Rotation

from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import (
    camera_center,
    compare_poses,
    inverse,
    pose_from_quaternion,
    quaternion_xyzw,
    rotation_difference,
)

REFERENCE = make_pose((0.3, -1.0, 2.0), (0.4, -0.1, 0.2))
EXACT = 1e-9  # degrees or centimetres: round-off of poses within 100 m


@pytest.mark.parametrize(
    ("turn", "move", "rotation_deg", "center_cm"),
    [
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((0.0, np.radians(2.0), 0.0), (0.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 0.0)),
        # A camera that moves along its own +x sees every point move along -x.
        ((0.0, 0.0, 0.0), (-0.03, 0.0, 0.0), (0.0, 0.0, 0.0), (3.0, 0.0, 0.0)),
    ],
)
def test_a_camera_that_turns_or_moves_in_its_own_frame(
    turn: tuple[float, ...],
    move: tuple[float, ...],
    rotation_deg: tuple[float, ...],
    center_cm: tuple[float, ...],
) -> None:
    error = compare_poses(make_pose(turn, move) @ REFERENCE, REFERENCE)
    assert error.rotation_xyz_deg == pytest.approx(rotation_deg, abs=EXACT)
    assert error.camera_center_xyz_cm == pytest.approx(center_cm, abs=EXACT)
    assert error.rotation_deg == pytest.approx(max(rotation_deg), abs=EXACT)
    assert error.camera_center_cm == pytest.approx(max(center_cm), abs=EXACT)


@given(T=poses, T_reference=poses, T_lidar_world=poses)
def test_error_does_not_depend_on_the_lidar_frame(T: Pose, T_reference: Pose, T_lidar_world: Pose) -> None:
    error, moved = (
        compare_poses(T, T_reference),
        compare_poses(T @ T_lidar_world, T_reference @ T_lidar_world),
    )
    assert moved.rotation_deg == pytest.approx(error.rotation_deg, abs=1e-5)  # half a turn doubles back
    assert moved.camera_center_cm == pytest.approx(error.camera_center_cm, abs=EXACT)
    assert np.linalg.norm(error.rotation_xyz_deg) == pytest.approx(error.rotation_deg)
    assert np.linalg.norm(error.camera_center_xyz_cm) == pytest.approx(error.camera_center_cm)


@given(T_a=poses, T_b=poses)
def test_rotations_are_scipys(T_a: Pose, T_b: Pose) -> None:
    quaternion = Rotation.from_matrix(T_a[:3, :3]).as_quat(canonical=True)
    assert abs(quaternion @ quaternion_xyzw(T_a)) == pytest.approx(1.0, abs=1e-12)
    turn = Rotation.from_matrix(T_a[:3, :3] @ T_b[:3, :3].T)
    found = Rotation.from_rotvec(rotation_difference(T_a, T_b))
    assert (found * turn.inv()).magnitude() < 1e-7


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 1e-3, 3.0, np.pi - 1e-9])
def test_small_and_large_turns_are_told_exactly(angle: float) -> None:
    turned = make_pose((0.0, angle, 0.0), (0.0, 0.0, 0.0))
    np.testing.assert_allclose(
        rotation_difference(turned, np.eye(4)), [0.0, angle, 0.0], rtol=1e-8, atol=1e-16
    )


@given(T=poses)
def test_pose_algebra(T: Pose) -> None:
    np.testing.assert_allclose(T @ inverse(T), np.eye(4), atol=1e-12)
    np.testing.assert_allclose(T @ [*camera_center(T), 1.0], [0.0, 0.0, 0.0, 1.0], atol=1e-12)
    rebuilt = pose_from_quaternion(quaternion_xyzw(T).tolist(), T[:3, 3].tolist())
    np.testing.assert_allclose(rebuilt, T, atol=1e-12)
