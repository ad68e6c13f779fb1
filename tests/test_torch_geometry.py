import math

import cv2
import numpy as np
import pytest
import torch
from conftest import triples
from hypothesis import given
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from torch.autograd import gradcheck

from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.estimation.refine.torch_geometry import TorchProjection, exp_se3, generators

SAME_PIXEL = 1e-6
ROUND_OFF = 1e-10
FOCAL = (600.0, 610.0)
SKEWED = ((600.0, 1.5, 639.5), (0.0, 610.0, 359.5), (0.0, 0.0, 1.0))
GLOBE = (640.0 / math.pi, 640.0 / math.pi)

MODELS = {
    "no distortion": {"model": "plumb_bob"},
    "plumb_bob, 4": {"model": "plumb_bob", "distortion": (-0.25, 0.08, 0.001, -0.002)},
    "plumb_bob, 5": {"model": "plumb_bob", "distortion": (-0.25, 0.08, 0.001, -0.002, -0.01)},
    "rational": {
        "model": "rational_polynomial",
        "distortion": (0.4, 0.05, 0.001, -0.0005, 0.01, 0.7, 0.1, 0.02),
    },
    "thin_prism, 12": {
        "model": "thin_prism",
        "distortion": (0.4, 0.05, 0.001, -0.0005, 0.01, 0.7, 0.1, 0.02, 0.003, -0.001, 0.002, 0.0005),
    },
    "thin_prism, 14": {
        "model": "thin_prism",
        "distortion": (
            *(0.4, 0.05, 0.001, -0.0005, 0.01, 0.7, 0.1, 0.02, 0.003, -0.001, 0.002, 0.0005),
            *(0.02, -0.03),
        ),
    },
    "fisheye": {"model": "fisheye", "distortion": (-0.02, 0.003, -0.001, 0.0005)},
    "fisheye, skew": {"model": "fisheye", "distortion": (-0.02, 0.003, -0.001, 0.0005), "K": SKEWED},
    "plumb_bob, skew": {"model": "plumb_bob", "distortion": (-0.25, 0.08, 0.001, -0.002), "K": SKEWED},
    "omnidirectional": {
        "model": "omnidirectional",
        "distortion": (0.0168, 1.655, 0.0004, 0.0004),
        "parameters": {"xi": 2.2134},
    },
    "equirectangular": {"model": "equirectangular"},
    "fov": {"model": "fov", "distortion": (0.93,)},
    "double_sphere": {"model": "double_sphere", "parameters": {"xi": -0.2, "alpha": 0.6}},
}
OPENCV = ("plumb_bob", "rational_polynomial", "thin_prism", "fisheye")


def make_camera(name: str) -> Camera:
    fx, fy = GLOBE if name == "equirectangular" else FOCAL
    K = ((fx, 0.0, 639.5), (0.0, fy, 359.5), (0.0, 0.0, 1.0))
    return Camera(**{"width": 1280, "height": 720, "K": K} | MODELS[name])


@pytest.fixture(params=MODELS)
def camera(request: pytest.FixtureRequest) -> Camera:
    return make_camera(request.param)


def points_in_front(count: int = 500) -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.uniform([-6.0, -4.0, 5.0], [6.0, 4.0, 30.0], (count, 3))


def points_all_round(count: int = 2000) -> np.ndarray:
    return np.random.default_rng(1).uniform(-20.0, 20.0, (count, 3))


def incidence(points: np.ndarray) -> np.ndarray:
    return np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2])


def opencv_pixels(points: np.ndarray, camera: Camera) -> np.ndarray:
    zero, K, distortion = np.zeros(3), np.array(camera.K), np.array(camera.distortion)
    if camera.model == "fisheye":
        skew = K[0, 1] / K[0, 0]
        return cv2.fisheye.projectPoints(points[:, None], zero, zero, K, distortion, alpha=skew)[0][:, 0]
    pixels = cv2.projectPoints(points, zero, zero, K, distortion)[0][:, 0]
    # cv2.projectPoints does not read the skew.
    pixels[:, 0] += K[0, 1] * (pixels[:, 1] - K[1, 2]) / K[1, 1]
    return pixels


