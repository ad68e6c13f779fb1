"""Networks are understood, and their answers come to the right pixels and points."""

import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from networks import COLORS, NAMES, POINT_CARD, card, color_network, constant_network, range_network, save
from onnx import TensorProto, helper

from semcal_cli import core
from semcal_cli.drive.camera import Camera
from semcal_cli.errors import InputError
from semcal_cli.labelling.image_labeller import ImageLabeller, combine_masks
from semcal_cli.labelling.model import image_model, point_model
from semcal_cli.labelling.onnx_network import open_network
from semcal_cli.labelling.sweep_labeller import SweepLabeller, sweep_labeller
from semcal_cli.labelling.views import resize_image

WIDTH, HEIGHT = 96, 64
K = ((60.0, 0.0, 47.5), (0.0, 60.0, 31.5), (0.0, 0.0, 1.0))
PLAIN = Camera(model="plumb_bob", width=WIDTH, height=HEIGHT, K=K)
BORDER_PX = 1.0
"""A rectified image is sampled once, so that no border moves by more than a pixel."""
BESIDE_PX = 1.0
"""Distance from its border, which counts as the pixel below it, of the pixel above."""


def squares(
    width: int = WIDTH, height: int = HEIGHT, side: int = 8, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Squares of the classes' colours: (H, W, 3) blue, green, red, and (H, W) classes."""
    random = np.random.default_rng(seed)
    coarse = random.integers(0, len(COLORS), (-(-height // side), -(-width // side)))
    classes = np.kron(coarse, np.ones((side, side), int))[:height, :width]
    return COLORS[classes][..., ::-1].copy(), classes


def labeller(path: Path, camera: Camera = PLAIN, *, is_rectified: bool = False) -> ImageLabeller:
    return ImageLabeller(image_model(open_network(path), None), camera, is_rectified=is_rectified)


def color_scores(rgb: np.ndarray) -> np.ndarray:
    """What `color_network` computes of colours (h, w, 3) from 0 to 255: (C, h, w)."""
    colors = COLORS.astype(float)
    return np.moveaxis(1e-4 * (2.0 * rgb @ colors.T - (colors**2).sum(1)), 2, 0)


# Images


WAYS: dict[str, tuple[dict[str, Any], dict[str, object]]] = {
    **{
        f"{kind}, channels {place}, {size[0]} rows": (
            {"size": size, "kind": kind, "channels_last": place == "last"},
            {"layout": f"channels_{place}" if size[0] == "h" else None},
        )
        for kind, place, size in (
            ("logits", "first", ("h", "w")),
            ("logits", "last", ("h", "w")),
            ("probabilities", "last", (HEIGHT, WIDTH)),
            ("ids", "first", (HEIGHT, WIDTH)),
        )
    },
    "half floats": ({"dtype": "float16"}, {}),
    "bytes": ({"dtype": "uint8", "scale": 1.0}, {"scale": None}),
    "bytes that stand for 0 to 1": (
        {"dtype": "uint8", "scale": 1.0},
        {"mean": [0, 0, 0], "std": [1, 1, 1], "fit": "letterbox", "kind": "logits"},
    ),
    "blue first": ({"colors": COLORS[:, ::-1]}, {"color": "bgr"}),
    "with a border": ({"size": (2 * HEIGHT, 2 * WIDTH + 32)}, {"fit": "letterbox"}),
    "in a corner": ({"size": (2 * HEIGHT, 2 * WIDTH + 32)}, {"fit": "letterbox", "place": "corner"}),
    "four tiles": ({"size": (48, 64)}, {"fit": "tiles"}),
    "of a longer side": ({}, {"short_side": 8 * HEIGHT, "long_side": 2 * WIDTH}),
    "four tiles of a larger image": ({"size": (96, 128)}, {"fit": "tiles", "short_side": 2 * HEIGHT}),
    "a tile with a border": ({"size": (128, 128)}, {"fit": "tiles"}),
}


@pytest.mark.parametrize("name", WAYS)
def test_every_pixel_has_the_class_of_its_colour(tmp_path: Path, name: str) -> None:
    network, stated = WAYS[name]
    color_network(tmp_path / "net.onnx", **network)
    card(tmp_path, **stated)
    image, classes = squares()
    net = labeller(tmp_path / "net.onnx")
    assert len(net.views.draws) == (4 if "four tiles" in name else 1)
    assert np.array_equal(net.ids(image), classes)


def test_grey_is_that_of_the_eye(tmp_path: Path) -> None:
    """The network tells whether a pixel is brighter than half; a pure colour is as bright as its weight in BT.601."""
    constants = {"w": np.array([[[[1.0]]], [[[-1.0]]]], np.float32), "b": np.array([-0.5, 0.5], np.float32)}
    shape = [1, 1, HEIGHT, WIDTH]
    outputs = {"y": (TensorProto.FLOAT, [1, 2, HEIGHT, WIDTH])}
    nodes = [helper.make_node("Conv", ["x", "w", "b"], ["y"])]
    save(tmp_path / "net.onnx", nodes, {"x": (TensorProto.FLOAT, shape)}, outputs, constants)
    card(tmp_path, color="gray", classes=["bright", "dark"])
    net = labeller(tmp_path / "net.onnx")
    for color, expected in (([0, 255, 0], 0), ([255, 0, 255], 1), ([200] * 3, 0), ([30] * 3, 1)):
        image = np.full((HEIGHT, WIDTH, 3), color, np.uint8)
        assert set(np.unique(net.ids(image))) == {expected}


def test_coarse_scores_are_sampled_as_opencv_samples_them(tmp_path: Path) -> None:
    stride = 4
    color_network(tmp_path / "net.onnx", stride=stride)
    card(tmp_path)
    image, _ = squares(side=5)
    mean = image[..., ::-1].reshape(HEIGHT // stride, stride, WIDTH // stride, stride, 3).mean((1, 3))
    scores = np.moveaxis(color_scores(mean), 0, 2).astype(np.float32)
    expected = np.moveaxis(cv2.resize(scores, (WIDTH, HEIGHT), interpolation=cv2.INTER_LINEAR), 2, 0)
    ids = labeller(tmp_path / "net.onnx").ids(image)
    best, second = np.sort(expected, axis=0)[[-1, -2]]
    assert np.array_equal(ids[best - second > 1e-4], expected.argmax(0)[best - second > 1e-4])
    assert np.mean(best - second > 1e-4) > 0.99
    shares = labeller(tmp_path / "net.onnx").shares(image)
    likely = np.exp(expected - expected.max(0))
    assert np.abs(shares - 255.0 * np.moveaxis(likely / likely.sum(0), 0, 2)).max() <= 1.0


def test_outermost_centres_agree_where_the_card_says_so(tmp_path: Path) -> None:
    scores = np.array([[[[0.0, 0.0, 9.0]], [[4.0, 4.0, 0.0]]]], np.float32)
    constant_network(scores)(tmp_path)
    camera = PLAIN.model_copy(update={"width": 9, "height": 3})
    positions = {}
    for aligned, ones in ((False, 5), (True, 6)):
        card(tmp_path, size=[9, 3], align_corners=aligned, classes=["a", "b"])
        net = labeller(tmp_path / "net.onnx", camera)
        positions[aligned] = net.views.positions_on(3, 1, align_corners=aligned)[:9, 0]
        assert net.ids(np.zeros((3, 9, 3), np.uint8))[0].tolist() == [1] * ones + [0] * (9 - ones)
    assert np.allclose(positions[False], (np.arange(9) + 0.5) / 3 - 0.5)
    assert np.allclose(positions[True], np.arange(9) / 4)


def test_scores_may_be_bytes_where_the_card_says_that_they_are_scores(tmp_path: Path) -> None:
    scores = np.random.default_rng(2).integers(0, 200, (1, 3, 4, 6)).astype(np.uint8)
    scores[0, 2] += 10
    constant_network(scores)(tmp_path)
    camera = PLAIN.model_copy(update={"width": 6, "height": 4})
    card(tmp_path, size=[6, 4], kind="logits", classes=["a", "b", "c"])
    assert np.array_equal(
        labeller(tmp_path / "net.onnx", camera).ids(np.zeros((4, 6, 3), np.uint8)), scores[0].argmax(0)
    )
    card(tmp_path, size=[6, 4], classes=["a", "b", "c"])
    with pytest.raises(InputError, match=r"ids of \(1, 3, 4, 6\), expected rows x columns"):
        labeller(tmp_path / "net.onnx", camera).ids(np.zeros((4, 6, 3), np.uint8))


def test_masks_of_queries_are_joined(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    classes, masks = random.normal(size=(1, 5, 4)), random.normal(size=(1, 5, 6, 7))
    probabilities = combine_masks({"class_queries_logits": classes, "masks_queries_logits": masks})
    expected = np.zeros((3, 6, 7))
    for query in range(5):
        likely = np.exp(classes[0, query]) / np.exp(classes[0, query]).sum()
        for name in range(3):
            expected[name] += likely[name] / (1.0 + np.exp(-masks[0, query]))
    assert np.allclose(probabilities[0], expected)
    larger = np.stack([cv2.resize(mask, (9, 5)) for mask in masks[0]])[None]
    outputs = {"class_queries_logits": classes, "masks_queries_logits": larger}
    scaled = combine_masks({"class_queries_logits": classes, "masks_queries_logits": masks}, (9, 5))
    assert np.allclose(scaled, combine_masks(outputs), atol=1e-6)


def test_an_image_shrinks_by_the_filter_of_the_card() -> None:
    """Of a bright column among dark ones, a shrunk image has its share by the mean, and nothing by the nearest."""
    stripes = np.zeros((8, 32, 3), np.uint8)
    stripes[:, ::4] = 200
    shrunk = {how: set(np.unique(resize_image(stripes, (8, 8), how))) for how in (None, "box", "nearest")}
    assert shrunk == {None: {50}, "box": {50}, "nearest": {0}}


def lens(
    model: str, width: int, height: int, focal: float, center: tuple[float, float], *distortion: float
) -> Camera:
    K = ((focal, 0.0, center[0]), (0.0, focal, center[1]), (0.0, 0.0, 1.0))
    return Camera(model=model, width=width, height=height, K=K, distortion=distortion)


LENSES = {
    "plumb_bob": lens("plumb_bob", 320, 240, 200.0, (160, 120), -0.3, 0.08, 0.001, 0.0),
    "fisheye": lens("fisheye", 320, 320, 95.0, (160, 160), 0.02, -0.01, 0.0, 0.0),
    "equirectangular": lens("equirectangular", 384, 192, 384 / math.tau, (191.5, 95.5)),
}


@pytest.mark.parametrize("tiles", [{}, {"fit": "tiles", "size": [96, 80]}], ids=["whole", "tiles"])
@pytest.mark.parametrize("name", LENSES)
def test_the_way_through_rectified_images_moves_no_border_by_more_than_a_pixel(
    tmp_path: Path, name: str, tiles: dict[str, Any]
) -> None:
    camera = LENSES[name]
    color_network(tmp_path / "net.onnx", colors=COLORS[:3])
    card(tmp_path, classes=NAMES[:3], **tiles)
    # Stripes of two classes, so that no mixed colour is that of a third, which go on behind a round image's border.
    rows, columns = np.mgrid[: camera.height, : camera.width]
    classes = ((rows + 80.0 * columns / camera.width) // 40 % 2).astype(int)
    image = COLORS[classes][..., ::-1].copy()
    labels = labeller(tmp_path / "net.onnx", camera, is_rectified=True).ids(image).astype(int)
    seen = labels != core.NO_ID
    assert seen.mean() > 0.75
    if name == "equirectangular":
        seen[[0, -1]] = False  # a row at a pole is one point
    border = cv2.distanceTransform((classes == np.roll(classes, 1, 0)).astype(np.uint8), cv2.DIST_L2, 5)
    assert border[seen & (labels != classes)].max(initial=0.0) <= BORDER_PX + BESIDE_PX
    assert np.mean(labels[seen] == classes[seen]) > 0.97


# Sweeps


def sweep(folder: Path, count: int = 4000) -> tuple[Path, np.ndarray]:
    random = np.random.default_rng(5)
    azimuth, elevation = random.uniform(-np.pi, np.pi, count), np.radians(random.uniform(-26, 4, count))
    distance = random.uniform(2, 50, count)
    points = np.stack(
        [
            distance * np.cos(elevation) * np.cos(azimuth),
            distance * np.cos(elevation) * np.sin(azimuth),
            distance * np.sin(elevation),
            random.uniform(0, 1, count),
        ],
        1,
    ).astype(np.float32)
    points.tofile(folder / "sweep.bin")
    return folder / "sweep.bin", points


def rangenet(points: np.ndarray, rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of points as Milioto et al. project them, in their words: row, column."""
    depth = np.linalg.norm(points[:, :3].astype(float), axis=1)
    up, down = np.radians(3.0), np.radians(-25.0)
    yaw, pitch = -np.arctan2(points[:, 1], points[:, 0]), np.arcsin(points[:, 2] / depth)
    x, y = 0.5 * (yaw / np.pi + 1.0) * columns, (1.0 - (pitch + abs(down)) / (up - down)) * rows
    return np.clip(np.floor(y), 0, rows - 1).astype(int), np.clip(np.floor(x), 0, columns - 1).astype(int)


@pytest.mark.parametrize("convention", ["round", "front"])
def test_points_have_the_class_of_their_pixel(tmp_path: Path, convention: str) -> None:
    """The network tells pixels whose x is above 20 m; two conventions of range images."""
    values = dict(POINT_CARD)
    if convention == "front":
        values |= {
            "azimuth_deg": [45.0, -45.0],
            "outside": "drop",
            "channels": ["x", "y", "z", "intensity", "range", "mask"],
            "mean": [10.88, 0.23, -1.04, 0.21, 12.12, 0.0],
            "std": [11.47, 6.91, 0.86, 0.16, 12.32, 1.0],
            "empty": -1.0,
        }
    place = values["channels"].index("x")
    net = range_network(
        tmp_path / "net.onnx", len(values["channels"]), 16, 128, place, (20.0 - 10.88) / 11.47
    )
    (tmp_path / "net.yaml").write_text(yaml.safe_dump(values))
    file, points = sweep(tmp_path)
    (cloud,) = core.read_point_clouds([(file, None)])
    ids = SweepLabeller(point_model(open_network(net), None)).ids(cloud)
    elevation = np.degrees(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])))
    azimuth = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
    if convention == "round":
        row, column = rangenet(points, 16, 128)
        inside = np.ones(len(points), bool)
    else:
        inside = (np.abs(azimuth) < 45.0) & (elevation > -25.0) & (elevation < 3.0)
        row = np.floor((3.0 - elevation) / 28.0 * 16).astype(int)
        column = np.floor((45.0 - azimuth) / 90.0 * 128).astype(int)
    nearest: dict[tuple[int, int], int] = {}
    ranges = np.linalg.norm(points[:, :3], axis=1)
    for index in np.argsort(ranges)[::-1]:
        nearest[row[index], column[index]] = index
    expected = [
        1 + int(points[nearest[row[i], column[i]], 0] > 20.0) if inside[i] else core.NO_ID
        for i in range(len(points))
    ]
    # A point on the border of two pixels may fall into either.
    assert np.mean(ids == np.array(expected)) > 0.999
    assert set(np.unique(ids)) == ({1, 2} if convention == "round" else {1, 2, core.NO_ID})


@pytest.mark.parametrize("output", ["scores", "ids", "scores of a batch"])
def test_a_network_may_take_the_points_themselves(tmp_path: Path, output: str) -> None:
    """The network tells points whose third number, z by the card's mean and deviation, is above 0.5."""
    weights = np.zeros((5, 2), np.float32)
    weights[2, 1] = 1.0
    nodes = [
        helper.make_node("MatMul", ["points", "w"], ["of each"]),
        helper.make_node("Add", ["of each", "b"], ["scores"]),
    ]
    shape: list[object] = [1, "n"] if "batch" in output else ["n"]
    last, kind, axes = "scores", TensorProto.FLOAT, [*shape, 2]
    if output == "ids":
        nodes.append(helper.make_node("ArgMax", ["scores"], ["y"], axis=1, keepdims=0))
        last, kind, axes = "y", TensorProto.INT64, shape
    constants = {"w": weights, "b": np.array([0.5, 0.0], np.float32)}
    net = save(
        tmp_path / "net.onnx",
        nodes,
        {"points": (TensorProto.FLOAT, [*shape, 5])},
        {last: (kind, axes)},
        constants,
    )
    stated = {"semcal_point_model": 1, "kind": "points", "channels": ["x", "y", "z", "intensity", "range"]}
    numbers = {"mean": [0, 0, -1.0, 0, 0], "std": [1, 1, 2.0, 1, 1], "classes": ["low", "high"]}
    (tmp_path / "net.yaml").write_text(yaml.safe_dump(stated | numbers))
    file, points = sweep(tmp_path)
    (cloud,) = core.read_point_clouds([(file, None)])
    ids = sweep_labeller(open_network(net), None).ids(cloud)
    assert np.array_equal(ids, (points[:, 2].astype(float) + 1.0) / 2.0 > 0.5)
    assert 0.02 < ids.mean() < 0.98


def test_a_network_of_points_has_no_other_inputs(tmp_path: Path) -> None:
    """Such as the cells of its points, which have to be part of it."""
    nodes = [helper.make_node("Gather", ["points", "cells"], ["y"])]
    inputs = {"points": (TensorProto.FLOAT, ["n", 4]), "cells": (TensorProto.INT64, ["n"])}
    net = save(tmp_path / "net.onnx", nodes, inputs, {"y": (TensorProto.FLOAT, ["n", 4])}, {})
    stated = {"semcal_point_model": 1, "kind": "points", "classes": ["low", "high"]}
    (tmp_path / "net.yaml").write_text(yaml.safe_dump(stated))
    with pytest.raises(InputError, match=r"net.onnx: found additional inputs cells, expected only points$"):
        sweep_labeller(open_network(net), None)


def test_a_network_for_sweeps_says_what_it_lacks(tmp_path: Path) -> None:
    net = range_network(tmp_path / "net.onnx", 5, 16, 128, 1, 0.0)
    (tmp_path / "net.yaml").write_text(yaml.safe_dump(POINT_CARD | {"row_by": "ring"}))
    file, _ = sweep(tmp_path)
    (cloud,) = core.read_point_clouds([(file, None)])
    with pytest.raises(InputError, match=r"found points without ring, which .*net\.onnx needs"):
        SweepLabeller(point_model(open_network(net), None)).ids(cloud)
