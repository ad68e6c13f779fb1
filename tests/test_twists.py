"""Twists, local coordinates and the baseline."""

import numpy as np
import pytest
from conftest import make_pose, poses, triples
from hypothesis import given
from scipy.spatial.transform import Rotation

from semcal_cli.errors import InputError
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import (
    baseline_m,
    camera_center,
    check_baseline,
    rotation_difference,
    within_baseline,
)
from semcal_cli.geometry.twists import (
    apply_twist,
    inverse_left_jacobian,
    local_coordinates,
    pose_at,
    rotation_matrix,
)

ROUND_OFF = 1e-9
STEP = 1e-6
POSE = make_pose((0.3, -1.1, 0.2), (0.4, -0.2, 0.5))


@given(T_reference=poses, rho=triples(10.0))
def test_a_pose_at_its_local_coordinates_is_itself(T_reference: Pose, rho: tuple[float, ...]) -> None:
    coordinates = np.array([*rho, 0.3, -0.2, 0.1])
    (again,) = local_coordinates([pose_at(T_reference, coordinates)], T_reference)
    np.testing.assert_allclose(again, coordinates, rtol=ROUND_OFF, atol=1e-6)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 9.9e-4, 1.1e-3, 1.0, 3.0, 7.0])
def test_a_rotation_matrix_is_scipys(angle: float) -> None:
    vector = angle * np.array([2.0, -1.0, 2.0]) / 3.0
    expected = Rotation.from_rotvec(vector).as_matrix()
    np.testing.assert_allclose(rotation_matrix(vector), expected, rtol=0.0, atol=1e-15)


def test_a_twist_is_the_local_coordinates_to_first_order() -> None:
    twist = STEP * np.array([1.0, -2.0, 3.0, -1.0, 2.0, 0.5])
    (found,) = local_coordinates([apply_twist(POSE, twist)], POSE)
    np.testing.assert_allclose(found, twist, atol=10.0 * STEP**2)


@pytest.mark.parametrize("angle", [0.0, 1e-5, 1e-3, 1.0, 3.0])
def test_the_inverse_jacobian_is_that_of_the_logarithm(angle: float) -> None:
    vector = angle * np.array([2.0, -1.0, 2.0]) / 3.0
    T = apply_twist(np.eye(4), np.array([0.0, 0.0, 0.0, *vector]))
    columns = [
        rotation_difference(apply_twist(T, STEP * axis), np.eye(4))
        - rotation_difference(apply_twist(T, -STEP * axis), np.eye(4))
        for axis in np.eye(6)[3:]
    ]
    np.testing.assert_allclose(inverse_left_jacobian(vector), np.array(columns).T / (2.0 * STEP), atol=1e-7)


def test_the_camera_is_drawn_towards_the_lidar_and_no_farther() -> None:
    far = baseline_m(POSE)
    held = within_baseline(POSE, 0.5 * far)
    assert baseline_m(held) == pytest.approx(0.5 * far)
    np.testing.assert_allclose(camera_center(held), 0.5 * camera_center(POSE))
    np.testing.assert_array_equal(within_baseline(POSE, far), POSE)


def test_a_camera_beyond_the_baseline_is_an_error() -> None:
    check_baseline("--init f", make_pose((0.0, 0.0, 0.0), (3.0, 4.0, 0.0)), 5.0)
    needed = (
        "--init f: found the camera 5 m from the LiDAR, needed at most 4 m; --max-baseline-m sets the limit"
    )
    with pytest.raises(InputError, match=needed):
        check_baseline("--init f", make_pose((0.0, 0.0, 0.0), (3.0, 4.0, 0.0)), 4.0)