@pytest.mark.parametrize("name", [name for name, lens in MODELS.items() if lens["model"] in OPENCV])
def test_pixels_are_those_of_opencv(name: str) -> None:
    camera, points = make_camera(name), points_in_front()
    np.testing.assert_allclose(
        core_camera(camera).project(points), opencv_pixels(points, camera), atol=SAME_PIXEL
    )


def test_torch_and_rust_agree_all_round(camera: Camera) -> None:
    points = points_all_round()
    expected = core_camera(camera).project(points)
    pixels, holds = TorchProjection(camera)(torch.from_numpy(points))
    np.testing.assert_array_equal(holds, ~np.isnan(expected[:, 0]))
    np.testing.assert_allclose(pixels[holds], expected[holds.numpy()], atol=SAME_PIXEL)
    assert pixels.isfinite().all()


def test_what_lies_beyond_the_limit_is_outside(camera: Camera) -> None:
    core, points = core_camera(camera), points_all_round()
    beyond = incidence(points) > core.limit
    assert camera.model == "equirectangular" or beyond.any()
    np.testing.assert_array_equal(np.isnan(core.project(points)).any(1), beyond)
    pixels, holds = TorchProjection(camera)(
        torch.tensor([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0]], dtype=torch.float64)
    )
    assert camera.model == "equirectangular" or not holds[0]
    assert pixels.isfinite().all()


def test_a_point_beyond_has_the_pixel_of_the_last_one_in_its_direction() -> None:
    camera = make_camera("fisheye")
    limit, turn = core_camera(camera).limit, 0.7
    angles = torch.tensor([limit - 1e-9, limit + 0.1, math.pi - 0.1], dtype=torch.float64)
    across = torch.sin(angles)
    points = torch.stack([across * math.cos(turn), across * math.sin(turn), torch.cos(angles)], 1)
    pixels, holds = TorchProjection(camera)(points)
    assert holds.tolist() == [True, False, False]
    np.testing.assert_allclose(pixels[1:], pixels[:1].expand(2, 2), atol=SAME_PIXEL)


def test_unprojected_pixels_project_back(camera: Camera) -> None:
    pixels = np.stack(np.meshgrid(np.arange(0.0, 1280, 40), np.arange(0.0, 720, 40)), -1).reshape(-1, 2)
    rays = core_camera(camera).unproject(pixels)
    reached = ~np.isnan(rays[:, 0])
    assert reached.mean() > 0.35  # a circular image leaves corners dark
    np.testing.assert_allclose(np.linalg.norm(rays[reached], axis=1), 1.0)
    np.testing.assert_allclose(
        core_camera(camera).project(rays[reached] * 9.0), pixels[reached], atol=SAME_PIXEL
    )


def test_gradient(camera: Camera) -> None:
    points = points_all_round(60)
    within = points[incidence(points) < 0.95 * min(core_camera(camera).limit, 2.8)][:8]
    assert len(within) == 8
    assert gradcheck(lambda p: TorchProjection(camera)(p)[0], torch.from_numpy(within).requires_grad_())


def test_gradients_are_finite_on_the_axis_and_beyond_the_limit(camera: Camera) -> None:
    points = torch.tensor([[0.0, 0.0, 4.0], [1.0, 0.5, -7.0]], dtype=torch.float64, requires_grad=True)
    TorchProjection(camera)(points)[0].sum().backward()
    assert points.grad.isfinite().all()


@given(rho=triples(5.0), phi=triples(3.0))
def test_exponential_of_a_twist(rho: tuple[float, ...], phi: tuple[float, ...]) -> None:
    twist = torch.tensor([*rho, *phi], dtype=torch.float64)
    T = exp_se3(twist).numpy()
    np.testing.assert_allclose(T[:3, :3], Rotation.from_rotvec(phi).as_matrix(), atol=ROUND_OFF)
    np.testing.assert_allclose(T @ exp_se3(-twist).numpy(), np.eye(4), atol=ROUND_OFF)
    np.testing.assert_allclose(T, expm(np.einsum("i,ijk->jk", twist, generators(twist))), atol=ROUND_OFF)


def test_gradient_of_the_exponential() -> None:
    twist = torch.tensor([0.3, -0.2, 0.5, 0.1, 0.4, -0.3], dtype=torch.float64, requires_grad=True)
    assert gradcheck(exp_se3, twist)
