import numpy as np
import pytest
from conftest import make_pose
from test_torch_geometry import MODELS, incidence, make_camera

from semcal_cli.config import PnpConfig
from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.errors import CalibrationError
from semcal_cli.estimation.search.pnp import solve_pnp

ROUND_OFF = 1e-5
NOISE = 5e-3  # about five standard errors of a translation from 400 points with noise of a centimetre
POSE = make_pose((0.3, -1.1, 0.2), (0.4, -0.2, 0.5))


def pairs(camera: Camera, count: int) -> tuple[np.ndarray, np.ndarray]:
    points_camera = np.random.default_rng(2).uniform([-6.0, -4.0, 6.0], [6.0, 4.0, 30.0], (count, 3))
    return in_lidar(points_camera), core_camera(camera).project(points_camera)


def in_lidar(points_camera: np.ndarray) -> np.ndarray:
    return (points_camera - POSE[:3, 3]) @ POSE[:3, :3]


def wrong_pixels(count: int) -> np.ndarray:
    return np.random.default_rng(1).uniform([0.0, 0.0], [1279.0, 719.0], (count, 2))


@pytest.mark.parametrize("name", MODELS)
def test_a_third_of_wrong_pairs_changes_nothing(name: str) -> None:
    camera = make_camera(name)
    points, pixels = pairs(camera, 300)
    pixels[::3] = wrong_pixels(100)
    T_camera_lidar, num_inliers = solve_pnp(points, pixels, camera, PnpConfig(max_error_deg=0.2))
    np.testing.assert_allclose(T_camera_lidar, POSE, atol=ROUND_OFF)
    assert 200 <= num_inliers < 205


@pytest.mark.parametrize("name", ["fisheye", "omnidirectional", "equirectangular", "fov", "double_sphere"])
@pytest.mark.parametrize("least_deg", [0.0, 80.0])
def test_pairs_all_round_and_beside_the_camera(name: str, least_deg: float) -> None:
    """Also where a pinhole sees nothing: from 80 degrees to the lens's limit."""
    camera = make_camera(name)
    points_camera = np.random.default_rng(3).uniform(-20.0, 20.0, (3000, 3))
    angles = incidence(points_camera)
    within = (np.degrees(angles) >= least_deg) & (angles < 0.98 * core_camera(camera).limit)
    points_camera = points_camera[within][:600]
    pixels = core_camera(camera).project(points_camera)
    pixels[::3] = wrong_pixels(len(pixels[::3]))
    noise = np.random.default_rng(4).normal(0.0, 0.01, points_camera.shape)
    T_camera_lidar, num_inliers = solve_pnp(in_lidar(points_camera + noise), pixels, camera, PnpConfig())
    np.testing.assert_allclose(T_camera_lidar, POSE, atol=NOISE)
    assert 0.65 * len(pixels) < num_inliers < 0.70 * len(pixels)


@pytest.mark.parametrize("name", ["no distortion", "fisheye"])
def test_too_few_pairs(name: str) -> None:
    camera = make_camera(name)
    points, pixels = pairs(camera, 11)
    with pytest.raises(CalibrationError, match="PnP: found 11 pairs, needed 12"):
        solve_pnp(points, pixels, camera, PnpConfig())


@pytest.mark.parametrize("name", ["no distortion", "fisheye"])
def test_pairs_without_a_pose(name: str) -> None:
    camera = make_camera(name)
    points, _ = pairs(camera, 200)
    pixels = np.random.default_rng(5).uniform([0.0, 0.0], [1279.0, 719.0], (200, 2))
    with pytest.raises(CalibrationError, match=r"PnP: found \d+ inliers, needed 50"):
        solve_pnp(points, pixels, camera, PnpConfig(max_error_deg=0.1, min_inliers=50))


@pytest.mark.parametrize("name", ["no distortion", "fisheye"])
def test_points_that_determine_no_pose(name: str) -> None:
    camera = make_camera(name)
    points, pixels = pairs(camera, 100)
    with pytest.raises(CalibrationError, match="PnP: "):
        solve_pnp(1e-20 * points, pixels, camera, PnpConfig())
