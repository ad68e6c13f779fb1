"""The files of transformers beside a network are its card."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from networks import COLORS, NAMES, color_network, save
from onnx import TensorProto, helper

from semcal_cli.drive.camera import Camera
from semcal_cli.errors import InputError
from semcal_cli.importing.ontologies import read_ontology
from semcal_cli.labelling.card import ImageCard
from semcal_cli.labelling.image_labeller import ImageLabeller
from semcal_cli.labelling.model import image_model
from semcal_cli.labelling.onnx_network import Network, Port, open_network
from semcal_cli.labelling.sidecars import read_sidecars

MEAN, STD = [0.485, 0.456, 0.406], [0.229, 0.224, 0.225]
HALF = [0.5, 0.5, 0.5]
BYTE = 1 / 255
CITYSCAPES = list(read_ontology("cityscapes-train").ids())
MAPILLARY = [*read_ontology("mapillary").ids(), "Car Mount", "Ego Vehicle"]
VOC = list(read_ontology("voc").ids())
NORMALISED = {"scale": BYTE, "mean": tuple(MEAN), "std": tuple(STD), "color": "rgb"}
ANY, SQUARE = (None, 3, None, None), (1, 3, 640, 640)
LOGITS, MASKS = ("logits",), ("class_queries_logits", "masks_queries_logits")


def preprocessor(**values: object) -> dict[str, Any]:
    """What all processors of transformers write."""
    usual = {"do_normalize": True, "do_rescale": True, "do_resize": True, "resample": 2}
    return usual | {"image_mean": MEAN, "image_std": STD, "rescale_factor": BYTE} | values


def write(folder: Path, architecture: str, names: list[str], processor: dict[str, Any] | None) -> None:
    config = {
        "architectures": [architecture],
        "id2label": {str(index): name for index, name in enumerate(names)},
        "model_type": architecture.split("For")[0].lower(),
        "image_size": 384,
    }
    (folder / "config.json").write_text(json.dumps(config))
    if processor is not None:
        (folder / "preprocessor_config.json").write_text(json.dumps(processor))


def read(path: Path, shape: tuple[int | None, ...], outputs: tuple[str, ...]) -> ImageCard:
    """Read the sidecars of a network of this shape; nothing of it is run."""
    ports = tuple(Port(name, (None,) * 4, "float32") for name in outputs)
    card = read_sidecars(Network(path, None, (Port("pixel_values", shape, "float32"),), ports))  # type: ignore[arg-type]
    assert card is not None
    return card[0]


OF_ARCHITECTURES: dict[str, tuple[str, list[str], dict[str, Any], Any, tuple[str, ...], dict[str, Any]]] = {
    "SegFormer": (
        "SegformerForSemanticSegmentation",
        CITYSCAPES,
        preprocessor(
            size={"height": 1024, "width": 2048}, do_reduce_labels=False, feature_extractor_type="x"
        ),
        ANY,
        LOGITS,
        NORMALISED
        | {"size": (2048, 1024), "fit": "stretch", "kind": "logits", "output": "logits", "ignore": (255,)},
    ),
    "SegFormer of an old transformers": (
        "SegformerForSemanticSegmentation",
        CITYSCAPES,
        {"do_normalize": True, "do_resize": True, "image_mean": MEAN, "image_std": STD, "size": 512},
        ANY,
        LOGITS,
        NORMALISED | {"size": (512, 512)},
    ),
    "SegFormer of a size": (
        "SegformerForSemanticSegmentation",
        CITYSCAPES,
        preprocessor(size={"height": 512, "width": 512}),
        SQUARE,
        LOGITS,
        NORMALISED | {"size": None, "fit": "stretch"},
    ),
    "UperNet": (
        "UperNetForSemanticSegmentation",
        CITYSCAPES,
        preprocessor(size={"height": 512, "width": 512}, do_reduce_labels=True),
        ANY,
        LOGITS,
        NORMALISED | {"size": (512, 512), "kind": "logits"},
    ),
    "DPT": (
        "DPTForSemanticSegmentation",
        CITYSCAPES,
        preprocessor(
            size={"height": 480, "width": 480}, image_mean=HALF, image_std=HALF, do_pad=False, resample=3
        ),
        ANY,
        LOGITS,
        {
            "resample": "bicubic",
            "mask_size": None,
            "size": (480, 480),
            "mean": tuple(HALF),
            "std": tuple(HALF),
        },
    ),
    "DPT of an aspect": (
        "DPTForSemanticSegmentation",
        CITYSCAPES,
        preprocessor(size={"height": 480, "width": 480}, keep_aspect_ratio=True, ensure_multiple_of=32),
        ANY,
        LOGITS,
        {"size": (480, 480), "fit": "aspect", "multiple": 32},
    ),
    "DPT of an aspect and a size": (
        "DPTForSemanticSegmentation",
        CITYSCAPES,
        preprocessor(size={"height": 480, "width": 480}, keep_aspect_ratio=True, ensure_multiple_of=32),
        SQUARE,
        LOGITS,
        {"size": None, "fit": "letterbox", "multiple": 1},
    ),
    "DPT of a multiple": (
        "DPTForSemanticSegmentation",
        CITYSCAPES,
        preprocessor(size={"height": 480, "width": 500}, keep_aspect_ratio=False, ensure_multiple_of=32),
        ANY,
        LOGITS,
        {"size": (512, 480), "fit": "stretch", "multiple": 1},
    ),
    "MobileViT": (
        "MobileViTForSemanticSegmentation",
        VOC,
        {
            "crop_size": {"height": 512, "width": 512},
            "do_center_crop": True,
            "do_flip_channel_order": True,
            "do_resize": True,
            "size": {"shortest_edge": 544},
        },
        ANY,
        LOGITS,
        {"color": "bgr", "scale": BYTE, "mean": None, "std": None, "short_side": 544, "long_side": None},
    ),
    "Mask2Former": (
        "Mask2FormerForUniversalSegmentation",
        MAPILLARY,
        preprocessor(size={"shortest_edge": 800, "longest_edge": 1333}, size_divisor=32, ignore_index=255),
        ANY,
        MASKS,
        NORMALISED
        | {"kind": "masks", "short_side": 800, "long_side": 1333, "ignore": (63, 64, 65, 255)}
        | {"mask_size": (384, 384), "resample": "bilinear"},
    ),
    "MaskFormer of an old transformers": (
        "MaskFormerForInstanceSegmentation",
        CITYSCAPES,
        {"do_normalize": True, "image_mean": MEAN, "image_std": STD, "size": 640, "max_size": 2560},
        ANY,
        MASKS,
        NORMALISED | {"kind": "masks", "short_side": 640, "long_side": 2560, "size": None},
    ),
    "OneFormer of a size": (
        "OneFormerForUniversalSegmentation",
        CITYSCAPES,
        preprocessor(size={"shortest_edge": 640, "longest_edge": 2560}),
        SQUARE,
        MASKS,
        NORMALISED | {"kind": "masks", "fit": "letterbox", "short_side": None, "size": None},
    ),
    "EoMT with windows": (
        "EomtForUniversalSegmentation",
        CITYSCAPES,
        preprocessor(
            size={"shortest_edge": 1024, "longest_edge": None},
            do_split_image=True,
            do_pad=False,
            crop_size=None,
        ),
        (1, 3, 1024, 1024),
        MASKS,
        NORMALISED
        | {"kind": "masks", "fit": "tiles", "short_side": 1024, "size": None}
        | {"overlap": 0.0, "mask_size": (1024, 1024)},
    ),
    "EoMT with a border": (
        "EomtForUniversalSegmentation",
        CITYSCAPES,
        preprocessor(size={"shortest_edge": 640, "longest_edge": 640}, do_split_image=False, do_pad=True),
        ANY,
        MASKS,
        NORMALISED | {"fit": "letterbox", "place": "corner", "size": (640, 640), "short_side": None},
    ),
}
"""Architecture, names, preprocessor_config.json, shape of the input and outputs, and what a card then says."""


@pytest.mark.parametrize("name", OF_ARCHITECTURES)
def test_sidecars_are_a_card(tmp_path: Path, name: str) -> None:
    architecture, names, processor, shape, outputs, expected = OF_ARCHITECTURES[name]
    write(tmp_path, architecture, names, processor)
    sidecar_card = read(tmp_path / "net.onnx", shape, outputs)
    assert {key: getattr(sidecar_card, key) for key in expected} == expected
    assert sidecar_card.layout == "channels_first"
    assert isinstance(sidecar_card.classes, dict)
    assert list(sidecar_card.classes) == names


@pytest.mark.parametrize(
    ("image", "multiple", "expected"),
    [
        ((1920, 1080), 32, (864, 480)),  # the height changes less: 480 / 1080 of 1920 is 853.3
        ((1080, 1920), 32, (480, 864)),
        ((1920, 1080), 1, (853, 480)),
        ((300, 400), 14, (364, 476)),  # by 480 / 400, not by 480 / 300
        ((600, 400), 1, (720, 480)),  # by 4 / 5 or by 6 / 5, which change it as much: the height's counts
    ],
)
def test_dpt_keeps_the_aspect_of_an_image(
    tmp_path: Path, image: tuple[int, int], multiple: int, expected: tuple[int, int]
) -> None:
    """The side that changes less gives the factor of both, as in transformers' `get_resize_output_image_size`."""
    color_network(tmp_path / "net.onnx")
    processor = preprocessor(
        size={"height": 480, "width": 480}, keep_aspect_ratio=True, ensure_multiple_of=multiple
    )
    write(tmp_path, "DPTForSemanticSegmentation", NAMES, processor)
    model = image_model(open_network(tmp_path / "net.onnx"), None)
    assert model.card.size_for(*image) == expected


