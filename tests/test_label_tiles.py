"""Scores of overlapping tiles are joined as transformers joins windows: `merge_image_patches` of EoMT's processor."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from networks import card, constant_network, save
from onnx import TensorProto, helper

from semcal_cli.drive.camera import Camera
from semcal_cli.labelling.image_labeller import ImageLabeller, combine_masks
from semcal_cli.labelling.model import image_model
from semcal_cli.labelling.onnx_network import open_network

SIDE, STARTS = 32, (0, 25, 51)
"""Side of a window, and the first columns of three windows of 83 x 32 pixels: `_split_image` of EoMT's processor."""
LONG, SHORT = 166, 64
"""Sides of the camera's image, which is scaled to half its size."""
NAMES = [*"abcde"]
TIE = 1e-4
"""Rounding may order scores that are closer than this otherwise."""


def windows_in_numpy(scores: np.ndarray, *, is_tall: bool) -> np.ndarray:
    """Add up the scores (C, 32, 32) of the windows, divide by their number, and scale to the image (C, H, W)."""
    scores = scores.swapaxes(1, 2) if is_tall else scores
    total, count = np.zeros((len(scores), SIDE, STARTS[-1] + SIDE)), np.zeros(STARTS[-1] + SIDE)
    for start in STARTS:
        total[:, :, start : start + SIDE] += scores
        count[start : start + SIDE] += 1
    upsampled = np.stack([cv2.resize(plane, (LONG, SHORT)) for plane in total / count])
    return upsampled.swapaxes(1, 2) if is_tall else upsampled


def masks_network(folder: Path) -> np.ndarray:
    """Write a network of constant queries; gives the probabilities (C, 32, 32) of each window."""
    random = np.random.default_rng(6)
    constants = {
        "class_queries_logits": random.normal(size=(1, 4, len(NAMES) + 1)).astype(np.float32),
        "masks_queries_logits": random.normal(0.0, 3.0, (1, 4, 8, 8)).astype(np.float32),
    }
    save(
        folder / "net.onnx",
        [helper.make_node("Identity", [f"of {name}"], [name]) for name in constants],
        {"x": (TensorProto.FLOAT, [1, 3, SIDE, SIDE])},
        {name: (TensorProto.FLOAT, values.shape) for name, values in constants.items()},
        {f"of {name}": values for name, values in constants.items()},
    )
    return combine_masks(constants, (SIDE, SIDE))[0]


@pytest.mark.parametrize("is_tall", [False, True])
@pytest.mark.parametrize("output", ["masks", "logits", "logits, classes last"])
def test_windows_that_overlap_are_averaged(tmp_path: Path, output: str, is_tall: bool) -> None:
    """The network gives every window the same scores, so that the place of a window alone tells them apart."""
    stated = {"size": [SIDE, SIDE], "fit": "tiles", "short_side": SIDE, "overlap": 0.0, "classes": NAMES}
    if output == "masks":
        scores = masks_network(tmp_path)
        stated |= {"kind": "masks", "mask_size": [SIDE, SIDE]}
    else:
        scores = np.random.default_rng(4).normal(size=(len(NAMES), SIDE, SIDE)).astype(np.float32)
        constant_network((np.moveaxis(scores, 0, 2) if "last" in output else scores)[None])(tmp_path)
        stated |= {"kind": "logits"}
    card(tmp_path, **stated)
    width, height = (SHORT, LONG) if is_tall else (LONG, SHORT)
    K = ((90.0, 0.0, width / 2), (0.0, 90.0, height / 2), (0.0, 0.0, 1.0))
    camera = Camera(model="plumb_bob", width=width, height=height, K=K)
    net = ImageLabeller(image_model(open_network(tmp_path / "net.onnx"), None), camera)
    image = np.zeros((height, width, 3), np.uint8)
    expected = windows_in_numpy(scores, is_tall=is_tall)
    second, best = np.sort(expected, axis=0)[-2:]
    is_clear = best - second > TIE
    assert is_clear.mean() > 0.99
    assert np.array_equal(net.ids(image)[is_clear], expected.argmax(0)[is_clear])
    likely = expected if output == "masks" else np.exp(expected)
    assert np.abs(net.shares(image) - 255.0 * np.moveaxis(likely / likely.sum(0), 0, 2)).max() <= 1.0


def test_coarse_scores_are_those_of_the_window_whose_border_is_farther(tmp_path: Path) -> None:
    """Cells of four pixels of two windows 25 pixels apart do not meet."""
    scores = np.zeros((1, 2, 8, 8), np.float32)
    scores[0, 0], scores[0, 1, :, 4:] = 0.5, 1.0
    constant_network(scores)(tmp_path)
    card(tmp_path, size=[SIDE, SIDE], fit="tiles", overlap=0.0, kind="logits", classes=["a", "b"])
    camera = Camera(
        model="plumb_bob", width=57, height=SIDE, K=((50.0, 0.0, 28.0), (0.0, 50.0, 16.0), (0.0, 0.0, 1.0))
    )
    net = ImageLabeller(image_model(open_network(tmp_path / "net.onnx"), None), camera)
    row = net.ids(np.zeros((SIDE, 57, 3), np.uint8))[0]
    # The seam lies half-way between the start of the second window and the end of the first.
    assert row.tolist() == [0] * 16 + [1] * 13 + [0] * 12 + [1] * 16
