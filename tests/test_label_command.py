"""`semcal label`: files of labels, labels on the way to a calibration, and what is said of wrong models and cards."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest
import yaml
from commands import invoke
from conftest import edited
from networks import (
    POINT_CARD,
    card,
    color_network,
    constant_network,
    range_network,
    save,
    street_network,
)
from onnx import TensorProto, helper

from semcal_cli import core
from semcal_cli.cli.tables import COLUMNS
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError, SemcalError
from semcal_cli.labelling.card import card_names, find_card, read_card, read_classes
from semcal_cli.labelling.image_labeller import ImageLabeller
from semcal_cli.labelling.model import image_model
from semcal_cli.labelling.onnx_network import open_network
from semcal_cli.observations.reading import read_clouds, read_label_images


def test_a_labelled_drive_has_all_that_the_old_one_has(plain: Path, tmp_path: Path) -> None:
    net = street_network(tmp_path)
    result = invoke(
        "label", plain, "--image-model", net, "-o", tmp_path / "out", "--preview", tmp_path / "p.png"
    )
    assert result.exit_code == 0, result.output
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
    assert invoke(*arguments).exit_code == 0
    files = sorted((tmp_path / "out/image_labels").glob("*.png"))
    whole = [file.read_bytes() for file in files]
    files[0].unlink()
    files[1].write_bytes(whole[1][:50])
    result = invoke(*arguments)
    assert f"{len(files) - 2} label files reused" in result.output
    assert [file.read_bytes() for file in files] == whole
    card(tmp_path, classes=["sky", "road", "green", "brown"], color="bgr")
    result = invoke(*arguments)
    assert "found labels of another model, drive or settings; choose another -o, or --force" in str(
        result.exception
    )
    assert invoke(*arguments, "--force").exit_code == 0
    assert [file.read_bytes() for file in files] != whole


def test_names_do_not_depend_on_how_many_frames_are_labelled(plain: Path, tmp_path: Path) -> None:
    """Images of one name lie in folders of their own, so that labels are numbered."""
    net = street_network(tmp_path)
    with edited(plain) as document:
        for index, frame in enumerate(document["frames"]):
            folder = plain / f"at_{index}"
            folder.mkdir()
            shutil.move(plain / frame["image"], folder / "image.png")
            frame["image"] = f"at_{index}/image.png"
    arguments = ("label", plain, "--image-model", net)
    assert invoke(*arguments, "-o", tmp_path / "whole").exit_code == 0
    assert invoke(*arguments, "-o", tmp_path / "some", "--max-frames", "2").exit_code == 0
    assert len(read_drive(tmp_path / "some").frames) == 2
    assert invoke(*arguments, "-o", tmp_path / "some").exit_code == 0
    whole, some = (sorted((tmp_path / name / "image_labels").glob("*.png")) for name in ("whole", "some"))
    assert [file.name for file in whole] == [file.name for file in some]
    assert [file.read_bytes() for file in whole] == [file.read_bytes() for file in some]
    with edited(plain) as document:
        document["frames"].reverse()
    result = invoke(*arguments, "-o", tmp_path / "some")
    assert "found labels of another model, drive or settings" in str(result.exception)


def test_an_image_that_cannot_be_labelled_is_named_and_the_rest_is_done(plain: Path, tmp_path: Path) -> None:
    net, images = street_network(tmp_path), sorted((plain / "images").iterdir())
    with edited(plain) as document:
        absent = document["frames"][2]
        del absent["image"]
    images[1].write_bytes(images[1].read_bytes()[:900])
    first = f"{images[1]}: found a damaged image, expected an intact one"
    second = f"failed: {plain}/drive.yaml: frames[{absent['points']}].image: found nothing, expected an image"
    result = invoke("label", plain, "--image-model", net, "-o", tmp_path / "out")
    assert isinstance(result.exception, InputError)
    assert str(result.exception) == f"2 of {len(images)} frames failed; {first}"
    assert second in result.output.replace("\n", " ")
    assert len(read_drive(tmp_path / "out").frames) == len(images) - 2


def test_probabilities_are_those_that_a_calibration_reads(plain: Path, tmp_path: Path) -> None:
    net = street_network(tmp_path)
    for options, name in (((), "hard"), (("--probabilities",), "soft")):
        result = invoke("label", plain, "--image-model", net, "-o", tmp_path / name, *options)
        assert result.exit_code == 0, result.output
    hard, soft = (read_label_images(read_drive(tmp_path / name))[0] for name in ("hard", "soft"))
    assert isinstance(soft, core.ClassShares)
    # Shares in 1/255 may be equal where scores are not quite.
    assert np.mean(soft.classes == hard.ravel()) > 0.98
    labeller = ImageLabeller(image_model(open_network(net), None), read_drive(plain).camera)
    image = cv2.imread(str(sorted((plain / "images").iterdir())[0]))
    exact = labeller.shares(image).astype(np.float16) / 255
    np.savez(tmp_path / "float16.npz", exact)
    (expected,) = core.read_class_shares([tmp_path / "float16.npz"], image.shape[:2])
    assert np.array_equal(expected.classes, soft.classes)


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
    result = invoke("label", plain, *options, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    new = read_drive(tmp_path / "out")
    for frame, cloud in zip(new.frames, read_clouds(new), strict=True):
        assert cloud.labels is not None
        labels = np.fromfile(new.resolve(str(frame.point_labels)), np.uint32)
        assert len(labels) == len(cloud.is_kept)
        assert cloud.num_no_returns >= 200
        assert np.array_equal(cloud.labels, labels[cloud.is_kept] & 0xFFFF)
        assert set(cloud.labels) <= ({1, 2} if by == "network" else {0, 1, 2})
        if by == "segments":
            kinds, segments = labels & 0xFFFF, labels >> 16
            assert np.array_equal(segments == 0, kinds == 0)
            assert all(len(np.unique(kinds[segments == segment])) == 1 for segment in np.unique(segments))
    assert new.classes is not None
    classes = {"near": (1,), "far": (2,)} if by == "network" else {"ground": (1,), "objects": (2,)}
    assert new.classes.points == classes


def test_calibrate_labels_on_the_way(plain: Path, tmp_path: Path) -> None:
    net = street_network(tmp_path)
    options = ("--init", plain, "--no-polish", "-o", tmp_path / "out.yaml")
    arguments = ("calibrate", plain, "--image-model", net, *options)
    first = invoke(*arguments)
    assert first.exit_code in (0, 3), first.output
    (folder,) = (plain / ".semcal_labels").iterdir()
    times = {file: file.stat().st_mtime_ns for file in folder.glob("image_labels/*.png")}
    result = (tmp_path / "out.yaml").read_bytes()
    (labelled,) = folder.glob("drive_*.yaml")
    assert yaml.safe_load(result)["input"]["drive"].endswith(f".semcal_labels/{folder.name}/{labelled.name}")
    assert invoke(*arguments).exit_code == first.exit_code
    assert {file: file.stat().st_mtime_ns for file in times} == times
    assert (tmp_path / "out.yaml").read_bytes() == result
    # Other frames are another drive, by the same labels.
    invoke(*arguments, "--max-frames", "1")
    assert len(list(folder.glob("drive_*.yaml"))) == 2
    # Another image has another name in the cache.
    file = sorted((plain / "images").iterdir())[0]
    cv2.imwrite(str(file), cv2.imread(str(file))[:, ::-1])
    invoke(*arguments)
    assert len(list(folder.glob("image_labels/*.png"))) == len(times) + 1


def test_what_was_understood_is_told(tmp_path: Path) -> None:
    net = color_network(tmp_path / "net.onnx", (64, 96), stride=4)
    shown = invoke("label", "--show", net)
    assert shown.exit_code == 0, shown.output
    for text in (
        "'x' 1 x 3 x 64 x 96 float32",
        "96 x 64, stretch",
        "guessed   colours are in the order red, green, blue",
    ):
        assert text in shown.output
    assert max(map(len, shown.output.splitlines())) <= COLUMNS
    card(tmp_path)
    shown = invoke("label", "--show", net)
    assert "guessed" not in shown.output
    assert "classes   6: a, b, c, d, e, f" in shown.output


@pytest.mark.parametrize("name", card_names())
def test_ready_cards_are_whole(name: str) -> None:
    path = find_card(name, Path("none.onnx"))
    assert path is not None
    card = read_card(path)
    classes, ignored = read_classes(card, path)
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
    classes_read, ignored = read_classes(read_card(tmp_path / "net.yaml"), tmp_path / "net.yaml")
    assert named <= set(classes_read)
    assert 0 in ignored
    assert not {0} & {value for ids in classes_read.values() for value in ids}


def _external(location: str) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        color_network(folder / "net.onnx")
        model = onnx.load(str(folder / "net.onnx"))
        weights = next(tensor for tensor in model.graph.initializer if tensor.name == "w")
        (folder.parent / "outside.bin").write_bytes(weights.raw_data)
        weights.ClearField("raw_data")
        weights.data_location = TensorProto.EXTERNAL
        weights.external_data.add(key="location", value=location)
        (folder / "net.onnx").write_bytes(model.SerializeToString())

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


def _point_card(folder: Path) -> None:
    color_network(folder / "net.onnx")
    (folder / "net.yaml").write_text(yaml.safe_dump(POINT_CARD))


OF_NETWORKS: tuple[tuple[Callable[[Path], object], str], ...] = (
    (lambda folder: None, "no such file or folder"),
    (lambda folder: (folder / "net.onnx").write_bytes(b"none"), "is not a model that onnxruntime can open: "),
    (_external("../outside.bin"), "is not a model .*escapes model directory"),
    (
        _two_inputs,
        "found additional inputs z, expected only an image, or constants for them in a card",
    ),
    (_point_card, "found a card for sweeps, expected one for images"),
    (constant_network(np.ones((1, 1, 32, 48))), "found scores of 1 class, expected two or more"),
    (constant_network(np.full((1, 3, 32, 48), np.nan)), "found a score that is NaN, expected finite ones"),
    (constant_network(np.full((1, 32, 48), -1)), "found ids from -1 to -1, needed 0 to 65534"),
    (
        constant_network(np.ones((1, 7, 32, 9))),
        "found output of 1 x 7 x 32 x 9 for .*, expected the same stride for rows",
    ),
)
"""Makers of a network, and what is said of it."""
OF_CARDS: tuple[tuple[dict[str, object], str], ...] = (
    ({"constants": {"z": [1]}}, "constants: found z, expected one of: none"),
    ({"colour": "rgb"}, "unknown key 'colour'; the nearest known key is 'color'"),
    ({"size": [100, 64]}, r"size: found 100 columns, needed 96, as .*net\.onnx states"),
    ({"fit": "aspect"}, "fit: found aspect without size, expected both"),
    (
        {"fit": "aspect", "size": [96, 64]},
        r"fit: found aspect, expected another: the size of .*net\.onnx is fixed",
    ),
    ({"multiple": 32}, "multiple: found fit: stretch, expected fit: aspect"),
    ({"classes": "cityscape"}, "classes: found class table 'cityscape', expected a file or one of: "),
    ({"classes": ["a", "b"]}, "classes: found 2 names, needed 6"),
    ({"classes": ["a", "a"]}, "classes: found 'a' twice, expected different names"),
    (
        {"scale": None, "mean": [123.7]},
        r"mean: found 123\.7, needed at most 2 for .* from 0 to 1, or scale: 1\.0",
    ),
)
"""Keys of a card, and what is said of them."""
BROKEN = [
    *((make, rf"net\.onnx: {message}") for make, message in OF_NETWORKS),
    *((_with_card(**values), rf"net\.yaml: {message}") for values, message in OF_CARDS),
]


@pytest.mark.parametrize(("make", "message"), BROKEN, ids=[message for _, message in BROKEN])
def test_a_broken_model_or_card_is_one_line(
    plain: Path, tmp_path: Path, make: Callable[[Path], object], message: str
) -> None:
    folder = tmp_path / "models"
    folder.mkdir()
    make(folder)
    result = invoke("label", plain, "--image-model", folder / "net.onnx", "-o", tmp_path / "out")
    assert isinstance(result.exception, SemcalError), result.output
    text = str(result.exception)
    assert "\n" not in text
    assert re.search(message, text), text
    assert not (tmp_path / "out/drive.yaml").exists()


def test_labels_never_replace_what_they_have_not_made(plain: Path, tmp_path: Path) -> None:
    net = street_network(tmp_path)
    result = invoke("label", plain, "--image-model", net, "-o", plain)
    assert "found the input drive; choose another name" in str(result.exception)
    folder = tmp_path / "out/image_labels"
    folder.mkdir(parents=True)
    (folder / "mine.png").write_bytes(b"mine")
    result = invoke("label", plain, "--image-model", net, "-o", tmp_path / "out")
    assert "found files that `semcal label` did not write; choose another -o" in str(result.exception)
