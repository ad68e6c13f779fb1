"""Cards from the files of transformers: config.json and preprocessor_config.json.

Newer versions write processor_config.json instead of the second, with the same keys one level deeper.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from semcal_cli.errors import InputError, mismatch
from semcal_cli.files.documents import read_document
from semcal_cli.files.validation import length, validate
from semcal_cli.importing.ontologies import ontology_names, read_ontology
from semcal_cli.labelling.card import CHANNELS, ImageCard
from semcal_cli.labelling.hub import SIDECARS
from semcal_cli.labelling.onnx_network import Network

CONFIG, PREPROCESSOR, PROCESSOR = SIDECARS
IMAGE_PROCESSOR = "image_processor"
"""Key of processor_config.json for the image processor."""
TASK = "task_inputs"
"""Input of OneFormer that states its task."""
SEMANTIC = (49406, 518, 10549, 533, 29119, 1550, 49407)
"""Tokens of "the task is semantic" in CLIP's vocabulary, as transformers' OneFormerProcessor; zeros follow."""
TASK_LENGTH = 77
"""Number of tokens, if the network takes any number: `task_seq_len` in OneFormer's usual config.json."""
ONNX_FOLDER = "onnx"
"""Folder of the ONNX files in a repository; the sidecars are in the folder above."""
DENSE = "ForSemanticSegmentation"
QUERIES = ("ForUniversalSegmentation", "MaskFormerForInstanceSegmentation")
"""Suffixes of the architectures with classes and masks of queries."""
BY_SHORTER_SIDE = ("MaskFormer", "Mask2Former", "OneFormer", "MobileViT", "MobileNet")
"""Prefixes of the architectures whose `size`, if it is one number, is that of the shorter side."""
RESAMPLES = ("nearest", "lanczos", "bilinear", "bicubic", "box", "hamming")
"""Pillow filters by their numbers in a preprocessor_config.json."""
MASK_SIZE = (384, 384)
"""Columns and rows to which transformers' post-processing of Mask2Former scales all masks."""
PLACEHOLDER = re.compile(r"LABEL_\d+")
"""Placeholder of transformers for a class without a name."""
UNINFORMATIVE = {
    "car mount",
    "ego vehicle",
    "out of roi",
    "rectification border",
    "unlabeled",
    "unlabelled",
    "void",
}
"""Names of classes that carry no information, in any class table."""


class _Lenient(BaseModel):
    """The keys that are used of a transformers file, which has many others."""

    model_config = ConfigDict(strict=True, frozen=True, extra="ignore", allow_inf_nan=False, defer_build=True)


def _as_edges(size: Any) -> Any:
    """Convert a size given as one number, or as rows and columns, to a mapping."""
    if isinstance(size, list) and len(size) == 2:
        return {"height": size[0], "width": size[1]}
    if isinstance(size, int) and not isinstance(size, bool):
        return {"one": size}
    return (
        {key: value for key, value in size.items() if value is not None} if isinstance(size, dict) else size
    )


Size = Annotated[dict[str, Annotated[int, Field(ge=1, le=1 << 16)]], BeforeValidator(_as_edges)]
ChannelValues = Annotated[
    tuple[float, ...],
    length(1, 3),
    BeforeValidator(lambda value: [value] if isinstance(value, float) else value),
]


class _Config(_Lenient):
    """config.json."""

    architectures: Annotated[tuple[str, ...], length(0)] | None = None
    id2label: dict[str, str] | None = None
    image_size: Size | None = None


class _Preprocessor(_Lenient):
    """preprocessor_config.json. Null means absent."""

    do_resize: bool | None = None
    size: Size | None = None
    resample: Annotated[int, Field(ge=0, le=len(RESAMPLES) - 1)] | None = None
    max_size: int | None = None
    keep_aspect_ratio: bool | None = None
    ensure_multiple_of: Annotated[int, Field(ge=1, le=1024)] | None = None
    do_pad: bool | None = None
    do_split_image: bool | None = None
    do_rescale: bool | None = None
    rescale_factor: float | None = None
    do_normalize: bool | None = None
    image_mean: ChannelValues | None = None
    image_std: ChannelValues | None = None
    do_flip_channel_order: bool | None = None