@pytest.mark.parametrize(
    ("image", "long_side", "expected"),
    [
        ((1920, 1208), None, (1627, 1024)),  # 1627.5, rounded down
        ((1208, 1920), None, (1024, 1627)),
        ((1920, 1208), 1333, (1333, 839)),  # 838.68, rounded
        ((1242, 375), 1333, (1333, 402)),
    ],
)
def test_the_shorter_side_is_scaled_as_in_transformers(
    tmp_path: Path, image: tuple[int, int], long_side: int | None, expected: tuple[int, int]
) -> None:
    """The expected sizes are those of `get_size_with_aspect_ratio`."""
    color_network(tmp_path / "net.onnx")
    size = {"shortest_edge": 1024, "longest_edge": long_side}
    write(tmp_path, "MobileViTForSemanticSegmentation", NAMES, preprocessor(size=size))
    assert image_model(open_network(tmp_path / "net.onnx"), None).card.scaled_size(image) == expected


def test_without_a_preprocessor_the_size_is_that_of_the_config(tmp_path: Path) -> None:
    write(tmp_path, "DPTForSemanticSegmentation", CITYSCAPES, None)
    sidecar_card = read(tmp_path / "net.onnx", ANY, LOGITS)
    assert (sidecar_card.size, sidecar_card.scale, sidecar_card.mean) == ((384, 384), None, None)


