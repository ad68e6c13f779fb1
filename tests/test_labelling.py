"""`semcal label`: networks are understood, and their answers come to the right pixels and points."""

import json
import math
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest
import yaml
from click.testing import CliRunner, Result
from networks import COLORS, color_network, range_network, save
from onnx import TensorProto, helper

from semcal_cli import _core
from semcal_cli.cli import semcal
from semcal_cli.drive.document import Camera, Drive, read_drive
from semcal_cli.drive.reading import read_clouds, read_label_images
from semcal_cli.errors import InputError, SemcalError
from semcal_cli.labelling.card import card_names, find_card, read_card, read_classes
from semcal_cli.labelling.models import open_picture_model, open_point_model
from semcal_cli.labelling.picture_model import joined_masks
from semcal_cli.labelling.pictures import PictureLabeller
from semcal_cli.labelling.sweeps import SweepLabeller

WIDTH, HEIGHT = 96, 64
NAMES = ["a", "b", "c", "d", "e", "f"]
K = ((60.0, 0.0, 47.5), (0.0, 60.0, 31.5), (0.0, 0.0, 1.0))
PLAIN = Camera(model="plumb_bob", width=WIDTH, height=HEIGHT, K=K)
BORDER_PX = 1.0
"""A rectified picture is sampled once, so that no border moves by more than a pixel."""
BESIDE_PX = 1.0
"""Distance from its border, which counts as the pixel below it, of the pixel above."""


def card(folder: Path, name: str = "net", **values: object) -> None:
    document = {"semcal_picture_model": 1, "color": "rgb", "scale": 1 / 255, "classes": NAMES} | values
    text = yaml.safe_dump({key: value for key, value in document.items() if value is not None})
    (folder / f"{name}.yaml").write_text(text)


