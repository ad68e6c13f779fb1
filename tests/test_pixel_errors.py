"""Errors in the image: against samples, closed forms and the headline, for plane and wide lenses."""

import math
from pathlib import Path

import numpy as np
import pytest
from conftest import make_pose

from semcal_cli.drive.camera import Camera, IntrinsicsSigma, core_camera
from semcal_cli.geometry.twists import apply_motion, apply_twist, rotation_matrix
from semcal_cli.result.calibration_document import read_calibration
from semcal_cli.result.pixel_errors import (
    ELLIPSE_95,
    RANGES_M,
    PixelMap,
    difference_maps,
    half_axes_px,
    summarise,
    uncertainty_maps,
)
from semcal_cli.result.uncertainty import Uncertainty, stated_error

F, CX, CY = 500.0, 330.0, 230.0
K = ((F, 0.0, CX), (0.0, F, CY), (0.0, 0.0, 1.0))
ROUND = 640.0 / (2.0 * math.pi)
PINHOLE = Camera(model="plumb_bob", width=640, height=480, K=K)
CAMERAS = {
    "pinhole": PINHOLE,
    "distorted": Camera(
        model="plumb_bob", width=640, height=480, K=K, distortion=(-0.2, 0.05, 1e-3, -1e-3, 0.0)
    ),
    "fisheye": Camera(
        model="fisheye", width=640, height=480, K=((180.0, 0.0, CX), (0.0, 180.0, CY), (0.0, 0.0, 1.0))
    ),
    "panorama": Camera(
        model="equirectangular",
        width=640,
        height=320,
        K=((ROUND, 0.0, 319.5), (0.0, ROUND, 159.5), (0.0, 0.0, 1.0)),
    ),
}
SIGMA_M, SIGMA_RAD = 0.004, math.radians(0.04)
NUM_SAMPLES = 40_000
SAMPLING = 0.02
"""Five standard errors of a standard deviation of so many samples, 1 / sqrt(2 n)."""

DIFFERENCES = 1e-3
"""Relative error of differences half a pixel from a pole, where the derivatives change most."""


def random_covariance() -> np.ndarray:
    """A covariance whose axes are correlated."""
    factor = np.random.default_rng(1).standard_normal((6, 6))
    scales = np.array([SIGMA_M] * 3 + [SIGMA_RAD] * 3)
    return np.outer(scales, scales) * (factor @ factor.T) / 6.0


def only(axis: int, sigma: float) -> np.ndarray:
    """The covariance of one axis of the twist."""
    covariance = np.zeros((6, 6))
    covariance[axis, axis] = sigma**2
    return covariance


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("range_m", RANGES_M)
def test_poses_of_a_sample_put_the_points_as_far_off_as_is_said(name: str, range_m: float) -> None:
    """In the worst direction; the circle of that radius holds at least 95 % of them, and its ellipse just so many."""
    camera, covariance, rng = CAMERAS[name], random_covariance(), np.random.default_rng(0)
    pixels = np.array([[CX, CY], [40.0, 60.0], [600.0, 280.0]])
    points = range_m * core_camera(camera).unproject(pixels)
    stated = half_axes_px(camera, covariance, points)
    twists = rng.multivariate_normal(np.zeros(6), covariance, NUM_SAMPLES)
    poses = np.array([apply_twist(np.eye(4), twist) for twist in twists])
    for point, pixel, half_axis in zip(points, pixels, stated, strict=True):
        moved = np.ascontiguousarray(poses[:, :3, :3] @ point + poses[:, :3, 3])
        offsets = core_camera(camera).project(moved) - pixel
        if name == "panorama":
            offsets[:, 0] *= math.cos((pixel[1] - 159.5) / ROUND)
        scatter = offsets.T @ offsets / NUM_SAMPLES
        worst_px = ELLIPSE_95 * math.sqrt(np.linalg.eigvalsh(scatter)[-1])
        assert half_axis == pytest.approx(worst_px, rel=SAMPLING)
        distances = np.einsum("ni,ij,nj->n", offsets, np.linalg.inv(scatter), offsets)
        assert np.mean(distances < ELLIPSE_95**2) == pytest.approx(0.95, abs=0.005)
        assert np.mean(np.linalg.norm(offsets, axis=1) < half_axis) > 0.945