def test_a_newer_transformers_writes_one_file_of_all_processors(tmp_path: Path) -> None:
    write(tmp_path, "SegformerForSemanticSegmentation", CITYSCAPES, None)
    of_images = preprocessor(size={"height": 512, "width": 768}, resample=3)
    (tmp_path / "processor_config.json").write_text(json.dumps({"image_processor": of_images}))
    sidecar_card = read(tmp_path / "net.onnx", ANY, LOGITS)
    assert (sidecar_card.size, sidecar_card.resample, sidecar_card.mean) == (
        (768, 512),
        "bicubic",
        tuple(MEAN),
    )


def test_oneformer_is_told_its_task(tmp_path: Path) -> None:
    """Classes and masks come out only if the tokens are those of "the task is semantic"."""
    tokens = np.array([[49406, 518, 10549, 533, 29119, 1550, 49407, 0, 0]])
    masks = np.random.default_rng(1).normal(size=(1, 2, 4, 6)).astype(np.float32)
    classes = np.array([[[9.0, 0.0, 0.0], [0.0, 9.0, 0.0]]], np.float32)
    nodes = [
        helper.make_node("Equal", ["task_inputs", "tokens"], ["same"]),
        helper.make_node("Cast", ["same"], ["ones"], to=TensorProto.FLOAT),
        helper.make_node("ReduceMin", ["ones"], ["is told"], keepdims=0),
        helper.make_node("Mul", ["classes", "is told"], ["class_queries_logits"]),
        helper.make_node("Identity", ["masks"], ["masks_queries_logits"]),
    ]
    inputs = {
        "pixel_values": (TensorProto.FLOAT, (1, 3, 64, 96)),
        "task_inputs": (TensorProto.INT64, (1, tokens.size)),
    }
    outputs = {
        "class_queries_logits": (TensorProto.FLOAT, classes.shape),
        "masks_queries_logits": (TensorProto.FLOAT, masks.shape),
    }
    save(
        tmp_path / "net.onnx", nodes, inputs, outputs, {"tokens": tokens, "classes": classes, "masks": masks}
    )
    write(tmp_path, "OneFormerForUniversalSegmentation", ["a", "b"], preprocessor())
    model = image_model(open_network(tmp_path / "net.onnx"), None)
    K = ((60.0, 0.0, 47.5), (0.0, 60.0, 31.5), (0.0, 0.0, 1.0))
    labeller = ImageLabeller(model, Camera(model="plumb_bob", width=6, height=4, K=K))
    assert np.array_equal(labeller.ids(np.zeros((4, 6, 3), np.uint8)), masks[0].argmax(0))