def picture(
    width: int = WIDTH, height: int = HEIGHT, side: int = 8, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Squares of the classes' colours: (H, W, 3) blue, green, red, and (H, W) classes."""
    random = np.random.default_rng(seed)
    coarse = random.integers(0, len(COLORS), (-(-height // side), -(-width // side)))
    classes = np.kron(coarse, np.ones((side, side), int))[:height, :width]
    return COLORS[classes][..., ::-1].copy(), classes


def labeller(path: Path, camera: Camera = PLAIN, *, is_rectified: bool = False) -> PictureLabeller:
    return PictureLabeller(open_picture_model(path, None), camera, is_rectified=is_rectified)


def sampled(scores: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Scores (C, h, w), bilinear at the pixels of a picture whose borders are those of the scores: (C, H, W)."""

    def line(count: int, length: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        place = np.clip((np.arange(length) + 0.5) * count / length - 0.5, 0, count - 1)
        first = np.floor(place).astype(int)
        return first, np.minimum(first + 1, count - 1), place - first

    left, right, across = line(scores.shape[2], size[0])
    above, below, down = line(scores.shape[1], size[1])
    rows = scores[:, above] * (1 - down)[:, None] + scores[:, below] * down[:, None]
    return rows[:, :, left] * (1 - across) + rows[:, :, right] * across


def color_scores(rgb: np.ndarray) -> np.ndarray:
    """What `color_network` computes of colours (h, w, 3) from 0 to 255: (C, h, w)."""
    colors = COLORS.astype(float)
    return np.moveaxis(1e-4 * (2.0 * rgb @ colors.T - (colors**2).sum(1)), 2, 0)


# Pictures


@pytest.mark.parametrize("kind", ["logits", "probabilities", "ids"])
@pytest.mark.parametrize("channels_last", [False, True])
@pytest.mark.parametrize("size", [(HEIGHT, WIDTH), ("h", "w")])
def test_every_pixel_has_the_class_of_its_colour(
    tmp_path: Path, kind: str, channels_last: bool, size: tuple[object, object]
) -> None:
    color_network(tmp_path / "net.onnx", size, kind=kind, channels_last=channels_last)
    card(tmp_path, layout="channels_last" if channels_last and size == ("h", "w") else None)
    image, classes = picture()
    assert np.array_equal(labeller(tmp_path / "net.onnx").ids(image), classes)


@pytest.mark.parametrize("dtype", ["float16", "uint8"])
def test_other_types_of_pixels(tmp_path: Path, dtype: str) -> None:
    color_network(tmp_path / "net.onnx", dtype=dtype, scale=1.0 if dtype == "uint8" else 255.0)
    card(tmp_path, **({"scale": None} if dtype == "uint8" else {}))
    image, classes = picture()
    assert np.array_equal(labeller(tmp_path / "net.onnx").ids(image), classes)


@pytest.mark.parametrize("stride", [2, 4])
def test_coarse_scores_are_sampled_as_numpy_samples_them(tmp_path: Path, stride: int) -> None:
    color_network(tmp_path / "net.onnx", stride=stride)
    card(tmp_path)
    image, _ = picture(side=5)
    mean = image[..., ::-1].reshape(HEIGHT // stride, stride, WIDTH // stride, stride, 3).mean((1, 3))
    expected = sampled(color_scores(mean), (WIDTH, HEIGHT))
    found = labeller(tmp_path / "net.onnx").ids(image)
    best, second = np.sort(expected, axis=0)[[-1, -2]]
    assert np.array_equal(found[best - second > 1e-4], expected.argmax(0)[best - second > 1e-4])
    assert np.mean(best - second > 1e-4) > 0.99
    shares = labeller(tmp_path / "net.onnx").shares(image)
    likely = np.exp(expected - expected.max(0))
    assert np.abs(shares - 255.0 * np.moveaxis(likely / likely.sum(0), 0, 2)).max() <= 1.0


def test_outermost_centres_agree_where_the_card_says_so(tmp_path: Path) -> None:
    scores = np.array([[[0.0, 0.0, 9.0]], [[4.0, 4.0, 0.0]]], np.float32)
    nodes = [helper.make_node("Identity", ["k"], ["y"]), helper.make_node("Identity", ["x"], ["z"])]
    shape = [1, 3, 3, 9]
    outputs = {"y": (TensorProto.FLOAT, [1, 2, 1, 3]), "z": (TensorProto.FLOAT, shape)}
    save(tmp_path / "net.onnx", nodes, {"x": (TensorProto.FLOAT, shape)}, outputs, {"k": scores[None]})
    camera = PLAIN.model_copy(update={"width": 9, "height": 3})
    found = {}
    for aligned, ones in ((False, 5), (True, 6)):
        card(tmp_path, output="y", align_corners=aligned, classes=["a", "b"])
        net = labeller(tmp_path / "net.onnx", camera)
        found[aligned] = net.views.places_on(3, 1, align_corners=aligned)[:9, 0]
        assert net.ids(np.zeros((3, 9, 3), np.uint8))[0].tolist() == [1] * ones + [0] * (9 - ones)
    assert np.allclose(found[False], (np.arange(9) + 0.5) / 3 - 0.5)
    assert np.allclose(found[True], np.arange(9) / 4)


@pytest.mark.parametrize("fit", ["stretch", "letterbox", "tiles"])
def test_labels_come_back_to_their_pixels(tmp_path: Path, fit: str) -> None:
    """The network's picture is twice as large, or one of several tiles; edges of squares may move by half a pixel."""
    rows, columns = (
        (48, 64) if fit == "tiles" else (2 * HEIGHT, 2 * WIDTH + (32 if fit == "letterbox" else 0))
    )
    color_network(tmp_path / "net.onnx", (rows, columns))
    card(tmp_path, fit=fit)
    image, classes = picture()
    net = labeller(tmp_path / "net.onnx")
    assert len(net.views.draws) == (4 if fit == "tiles" else 1)
    assert np.array_equal(net.ids(image), classes)


def test_a_padded_tile_has_no_labels_of_its_border(tmp_path: Path) -> None:
    color_network(tmp_path / "net.onnx", (128, 128))
    card(tmp_path, fit="tiles")
    image, classes = picture()
    assert np.array_equal(labeller(tmp_path / "net.onnx").ids(image), classes)


@pytest.mark.parametrize("color", ["bgr", "gray"])
def test_orders_of_colours(tmp_path: Path, color: str) -> None:
    if color == "bgr":
        color_network(tmp_path / "net.onnx", colors=COLORS[:, ::-1])
        image, classes = picture()
    else:
        weights = np.array([[[[1.0]]], [[[-1.0]]]], np.float32)
        given = {"w": weights, "b": np.array([-0.5, 0.5], np.float32)}
        nodes = [helper.make_node("Conv", ["x", "w", "b"], ["y"])]
        shape = [1, 1, HEIGHT, WIDTH]
        outputs = {"y": (TensorProto.FLOAT, [1, 2, HEIGHT, WIDTH])}
        save(tmp_path / "net.onnx", nodes, {"x": (TensorProto.FLOAT, shape)}, outputs, given)
        classes = np.arange(WIDTH)[None, :].repeat(HEIGHT, 0) // 48
        image = np.where(classes[..., None] == 0, 200, 30).repeat(3, 2).astype(np.uint8)
    card(tmp_path, color=color, classes=NAMES if color == "bgr" else ["bright", "dark"])
    assert np.array_equal(labeller(tmp_path / "net.onnx").ids(image), classes)


def test_masks_of_queries_are_joined(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    classes, masks = random.normal(size=(1, 5, 4)), random.normal(size=(1, 5, 6, 7))
    found = joined_masks({"class_queries_logits": classes, "masks_queries_logits": masks})
    expected = np.zeros((3, 6, 7))
    for query in range(5):
        likely = np.exp(classes[0, query]) / np.exp(classes[0, query]).sum()
        for name in range(3):
            expected[name] += likely[name] / (1.0 + np.exp(-masks[0, query]))
    assert np.allclose(found[0], expected)


LENSES = {
    "plumb_bob": PLAIN.model_copy(
        update={
            "width": 320,
            "height": 240,
            "K": ((200.0, 0, 160), (0, 200.0, 120), (0, 0, 1)),
            "distortion": (-0.3, 0.08, 0.001, 0.0),
        }
    ),
    "fisheye": PLAIN.model_copy(
        update={
            "model": "fisheye",
            "width": 320,
            "height": 320,
            "K": ((95.0, 0, 160), (0, 95.0, 160), (0, 0, 1)),
            "distortion": (0.02, -0.01, 0.0, 0.0),
        }
    ),
    "equirectangular": PLAIN.model_copy(
        update={
            "model": "equirectangular",
            "width": 384,
            "height": 192,
            "K": ((384 / math.tau, 0, 191.5), (0, 384 / math.tau, 95.5), (0, 0, 1)),
        }
    ),
}


@pytest.mark.parametrize("name", LENSES)
def test_the_way_through_rectified_pictures_moves_no_border_by_more_than_a_pixel(
    tmp_path: Path, name: str
) -> None:
    camera = LENSES[name]
    color_network(tmp_path / "net.onnx", colors=COLORS[:3])
    card(tmp_path, classes=NAMES[:3])
    # Stripes of two classes, so that no mixed colour is that of a third, which go on behind a round picture's border.
    rows, columns = np.mgrid[: camera.height, : camera.width]
    classes = ((rows + 80.0 * columns / camera.width) // 40 % 2).astype(int)
    image = COLORS[classes][..., ::-1].copy()
    found = labeller(tmp_path / "net.onnx", camera, is_rectified=True).ids(image).astype(int)
    seen = found != _core.NO_ID
    assert seen.mean() > 0.75
    if name == "equirectangular":
        seen[[0, -1]] = False  # a row at a pole is one point
    border = cv2.distanceTransform((classes == np.roll(classes, 1, 0)).astype(np.uint8), cv2.DIST_L2, 5)
    assert border[seen & (found != classes)].max(initial=0.0) <= BORDER_PX + BESIDE_PX
    assert np.mean(found[seen] == classes[seen]) > 0.97


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


POINT_CARD = {
    "semcal_point_model": 1,
    "rows": 16,
    "columns": 128,
    "elevation_deg": [-25.0, 3.0],
    "channels": ["range", "x", "y", "z", "intensity"],
    "mean": [12.12, 10.88, 0.23, -1.04, 0.21],
    "std": [12.32, 11.47, 6.91, 0.86, 0.16],
    "classes": {"near": [1], "far": [2]},
    "neighbors": None,
}


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
    (cloud,) = _core.read_point_clouds([(file, None)])
    found = SweepLabeller(open_point_model(net, None)).ids(cloud)
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
        1 + int(points[nearest[row[i], column[i]], 0] > 20.0) if inside[i] else _core.NO_ID
        for i in range(len(points))
    ]
    # A point on the border of two pixels may fall into either.
    assert np.mean(found == np.array(expected)) > 0.999
    assert set(np.unique(found)) == ({1, 2} if convention == "round" else {1, 2, _core.NO_ID})


def test_a_network_for_sweeps_says_what_it_lacks(tmp_path: Path) -> None:
    net = range_network(tmp_path / "net.onnx", 5, 16, 128, 1, 0.0)
    (tmp_path / "net.yaml").write_text(yaml.safe_dump(POINT_CARD | {"row_by": "ring"}))
    file, _ = sweep(tmp_path)
    (cloud,) = _core.read_point_clouds([(file, None)])
    with pytest.raises(InputError, match=r"found points without ring, which .*net\.onnx wants"):
        SweepLabeller(open_point_model(net, None)).ids(cloud)


# The command


@pytest.fixture
def plain(drive: Path) -> Path:
    """A drive of three frames without labels of pictures."""
    document = yaml.safe_load((drive / "drive.yaml").read_text())
    for frame in document["frames"]:
        del frame["image_labels"]
    document["classes"].pop("image")
    (drive / "drive.yaml").write_text(yaml.safe_dump(document))
    shutil.rmtree(drive / "image_labels")
    return drive


def street_network(folder: Path) -> Path:
    """A network that tells sky, road and the rest by colour: enough to see that the way is right."""
    colors = np.array([[160, 190, 225], [90, 90, 92], [60, 110, 50], [150, 110, 90]], np.uint8)
    card(folder, classes=["sky", "road", "green", "brown"])
    return color_network(folder / "net.onnx", stride=2, colors=colors)


def run(*arguments: object) -> Result:
    return CliRunner().invoke(semcal, [str(each) for each in arguments])


def test_a_labelled_drive_has_all_that_the_old_one_has(plain: Path, tmp_path: Path) -> None:
    net = street_network(tmp_path)
    found = run("label", plain, "--image-model", net, "-o", tmp_path / "out", "--preview", tmp_path / "p.png")
    assert found.exit_code == 0, found.output
    old, new = read_drive(plain), read_drive(tmp_path / "out")
    assert new.camera == old.camera
    assert new.classes is not None
    assert new.classes.image == {"sky": (0,), "road": (1,), "green": (2,), "brown": (3,)}
    assert new.classes.points == old.classes.points  # type: ignore[union-attr]
    assert new.ignore.image == (255, 65535)
    for before, after in zip(old.frames, new.frames, strict=True):
        for key in ("points", "point_labels", "image"):
            assert new.resolve(getattr(after, key)).samefile(old.resolve(getattr(before, key)))
        assert after.image_labels == f"image_labels/{Path(str(before.image)).stem}.png"
    assert cv2.imread(str(tmp_path / "p.png")) is not None
    labels = read_label_images(new)[0]
    assert (labels[:10] == 0).mean() > 0.2


def test_a_stopped_run_goes_on_and_other_settings_do_not_mix(plain: Path, tmp_path: Path) -> None:
    net = street_network(tmp_path)
    arguments = ("label", plain, "--image-model", net, "-o", tmp_path / "out")
    assert run(*arguments).exit_code == 0
    files = sorted((tmp_path / "out/image_labels").glob("*.png"))
    whole = [file.read_bytes() for file in files]
    files[0].unlink()
    files[1].write_bytes(whole[1][:50])
    found = run(*arguments)
    assert f"{len(files) - 2} label files were there" in found.output
    assert [file.read_bytes() for file in files] == whole
    card(tmp_path, classes=["sky", "road", "green", "brown"], color="bgr")
    found = run(*arguments)
    assert "found labels of another model, drive or settings, needed another -o, or --force" in str(
        found.exception
    )
    assert run(*arguments, "--force").exit_code == 0
    assert [file.read_bytes() for file in files] != whole


def test_names_do_not_depend_on_how_many_frames_are_labelled(plain: Path, tmp_path: Path) -> None:
    """Pictures of one name lie in folders of their own, so that labels are numbered."""
    net = street_network(tmp_path)
    document = yaml.safe_load((plain / "drive.yaml").read_text())
    for index, frame in enumerate(document["frames"]):
        folder = plain / f"at_{index}"
        folder.mkdir()
        shutil.move(plain / frame["image"], folder / "picture.png")
        frame["image"] = f"at_{index}/picture.png"
    (plain / "drive.yaml").write_text(yaml.safe_dump(document))
    arguments = ("label", plain, "--image-model", net)
    assert run(*arguments, "-o", tmp_path / "whole").exit_code == 0
    assert run(*arguments, "-o", tmp_path / "some", "--max-frames", "2").exit_code == 0
    assert len(read_drive(tmp_path / "some").frames) == 2
    assert run(*arguments, "-o", tmp_path / "some").exit_code == 0
    whole, some = (sorted((tmp_path / name / "image_labels").glob("*.png")) for name in ("whole", "some"))
    assert [file.name for file in whole] == [file.name for file in some]
    assert [file.read_bytes() for file in whole] == [file.read_bytes() for file in some]
    document["frames"].reverse()
    (plain / "drive.yaml").write_text(yaml.safe_dump(document))
    found = run(*arguments, "-o", tmp_path / "some")
    assert "found labels of another model, drive or settings" in str(found.exception)


def test_a_bad_picture_is_named_and_the_rest_is_done(plain: Path, tmp_path: Path) -> None:
    net, pictures = street_network(tmp_path), sorted((plain / "images").iterdir())
    pictures[1].write_bytes(pictures[1].read_bytes()[:900])
    found = run("label", plain, "--image-model", net, "-o", tmp_path / "out")
    assert isinstance(found.exception, InputError)
    expected = f"{pictures[1]}: found a damaged picture, needed a whole one"
    assert str(found.exception) == f"1 of {len(pictures)} frames failed; {expected}"
    assert len(read_drive(tmp_path / "out").frames) == len(pictures) - 1


def test_probabilities_are_those_that_a_calibration_reads(plain: Path, tmp_path: Path) -> None:
    net = street_network(tmp_path)
    for options, name in (((), "hard"), (("--probabilities",), "soft")):
        found = run("label", plain, "--image-model", net, "-o", tmp_path / name, *options)
        assert found.exit_code == 0, found.output
    hard, soft = (read_label_images(read_drive(tmp_path / name))[0] for name in ("hard", "soft"))
    assert isinstance(soft, _core.ClassShares)
    # Shares in 1/255 may be equal where scores are not quite.
    assert np.mean(soft.classes == hard.ravel()) > 0.98
    labeller = PictureLabeller(open_picture_model(net, None), read_drive(plain).camera)
    image = cv2.imread(str(sorted((plain / "images").iterdir())[0]))
    exact = labeller.shares(image).astype(np.float16) / 255
    np.savez(tmp_path / "float16.npz", exact)
    (expected,) = _core.read_class_shares([tmp_path / "float16.npz"], image.shape[:2])
    assert np.array_equal(expected.classes, soft.classes)


def test_segments_are_written_as_labels(plain: Path, tmp_path: Path) -> None:
    assert run("label", plain, "--points", "segments", "-o", tmp_path / "out").exit_code == 0
    new = read_drive(tmp_path / "out")
    labels = np.fromfile(new.resolve(str(new.frames[0].point_labels)), np.uint32)
    kinds, segments = labels & 0xFFFF, labels >> 16
    assert set(np.unique(kinds)) == {0, 1, 2}
    assert np.array_equal(segments == 0, kinds == 0)
    assert all(len(np.unique(kinds[segments == each])) == 1 for each in np.unique(segments))
    assert new.classes is not None
    assert new.classes.points == {"ground": (1,), "objects": (2,)}


@pytest.mark.parametrize("by", ["segments", "network"])
def test_entries_that_are_no_points_keep_their_places(plain: Path, tmp_path: Path, by: str) -> None:
    for file in (plain / "points").iterdir():
        points = np.fromfile(file, np.float32).reshape(-1, 4)
        points[100:300] = 0.0
        points.tofile(file)
    options: tuple[object, ...] = ("--points", "segments")
    if by == "network":
        net = range_network(tmp_path / "net.onnx", 5, 16, 128, 1, 0.0)
        (tmp_path / "net.yaml").write_text(yaml.safe_dump(POINT_CARD))
        options = ("--point-model", net)
    found = run("label", plain, *options, "-o", tmp_path / "out")
    assert found.exit_code == 0, found.output
    new = read_drive(tmp_path / "out")
    for frame, cloud in zip(new.frames, read_clouds(new), strict=True):
        assert cloud.labels is not None
        labels = np.fromfile(new.resolve(str(frame.point_labels)), np.uint32)
        assert len(labels) == len(cloud.is_return)
        assert cloud.num_no_returns >= 200
        assert np.array_equal(cloud.labels, labels[cloud.is_return] & 0xFFFF)
        assert set(cloud.labels) <= ({1, 2} if by == "network" else {0, 1, 2})


def test_calibrate_labels_on_the_way(plain: Path, tmp_path: Path) -> None:
    net = street_network(tmp_path)
    arguments = ("calibrate", plain, "--image-model", net, "--no-polish", "-o", tmp_path / "out.yaml")
    first = run(*arguments)
    assert first.exit_code in (0, 3), first.output
    (folder,) = (plain / ".semcal_labels").iterdir()
    times = {file: file.stat().st_mtime_ns for file in folder.glob("image_labels/*.png")}
    result = (tmp_path / "out.yaml").read_bytes()
    (labelled,) = folder.glob("drive_*.yaml")
    assert yaml.safe_load(result)["input"]["drive"].endswith(f".semcal_labels/{folder.name}/{labelled.name}")
    assert run(*arguments).exit_code == first.exit_code
    assert {file: file.stat().st_mtime_ns for file in times} == times
    assert (tmp_path / "out.yaml").read_bytes() == result
    # Other frames are another drive, by the same labels.
    run(*arguments, "--max-frames", "1")
    assert len(list(folder.glob("drive_*.yaml"))) == 2
    # Another picture has another name in the cache.
    picture = sorted((plain / "images").iterdir())[0]
    cv2.imwrite(str(picture), cv2.imread(str(picture))[:, ::-1])
    run(*arguments)
    assert len(list(folder.glob("image_labels/*.png"))) == len(times) + 1


def test_batch_labels_on_the_way(plain: Path, tmp_path: Path) -> None:
    net = street_network(tmp_path)
    found = run("batch", plain, "-o", tmp_path / "out", "-q", "--", "--image-model", net, "--no-polish")
    assert found.exit_code in (0, 3), found.output
    assert (plain / ".semcal_labels").is_dir()
    (line,) = (json.loads(text) for text in (tmp_path / "out/summary.jsonl").read_text().splitlines())
    assert line["status"] in ("not_assessed", "not_trusted")


def test_what_was_understood_is_told(tmp_path: Path) -> None:
    net = color_network(tmp_path / "net.onnx", (64, 96), stride=4)
    shown = run("label", "--show", net)
    assert shown.exit_code == 0, shown.output
    for text in ("'x' 1 x 3 x 64 x 96 float32", "96 x 64, stretch", "guessed   colours are red, green, blue"):
        assert text in shown.output
    card(tmp_path)
    shown = run("label", "--show", net)
    assert "guessed" not in shown.output
    assert "classes   6: a, b, c, d, e, f" in shown.output


@pytest.mark.parametrize("name", card_names())
def test_ready_cards_are_whole(name: str) -> None:
    path = find_card(name, Path("none.onnx"))
    assert path is not None
    found = read_card(path)
    classes, ignored = read_classes(found, path)
    assert len(classes) >= 2
    assert not {value for ids in classes.values() for value in ids} & set(ignored)


@pytest.mark.parametrize(
    ("classes", "named"),
    [
        ("voc", {"bicycle", "person"}),
        (["a", "b"], {"b"}),
        ({"a": [0, 1], "b": [0x7F]}, {"a", "b"}),
    ],
)
def test_ignored_ids_have_no_name(tmp_path: Path, classes: object, named: set[str]) -> None:
    card(tmp_path, classes=classes, ignore=[0])
    found, ignored = read_classes(read_card(tmp_path / "net.yaml"), tmp_path / "net.yaml")
    assert named <= set(found)
    assert 0 in ignored
    assert not {0} & {value for ids in found.values() for value in ids}


# Complaints


def _no_model(folder: Path) -> None:
    (folder / "net.onnx").write_bytes(b"no model" * 100)


def _external(location: str) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        color_network(folder / "net.onnx")
        model = onnx.load(str(folder / "net.onnx"))
        weights = next(each for each in model.graph.initializer if each.name == "w")
        (folder.parent / "outside.bin").write_bytes(weights.raw_data)
        weights.ClearField("raw_data")
        weights.data_location = TensorProto.EXTERNAL
        weights.external_data.add(key="location", value=location)
        (folder / "net.onnx").write_bytes(model.SerializeToString())

    return make


def _constant(values: np.ndarray, kind: int = TensorProto.FLOAT) -> Callable[[Path], None]:
    """A network that gives these values, whatever it sees."""

    def make(folder: Path) -> None:
        nodes = [helper.make_node("Identity", ["k"], ["y"])]
        inputs = {"x": (TensorProto.FLOAT, [1, 3, "h", "w"])}
        save(folder / "net.onnx", nodes, inputs, {"y": (kind, values.shape)}, {"k": values})

    return make


def _two_inputs(folder: Path) -> None:
    shape = [1, 3, 8, 8]
    nodes = [helper.make_node("Add", ["x", "z"], ["y"])]
    inputs = {"x": (TensorProto.FLOAT, shape), "z": (TensorProto.FLOAT, shape)}
    save(folder / "net.onnx", nodes, inputs, {"y": (TensorProto.FLOAT, shape)})


def _with_card(**values: object) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        color_network(folder / "net.onnx", (64, 96))
        card(folder, **values)

    return make


BROKEN: dict[str, tuple[Callable[[Path], None], str]] = {
    "no file": (lambda folder: None, r"net\.onnx: no such file or folder"),
    "no model": (_no_model, r"net\.onnx: found no model that onnxruntime can open: "),
    "weights above the model": (
        _external("../outside.bin"),
        r"net\.onnx: found no model .*escapes model directory",
    ),
    "weights anywhere": (_external("/etc/hostname"), r"net\.onnx: found no model .*[Aa]bsolute path"),
    "two inputs": (_two_inputs, r"net\.onnx: found inputs x, z, needed one: a picture or a range image"),
    "one class": (
        _constant(np.ones((1, 1, 32, 48), np.float32)),
        r"net\.onnx: found scores of 1 class, needed two or more",
    ),
    "rank": (
        _constant(np.ones((1, 5), np.float32)),
        r"net\.onnx: found output 'y' 1 x 5 float32, needed four axes",
    ),
    "not finite": (
        _constant(np.full((1, 3, 32, 48), np.nan, np.float32)),
        r"net\.onnx: found a score that is NaN, needed finite ones",
    ),
    "negative ids": (
        _constant(np.full((1, 32, 48), -1, np.int64), TensorProto.INT64),
        r"net\.onnx: found ids from -1 to -1, needed 0 to 65534",
    ),
    "stride": (
        _constant(np.ones((1, 7, 32, 9), np.float32)),
        r"net\.onnx: found output of 1 x 7 x 32 x 9 for \d+ x \d+ pixels, needed rows and columns of one stride",
    ),
    "unknown key": (
        _with_card(colour="rgb"),
        r"net\.yaml: unknown key 'colour'; the nearest known key is 'color'",
    ),
    "other size": (
        _with_card(size=[100, 64]),
        r"net\.yaml: size: found 100 columns, needed the 96 of .*net\.onnx",
    ),
    "no such output": (_with_card(output="z"), r"net\.yaml: output: found 'z', needed one of: y"),
    "no such classes": (
        _with_card(classes="cityscape"),
        r"found class table 'cityscape', needed a file or one of: ",
    ),
    "unscaled mean": (
        _with_card(scale=None, mean=[123.7]),
        r"net\.yaml: mean: found 123\.7, needed at most 2 for pixels from 0 to 1, or scale: 1\.0",
    ),
    "too few classes": (_with_card(classes=["a", "b"]), r"net\.yaml: classes: found 2 names, needed 6"),
    "point card": (
        lambda folder: (
            color_network(folder / "net.onnx"),
            (folder / "net.yaml").write_text(yaml.safe_dump(POINT_CARD)),
        )[0],
        r"net\.onnx: found input .*, needed 1 x 5 x 16 x 128 float, as .*net\.yaml says",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_model_or_card_is_one_line(plain: Path, tmp_path: Path, name: str) -> None:
    make, message = BROKEN[name]
    folder = tmp_path / "models"
    folder.mkdir()
    make(folder)
    found = run("label", plain, "--image-model", folder / "net.onnx", "-o", tmp_path / "out")
    assert isinstance(found.exception, SemcalError), found.output
    text = str(found.exception)
    assert "\n" not in text
    assert re.search(message, text), text
    assert not (tmp_path / "out/drive.yaml").exists()


def test_labels_never_replace_what_they_have_not_made(plain: Path, tmp_path: Path) -> None:
    net = street_network(tmp_path)
    found = run("label", plain, "--image-model", net, "-o", plain)
    assert "found the drive that is read, needed another name" in str(found.exception)
    folder = tmp_path / "out/image_labels"
    folder.mkdir(parents=True)
    (folder / "mine.png").write_bytes(b"mine")
    found = run("label", plain, "--image-model", net, "-o", tmp_path / "out")
    assert "found files that `semcal label` has not written, needed another -o" in str(found.exception)


def test_pictures_that_are_absent_are_named(plain: Path, tmp_path: Path) -> None:
    net = street_network(tmp_path)
    document = yaml.safe_load((plain / "drive.yaml").read_text())
    del document["frames"][0]["image"]
    (plain / "drive.yaml").write_text(yaml.safe_dump(document))
    found = run("label", plain, "--image-model", net, "-o", tmp_path / "out")
    assert "].image: found nothing, needed a picture" in str(found.exception)
    assert len(Drive.model_validate(yaml.safe_load((tmp_path / "out/drive.yaml").read_text())).frames) > 0