def test_errors_of_intrinsics_move_the_points_and_the_pose() -> None:
    """A sample of wrong K, each with the pose that it leads to: where the two together put the points."""
    covariance, rng = random_covariance(), np.random.default_rng(1)
    sigma = IntrinsicsSigma(fx=0.8, fy=0.6, cx=1.5, cy=1.0)
    camera = PINHOLE.model_copy(update={"intrinsics_sigma": sigma})
    twist = np.linalg.cholesky(covariance) @ rng.standard_normal((6, 4))
    pixels = np.array([[CX, CY], [40.0, 60.0], [600.0, 280.0]])
    points = 10.0 * core_camera(camera).unproject(pixels)
    stated = half_axes_px(camera, covariance + twist @ twist.T, points, twist)
    errors = rng.standard_normal((NUM_SAMPLES, 4))
    twists = rng.multivariate_normal(np.zeros(6), covariance, NUM_SAMPLES) + errors @ twist.T
    fx, fy, cx, cy = (np.array([F, F, CX, CY]) + errors * [sigma.fx, sigma.fy, sigma.cx, sigma.cy]).T
    for point, pixel, half_axis in zip(points, pixels, stated, strict=True):
        x, y, z = (point + twists[:, :3] + np.cross(twists[:, 3:], point)).T
        offsets = np.stack([fx * x / z + cx, fy * y / z + cy], axis=1) - pixel
        scatter = offsets.T @ offsets / NUM_SAMPLES
        assert half_axis == pytest.approx(
            ELLIPSE_95 * math.sqrt(np.linalg.eigvalsh(scatter)[-1]), rel=SAMPLING
        )


def test_errors_of_a_panorama_count_along_its_sphere() -> None:
    """An error of cx moves points as a turn about the axis does, by less towards the poles, and undoes such a turn."""
    sigma = IntrinsicsSigma(fx=0.0, fy=0.0, cx=2.0, cy=0.0)
    camera = CAMERAS["panorama"].model_copy(update={"intrinsics_sigma": sigma})
    points = 10.0 * core_camera(camera).unproject(np.array([[40.0, 60.0], [319.5, 159.5], [600.0, 280.0]]))
    twist = np.zeros((6, 4))
    twist[4, 2] = 2.0 / ROUND
    along, against = (half_axes_px(camera, twist @ twist.T, points, sign * twist) for sign in (1.0, -1.0))
    np.testing.assert_allclose(along, 2.0 * half_axes_px(camera, twist @ twist.T, points), rtol=DIFFERENCES)
    np.testing.assert_allclose(against, 0.0, atol=1e-3)


def radii(error_map: PixelMap) -> np.ndarray:
    """Distances of the nodes from the principal point, pixels."""
    u, v = np.meshgrid(error_map.columns, error_map.rows)
    return np.hypot(u - CX, v - CY)


def test_a_roll_moves_points_in_proportion_to_their_distance_from_the_middle() -> None:
    """At every range alike."""
    for error_map in uncertainty_maps(PINHOLE, only(5, SIGMA_RAD)):
        np.testing.assert_allclose(error_map.errors_px, ELLIPSE_95 * SIGMA_RAD * radii(error_map), rtol=1e-6)
        assert error_map.ahead_px == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_shift_counts_by_the_depth_of_points(axis: int) -> None:
    for error_map in uncertainty_maps(PINHOLE, only(axis, SIGMA_M)):
        depths_m = error_map.range_m / np.hypot(1.0, radii(error_map) / F)
        np.testing.assert_allclose(error_map.errors_px, ELLIPSE_95 * SIGMA_M * F / depths_m, rtol=1e-6)
        assert error_map.ahead_px == pytest.approx(ELLIPSE_95 * SIGMA_M * F / error_map.range_m)


def test_borders_and_poles_of_a_panorama_are_no_exception() -> None:
    """A turn about its axis moves all points of a row alike, by less towards the poles; also across the seam."""
    camera = CAMERAS["panorama"]
    turn = apply_motion(np.eye(4), rotation_matrix(np.array([0.0, 3.0 / ROUND, 0.0])), np.zeros(3))
    all_maps = {
        ELLIPSE_95 * SIGMA_RAD * ROUND: uncertainty_maps(camera, only(4, SIGMA_RAD)),
        3.0: difference_maps((np.eye(4), camera), (turn, camera)),
    }
    for at_horizon, maps in all_maps.items():
        for error_map in maps:
            of_rows = at_horizon * np.cos((error_map.rows[:, None] - 159.5) / ROUND)
            expected = np.broadcast_to(of_rows, error_map.errors_px.shape)
            np.testing.assert_allclose(error_map.errors_px, expected, rtol=DIFFERENCES)