def read_sidecars(network: Network) -> tuple[ImageCard, Path] | None:
    """Read the card of a network from the transformers files beside it, or above its folder `onnx`.

    Returns:
        The card and the path of config.json; None if there is none, or it is not of transformers.

    Raises:
        InputError: a file is wrong, or the architecture is not one for semantic segmentation.
    """
    folder = network.path.parent
    folders = [folder, folder.parent] if folder.name == ONNX_FOLDER else [folder]
    path = next((candidate / CONFIG for candidate in folders if (candidate / CONFIG).exists()), None)
    if path is None:
        return None
    document = read_document(path)
    if not {"architectures", "id2label"} & set(document):
        return None
    config = validate(_Config, document, path)
    architecture = next(iter(config.architectures or ()), "")
    if not architecture.endswith((DENSE, *QUERIES)):
        shown = repr(architecture) if architecture else "none"
        needed = "one for semantic segmentation, as 'SegformerForSemanticSegmentation'"
        raise InputError(f"{path}: architectures: {mismatch(shown, needed)}")
    keys = {"layout": _layout(network)} | _classes(config, path) | _output(network, architecture)
    preprocessor = _preprocessor(path)
    if preprocessor is not None:
        keys |= _normalisation(preprocessor, architecture) | _size(preprocessor, architecture, network)
        keys |= _masks(preprocessor, architecture)
        if preprocessor.resample is not None:
            keys["resample"] = RESAMPLES[preprocessor.resample]
    elif not _has_size(network) and config.image_size is not None:
        keys |= _fit(config.image_size, _Preprocessor(), architecture)
    return validate(ImageCard, {"semcal_image_model": 1, **keys}, path), path


def _preprocessor(path: Path) -> _Preprocessor | None:
    """Read how transformers prepares images, from the files beside its config.json; None if none says."""
    beside, newer = path.with_name(PREPROCESSOR), path.with_name(PROCESSOR)
    if beside.exists():
        return validate(_Preprocessor, read_document(beside), beside)
    if newer.exists() and isinstance(keys := read_document(newer).get(IMAGE_PROCESSOR), dict):
        return validate(_Preprocessor, keys, newer)
    return None


def _classes(config: _Config, path: Path) -> dict[str, Any]:
    """Group ids by name, and ignore what a class table with these names ignores."""
    names: dict[int, str] = {}
    for key, name in (config.id2label or {}).items():
        if not key.isascii() or not key.isdigit():
            raise InputError(f"{path}: id2label: {mismatch(f'id {key!r}', 'a whole number')}")
        names[int(key)] = name.strip()
    if not names or all(map(PLACEHOLDER.fullmatch, names.values())):
        return {}
    classes: dict[str, list[int]] = {}
    for value, name in sorted(names.items()):
        classes.setdefault(name, []).append(value)
    return {
        "classes": classes,
        "ignore": _ids_to_ignore({value: _normalised_name(name) for value, name in names.items()}),
    }


def _ids_to_ignore(names: Mapping[int, str]) -> list[int]:
    ignored = [value for value, name in names.items() if name in UNINFORMATIVE]
    for table in map(read_ontology, ontology_names()):
        table_names = {value: _normalised_name(name) for name, ids in table.ids().items() for value in ids}
        if table_names.items() <= names.items():
            return sorted({*ignored, *table.ignore})
    return ignored


def _normalised_name(name: str) -> str:
    return " ".join(re.split(r"[\s_-]+", name.strip().lower()))


def _layout(network: Network) -> str:
    """Read the layout; transformers networks that state no sizes take channels first."""
    is_last = len(network.input.shape) == 4 and network.input.shape[1] not in (None, *CHANNELS)
    return "channels_last" if is_last else "channels_first"


