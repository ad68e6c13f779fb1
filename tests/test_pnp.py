import numpy as np
import pytest
from conftest import make_pose
from test_projection import LENSES, K

from semcal_cli.camera import core_camera
from semcal_cli.drive import Camera
from semcal_cli.errors import CalibrationError
from semcal_cli.pnp import PnpConfig, solve_pnp

ROUND_OFF = 1e-5
POSE = make_pose((0.3, -1.1, 0.2), (0.4, -0.2, 0.5))


def pairs(camera: Camera, count: int) -> tuple[np.ndarray, np.ndarray]:
    points_camera = np.random.default_rng(2).uniform([-6.0, -4.0, 6.0], [6.0, 4.0, 30.0], (count, 3))
    pixels = core_camera(camera).project(points_camera)
    return (points_camera - POSE[:3, 3]) @ POSE[:3, :3], pixels


@pytest.mark.parametrize(("model", "distortion"), LENSES.values(), ids=LENSES.keys())
def test_a_third_of_wrong_pairs_changes_nothing(model: str, distortion: tuple[float, ...]) -> None:
    camera = Camera(model=model, width=1280, height=720, K=K, distortion=distortion)
    points, pixels = pairs(camera, 300)
    pixels[::3] = np.random.default_rng(1).uniform([0.0, 0.0], [1279.0, 719.0], (100, 2))
    T_camera_lidar, num_inliers = solve_pnp(points, pixels, camera, PnpConfig(max_error_deg=0.2))
    np.testing.assert_allclose(T_camera_lidar, POSE, atol=ROUND_OFF)
    assert 200 <= num_inliers < 205


def test_too_few_pairs() -> None:
    camera = Camera(model="plumb_bob", width=1280, height=720, K=K)
    points, pixels = pairs(camera, 11)
    with pytest.raises(CalibrationError, match="PnP: found 11 pairs, needed 12"):
        solve_pnp(points, pixels, camera, PnpConfig())


def test_pairs_without_a_pose() -> None:
    camera = Camera(model="plumb_bob", width=1280, height=720, K=K)
    points, _ = pairs(camera, 200)
    pixels = np.random.default_rng(5).uniform([0.0, 0.0], [1279.0, 719.0], (200, 2))
    with pytest.raises(CalibrationError, match=r"PnP: found \d+ inliers, needed 50"):
        solve_pnp(points, pixels, camera, PnpConfig(max_error_deg=0.1, min_inliers=50))


def test_points_that_determine_no_pose() -> None:
    camera = Camera(model="plumb_bob", width=1280, height=720, K=K)
    points, pixels = pairs(camera, 100)
    with pytest.raises(CalibrationError, match="PnP: "):
        solve_pnp(1e-20 * points, pixels, camera, PnpConfig())
