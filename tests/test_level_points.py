"""Points with feature vectors, and the blocks of pixels that they are compared with."""

import numpy as np
import pytest
import torch
from conftest import make_pose

from semcal_cli.config.mine_config import MINE_WITH_VECTORS
from semcal_cli.drive.camera import Camera
from semcal_cli.estimation.refine.level_points import FeaturePoints, block_means, feature_vectors
from semcal_cli.estimation.refine.statistics_network import SeparableNetwork
from semcal_cli.estimation.refine.torch_geometry import exp_se3
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.observations import FrameObservation, LabelledCloud, LabelledImage, Observations

WIDTH, HEIGHT, CHANNELS, NUM_FRAMES, NUM_POINTS = 64, 48, 5, 3, 2000
CAMERA = Camera(
    model="plumb_bob", width=WIDTH, height=HEIGHT, K=((60.0, 0.0, 31.5), (0.0, 60.0, 23.5), (0.0, 0.0, 1.0))
)
ANCHOR = make_pose((0.01, -0.02, 0.03), (0.1, 0.0, -0.1))
FLOAT32 = 1e-4
"""Vectors of unit variance are sampled at places in float32."""


def make_observations(scale: int = 1) -> Observations:
    """Frames of random points before and behind the camera, with random vectors on both sides."""
    rng = np.random.default_rng(0)
    frames = tuple(
        FrameObservation(
            LabelledCloud(
                rng.uniform(-5.0, 5.0, (NUM_POINTS, 3)).astype(np.float32),
                np.zeros(NUM_POINTS, np.uint8),
                vectors=rng.normal(size=(NUM_POINTS, CHANNELS)).astype(np.float16),
            ),
            LabelledImage(
                np.zeros((HEIGHT, WIDTH), np.uint8),
                vectors=rng.normal(size=(HEIGHT // scale, WIDTH // scale, CHANNELS)).astype(np.float16),
            ),
        )
        for _ in range(NUM_FRAMES)
    )
    return Observations(CAMERA, None, frames, ["one"], ["one"])


def make_points(observations: Observations, factor: int, anchor: Pose = ANCHOR) -> FeaturePoints:
    network = SeparableNetwork(CHANNELS, CHANNELS, MINE_WITH_VECTORS, torch.Generator().manual_seed(0))
    return FeaturePoints(
        observations, network, torch.device("cpu"), factor=factor, anchor=anchor, visible_only=False
    )


def bilinear(vectors: np.ndarray, block_px: int, pixel: np.ndarray) -> np.ndarray:
    """A vector between the centres of blocks, and that of the border beyond the outermost ones."""
    rows, columns, _ = vectors.shape
    u, v = np.clip((pixel + 0.5) / block_px - 0.5, 0.0, [columns - 1, rows - 1])
    left, top = min(int(u), columns - 2), min(int(v), rows - 2)
    corners = vectors[top : top + 2, left : left + 2].astype(float)
    rightwards = corners[:, 0] + (u - left) * (corners[:, 1] - corners[:, 0])
    return rightwards[0] + (v - top) * (rightwards[1] - rightwards[0])


@pytest.mark.parametrize(("scale", "factor", "block_px"), [(1, 1, 1), (1, 4, 4), (4, 1, 4), (4, 8, 8)])
def test_vectors_are_those_of_the_blocks_in_their_own_frame(scale: int, factor: int, block_px: int) -> None:
    observations = make_observations(scale)
    rng = np.random.default_rng(1)
    frames = rng.integers(NUM_FRAMES, size=200)
    pixels = rng.uniform((-5.0, -5.0), (WIDTH + 5.0, HEIGHT + 5.0), (200, 2))
    found = make_points(observations, factor).sample(torch.from_numpy(frames), torch.from_numpy(pixels))
    maps = [block_means(vectors, block_px // scale) for _, vectors in feature_vectors(observations)]
    needed = [bilinear(maps[frame], block_px, pixel) for frame, pixel in zip(frames, pixels, strict=True)]
    np.testing.assert_allclose(found, needed, atol=FLOAT32)


def test_points_behind_the_camera_or_beside_the_image_are_left_out() -> None:
    observations = make_observations()
    points = make_points(observations, 4)
    # The lens sees less than a quarter of all directions.
    assert 0 < len(points) < NUM_FRAMES * NUM_POINTS / 4
    away = make_pose((0.0, 0.0, 0.0), (0.0, 0.0, -100.0))
    assert len(make_points(observations, 4, away)) == 0


def test_expectations_have_the_derivative_of_the_pose() -> None:
    points = make_points(make_observations(), 8)
    with torch.no_grad():
        for parameter in points.network.parameters():
            parameter.mul_(2.0)  # so that differences stand out of what float32 rounds
    chosen, anchor = torch.arange(len(points)), torch.from_numpy(ANCHOR)

    def bound(v: torch.Tensor) -> torch.Tensor:
        joint, mean_exp = points.expectations(chosen, exp_se3(v) @ anchor)
        return joint - mean_exp.log()

    v = torch.zeros(6, dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad(bound(v), v)
    for axis in range(6):
        step = torch.zeros(6, dtype=torch.float64)
        step[axis] = 1e-4
        with torch.no_grad():
            difference = (bound(step) - bound(-step)) / 2e-4
        assert abs(difference - gradient[axis]) < 0.02 * gradient.abs().max()


@pytest.mark.parametrize("factor", [2, 3, 5])
def test_means_are_those_of_numpy(factor: int) -> None:
    vectors = np.random.default_rng(0).normal(size=(11, 17, 3)).astype(np.float16)
    found = block_means(vectors, factor)
    rows, columns = 11 // factor, 17 // factor
    whole = vectors[: rows * factor, : columns * factor].astype(np.float32)
    means = whole.reshape(rows, factor, columns, factor, 3).mean(axis=(1, 3))
    assert found.dtype == np.float16
    np.testing.assert_allclose(found, means, atol=1e-3)