def test_names_that_mean_nothing_are_ignored_and_equal_names_are_one_class(tmp_path: Path) -> None:
    write(
        tmp_path,
        "SegformerForSemanticSegmentation",
        ["road", "ego vehicle", "road", "Unlabeled", "sky"],
        None,
    )
    sidecar_card = read(tmp_path / "net.onnx", ANY, LOGITS)
    assert sidecar_card.classes == {"road": (0, 2), "ego vehicle": (1,), "Unlabeled": (3,), "sky": (4,)}
    assert sidecar_card.ignore == (1, 3)
    write(tmp_path, "SegformerForSemanticSegmentation", ["LABEL_0", "LABEL_1"], None)
    assert read(tmp_path / "net.onnx", ANY, LOGITS).classes is None


@pytest.mark.parametrize(
    ("config", "processor", "message"),
    [
        (
            {"architectures": ["ResNetForImageClassification"]},
            {},
            r"config\.json: architectures: found 'ResNetForImageClassification', expected one for semantic "
            "segmentation",
        ),
        (
            {"architectures": "SegformerForSemanticSegmentation"},
            {},
            r"config\.json: architectures: found .*, expected a list",
        ),
        ({"id2label": {"x": "road"}}, {}, r"config\.json: id2label: found id 'x', expected a whole number"),
        ({"id2label": {"0": 3}}, {}, r"config\.json: id2label\['0'\]: found 3, expected text"),
        ({}, {"resample": 6}, r"preprocessor_config\.json: resample: found 6, needed at most 5"),
        ({}, {"image_mean": ["a"]}, r"preprocessor_config\.json: image_mean"),
        ({}, {"size": {"height": 0, "width": 3}}, r"preprocessor_config\.json: size\.height"),
        ({}, {"image_std": [0.0, 1.0, 1.0]}, r"config\.json: std\[0\]"),
    ],
)
def test_wrong_sidecars_are_one_line(
    tmp_path: Path, config: dict[str, Any], processor: dict[str, Any], message: str
) -> None:
    right = {"architectures": ["SegformerForSemanticSegmentation"], "id2label": {"0": "road", "1": "sky"}}
    (tmp_path / "config.json").write_text(json.dumps(right | config))
    (tmp_path / "preprocessor_config.json").write_text(json.dumps(preprocessor(**processor)))
    with pytest.raises(InputError, match=message):
        read(tmp_path / "net.onnx", ANY, LOGITS)


def test_a_config_of_another_program_is_none_of_transformers(tmp_path: Path) -> None:
    (tmp_path / "config.json").write_text(json.dumps({"epochs": 3}))
    network = Network(tmp_path / "net.onnx", None, (Port("x", ANY, "float32"),), ())  # type: ignore[arg-type]
    assert read_sidecars(network) is None


def test_a_local_network_is_labelled_by_its_sidecars(tmp_path: Path) -> None:
    """An image of twice the shorter side, in blue first and not normalised, as MobileViT's, in a folder `onnx`."""
    (tmp_path / "onnx").mkdir()
    color_network(tmp_path / "onnx/net.onnx", colors=COLORS[:, ::-1])
    processor = preprocessor(do_normalize=False, do_flip_channel_order=True, size={"shortest_edge": 64})
    write(tmp_path, "MobileViTForSemanticSegmentation", NAMES, processor)
    model = image_model(open_network(tmp_path / "onnx/net.onnx"), None)
    assert model.card_path == tmp_path / "config.json"
    assert not model.guesses
    K = ((60.0, 0.0, 47.5), (0.0, 60.0, 31.5), (0.0, 0.0, 1.0))
    labeller = ImageLabeller(model, Camera(model="plumb_bob", width=192, height=128, K=K))
    assert labeller.views.size == (96, 64)
    classes = np.kron(np.random.default_rng(0).integers(0, len(COLORS), (4, 6)), np.ones((32, 32), int))
    ids = labeller.ids(np.ascontiguousarray(COLORS[classes][..., ::-1]))
    # Scores of half the size are interpolated, so that a border may move by a pixel.
    inner = (
        cv2.erode(np.uint8(cv2.dilate(np.float32(classes), np.ones((3, 3))) == classes), np.ones((3, 3))) > 0
    )
    assert inner.mean() > 0.5
    assert np.array_equal(ids[inner], classes[inner])