def _output(network: Network, architecture: str) -> dict[str, Any]:
    if not architecture.endswith(DENSE):
        task = next((port for port in network.inputs if port.name == TASK), None)
        if task is None:
            return {"kind": "masks"}
        length = (task.shape[-1] if task.shape else None) or TASK_LENGTH
        return {"kind": "masks", "constants": {TASK: [*SEMANTIC, *[0] * (length - len(SEMANTIC))]}}
    has_logits = any(port.name == "logits" and port.dtype.startswith("float") for port in network.outputs)
    return {"output": "logits", "kind": "logits"} if has_logits else {}


def _normalisation(preprocessor: _Preprocessor, architecture: str) -> dict[str, Any]:
    """Read the scale, the mean, the standard deviation and the order of the colours."""
    flips = preprocessor.do_flip_channel_order
    keys: dict[str, Any] = {
        "color": "bgr" if (flips is None and "MobileViT" in architecture) or flips else "rgb"
    }
    normalises = preprocessor.do_normalize is not False and "MobileViT" not in architecture
    if normalises and (preprocessor.image_mean is None or preprocessor.image_std is None):
        return keys  # the rest is guessed, and the guess is printed
    factor = 1.0 / 255.0 if preprocessor.rescale_factor is None else preprocessor.rescale_factor
    keys["scale"] = 1.0 if preprocessor.do_rescale is False else factor
    if normalises:
        keys |= {"mean": preprocessor.image_mean, "std": preprocessor.image_std}
    return keys


def _masks(preprocessor: _Preprocessor, architecture: str) -> dict[str, Any]:
    """Read the size to which transformers' post-processing scales the masks of queries, if it does."""
    if architecture.startswith("Mask2Former"):
        return {"mask_size": MASK_SIZE}
    size = preprocessor.size or {}
    if architecture.startswith("Eomt") and "shortest_edge" in size:
        return {"mask_size": [size.get("longest_edge", size["shortest_edge"]), size["shortest_edge"]]}
    return {}


def _has_size(network: Network) -> bool:
    """Return whether a network states its size: rows and columns are neighbours in each layout."""
    return sum(size is not None and size > 4 for size in network.input.shape) >= 2


def _size(preprocessor: _Preprocessor, architecture: str, network: Network) -> dict[str, Any]:
    """Read how an image is brought to the network's size. A size that the network itself states counts."""
    if preprocessor.do_resize is False:
        return {}
    keys = _fit(preprocessor.size or {}, preprocessor, architecture)
    if not _has_size(network):
        return keys
    if keys.get("fit") == "tiles":
        return {key: value for key, value in keys.items() if key != "size"}
    keeps_aspect = "short_side" in keys or keys.get("fit") in ("aspect", "letterbox")
    placed = {"place": keys["place"]} if "place" in keys else {}
    return {"fit": "letterbox" if keeps_aspect else "stretch"} | placed


def _fit(size: Mapping[str, int], preprocessor: _Preprocessor, architecture: str) -> dict[str, Any]:
    """Express in the keys of a card how transformers resizes an image; crops are left out."""
    if "height" in size and "width" in size:
        return _fit_by_sides(size["width"], size["height"], preprocessor)
    side, longest = size.get("one"), preprocessor.max_size
    if side is not None and not architecture.startswith(BY_SHORTER_SIDE):
        return _fit_by_sides(side, side, preprocessor)
    side, longest = size.get("shortest_edge", side), size.get("longest_edge", longest)
    if side is None:
        return {}
    if preprocessor.do_split_image:
        return {"size": [side, side], "fit": "tiles", "short_side": side, "overlap": 0.0}
    if preprocessor.do_pad and side == longest and not architecture.startswith(BY_SHORTER_SIDE):
        return {"size": [side, side], "fit": "letterbox", "place": "corner"}
    return {"short_side": side} | ({} if longest is None else {"long_side": longest})


def _fit_by_sides(width: int, height: int, preprocessor: _Preprocessor) -> dict[str, Any]:
    """Express in the keys of a card a resize to a width and a height, or near them, as DPT's."""
    multiple = preprocessor.ensure_multiple_of or 1
    if preprocessor.keep_aspect_ratio:
        return {"size": [width, height], "fit": "aspect", "multiple": multiple}
    columns, rows = (max(round(side / multiple), 1) * multiple for side in (width, height))
    return {"size": [columns, rows], "fit": "stretch"}
