import cv2
import numpy as np
import pytest
import torch
from torch.autograd import gradcheck

from semcal_cli.camera import core_camera
from semcal_cli.drive import Camera
from semcal_cli.projection import Projection

SAME_PIXEL = 1e-6
K = ((600.0, 0.0, 639.5), (0.0, 610.0, 359.5), (0.0, 0.0, 1.0))
LENSES = {
    "no distortion": ("plumb_bob", ()),
    "plumb_bob, 4": ("plumb_bob", (-0.25, 0.08, 0.001, -0.002)),
    "plumb_bob, 5": ("plumb_bob", (-0.25, 0.08, 0.001, -0.002, -0.01)),
    "rational": ("rational_polynomial", (0.4, 0.05, 0.001, -0.0005, 0.01, 0.7, 0.1, 0.02)),
    "fisheye": ("fisheye", (-0.02, 0.003, -0.001, 0.0005)),
}


@pytest.fixture(params=LENSES.values(), ids=LENSES.keys())
def camera(request: pytest.FixtureRequest) -> Camera:
    model, distortion = request.param
    return Camera(model=model, width=1280, height=720, K=K, distortion=distortion)


def points_camera(count: int = 500) -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.uniform([-6.0, -4.0, 5.0], [6.0, 4.0, 30.0], (count, 3))


def opencv_pixels(points: np.ndarray, camera: Camera) -> np.ndarray:
    zero, K, distortion = np.zeros(3), np.array(camera.K), np.array(camera.distortion)
    if camera.model == "fisheye":
        return cv2.fisheye.projectPoints(points[:, None], zero, zero, K, distortion)[0][:, 0]
    return cv2.projectPoints(points, zero, zero, K, distortion)[0][:, 0]


def test_torch_rust_and_opencv_agree(camera: Camera) -> None:
    points = points_camera()
    pixels, holds = Projection(camera)(torch.from_numpy(points))
    assert holds.all()
    np.testing.assert_allclose(pixels, opencv_pixels(points, camera), atol=SAME_PIXEL)
    np.testing.assert_allclose(pixels, core_camera(camera).project(points), atol=SAME_PIXEL)


def test_unprojected_pixels_project_back(camera: Camera) -> None:
    pixels = np.stack(np.meshgrid(np.arange(0.0, 1280, 40), np.arange(0.0, 720, 40)), -1).reshape(-1, 2)
    rays = core_camera(camera).unproject(pixels)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0)
    np.testing.assert_allclose(core_camera(camera).project(rays * 9.0), pixels, atol=SAME_PIXEL)


def test_gradient(camera: Camera) -> None:
    points = torch.from_numpy(points_camera(5)).requires_grad_()
    assert gradcheck(lambda p: Projection(camera)(p)[0], points)


def test_what_lies_behind_has_no_pixel(camera: Camera) -> None:
    behind = np.array([[0.1, 0.1, -5.0], [0.0, 0.0, -1.0]])
    pixels, holds = Projection(camera)(torch.from_numpy(behind))
    assert not holds.any()
    assert pixels.isfinite().all()
    assert np.isnan(core_camera(camera).project(behind)).all()
