import numpy as np
import pytest
import torch

from semcal_cli.sampling import ShareMaps

NUM_CLASSES = 4
BYTE = 1.5 / 255.0  # shares are kept as bytes
HEIGHT, WIDTH = 21, 30  # no multiple of the block


@pytest.fixture
def images() -> list[np.ndarray]:
    ids = np.random.default_rng(3).integers(0, NUM_CLASSES + 1, (2, HEIGHT, WIDTH)).astype(np.uint8)
    return [np.where(image == NUM_CLASSES, 255, image).astype(np.uint8) for image in ids]


def interpolate(image: np.ndarray, factor: int, u: float, v: float) -> np.ndarray:
    one_hot = np.stack([image == c for c in range(NUM_CLASSES)], -1).astype(float)
    rows, columns = HEIGHT // factor, WIDTH // factor
    blocks = (
        one_hot[: rows * factor, : columns * factor].reshape(rows, factor, columns, factor, -1).mean((1, 3))
    )
    x = np.clip((u + 0.5) / factor - 0.5, 0, columns - 1)
    y = np.clip((v + 0.5) / factor - 0.5, 0, rows - 1)
    i, j = min(int(y), rows - 2), min(int(x), columns - 2)
    top = blocks[i, j] * (1 - (x - j)) + blocks[i, j + 1] * (x - j)
    bottom = blocks[i + 1, j] * (1 - (x - j)) + blocks[i + 1, j + 1] * (x - j)
    return top * (1 - (y - i)) + bottom * (y - i)


@pytest.mark.parametrize("factor", [1, 4])
def test_bilinear_shares(images: list[np.ndarray], factor: int) -> None:
    rng = np.random.default_rng(4)
    pixels = rng.uniform([-3.0, -3.0], [WIDTH + 2.0, HEIGHT + 2.0], (200, 2))
    frames = rng.integers(0, 2, 200)
    expected = [interpolate(images[f], factor, u, v) for f, (u, v) in zip(frames, pixels, strict=True)]
    maps = ShareMaps(images, NUM_CLASSES, factor)
    np.testing.assert_allclose(
        maps.sample(torch.from_numpy(frames), torch.from_numpy(pixels)), expected, atol=BYTE
    )


@pytest.mark.parametrize("factor", [1, 4])
def test_gradient_is_the_slope_between_block_centres(images: list[np.ndarray], factor: int) -> None:
    maps, frames, step = ShareMaps(images, NUM_CLASSES, factor), torch.zeros(1, dtype=torch.int64), 0.25
    pixels = torch.tensor([[12.4, 10.5]], dtype=torch.float64, requires_grad=True)
    slopes = torch.autograd.functional.jacobian(lambda p: maps.sample(frames, p)[0], pixels)[:, 0]
    for axis in range(2):
        shift = torch.zeros(1, 2, dtype=torch.float64)
        shift[0, axis] = step
        difference = maps.sample(frames, pixels + shift) - maps.sample(frames, pixels - shift)
        np.testing.assert_allclose(slopes[:, axis], (difference / (2 * step)).detach()[0], atol=1e-5)


def test_beyond_the_border_nothing_changes(images: list[np.ndarray]) -> None:
    maps, frames = ShareMaps(images, NUM_CLASSES, 1), torch.zeros(2, dtype=torch.int64)
    inside, outside = maps.sample(frames, torch.tensor([[0.0, 5.0], [-40.0, 5.0]], dtype=torch.float64))
    assert torch.equal(inside, outside)