def test_corners_that_a_lens_does_not_show_have_no_error() -> None:
    camera = CAMERAS["fisheye"].model_copy(update={"distortion": (-0.05, 0.0, 0.0, 0.0)})
    error_map, *_ = uncertainty_maps(camera, random_covariance())
    nodes = np.stack(np.meshgrid(error_map.columns, error_map.rows), axis=-1).reshape(-1, 2)
    is_shown = (
        np.isfinite(core_camera(camera).unproject(nodes)).all(axis=1).reshape(error_map.errors_px.shape)
    )
    assert np.isfinite(error_map.errors_px[is_shown]).mean() > 0.99
    assert not np.isfinite(error_map.errors_px[~is_shown]).any()


def test_the_map_and_the_headline_say_one_thing() -> None:
    """Few degrees of freedom widen both."""
    uncertainty = Uncertainty.from_covariance(np.eye(4), random_covariance(), np.full(6, 4.0)).with_pixels(
        PINHOLE
    )
    at_10_m = uncertainty.in_image[RANGES_M.index(10.0)]
    assert at_10_m.ahead_px is not None
    assert f"or {at_10_m.ahead_px:.1f} px at 10 m" in stated_error(uncertainty, PINHOLE)
    (plain,) = half_axes_px(PINHOLE, random_covariance(), np.array([[0.0, 0.0, 10.0]]))
    # Student's t: 2.776 with four degrees of freedom instead of 1.960.
    assert at_10_m.ahead_px == pytest.approx(2.7764451 / 1.959964 * plain)
    assert at_10_m.median_px < at_10_m.worst_px


def test_a_result_states_its_errors_in_the_image(made: Path) -> None:
    """Those of the camera that it belongs to."""
    record = read_calibration(made / "c.yaml")
    assert record.uncertainty is not None
    assert [errors.range_m for errors in record.uncertainty.in_image] == [*RANGES_M]
    without = record.uncertainty.model_copy(update={"in_image": ()})
    assert without.with_pixels(record.used_camera) == record.uncertainty


def test_the_difference_of_two_calibrations_is_that_of_their_points() -> None:
    T = make_pose((0.1, -0.2, 0.3), (1.2, -1.2, 1.2))
    angle_rad, shift_m = math.radians(0.3), 0.02
    rolled = apply_motion(T, rotation_matrix(np.array([0.0, 0.0, angle_rad])), np.zeros(3))
    shifted = apply_motion(T, np.eye(3), np.array([shift_m, 0.0, 0.0]))
    other_lens = PINHOLE.model_copy(update={"K": ((F, 0.0, CX + 3.0), (0.0, F, CY), (0.0, 0.0, 1.0))})
    for error_map in difference_maps((T, PINHOLE), (rolled, PINHOLE)):
        expected = 2.0 * math.sin(angle_rad / 2.0) * radii(error_map)
        np.testing.assert_allclose(error_map.errors_px, expected, rtol=1e-9, atol=1e-9)
    for error_map in difference_maps((T, PINHOLE), (shifted, PINHOLE)):
        assert error_map.ahead_px == pytest.approx(shift_m * F / error_map.range_m)
    for error_map in difference_maps((T, PINHOLE), (T, other_lens)):
        np.testing.assert_allclose(error_map.errors_px, 3.0, rtol=1e-9)


def test_the_frame_of_the_lidar_does_not_matter() -> None:
    T, S = make_pose((0.1, -0.2, 0.3), (1.2, -1.2, 1.2)), make_pose((1.0, 2.0, -3.0), (0.4, 0.5, -0.6))
    other = apply_twist(T, np.full(6, 0.01))
    before = difference_maps((T, PINHOLE), (other, PINHOLE))
    after = difference_maps((T @ S, PINHOLE), (other @ S, PINHOLE))
    for a, b in zip(before, after, strict=True):
        np.testing.assert_allclose(a.errors_px, b.errors_px, rtol=1e-9)


def test_cameras_that_look_elsewhere_have_nothing_in_common() -> None:
    back = apply_motion(np.eye(4), rotation_matrix(np.array([0.0, math.pi, 0.0])), np.zeros(3))
    maps = difference_maps((np.eye(4), PINHOLE), (back, PINHOLE))
    assert all(error_map.is_empty for error_map in maps)
    assert summarise(maps) == ()
