"""The model card: what a network wants and gives, where its file does not say."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import Discriminator, Field, Tag, field_validator, model_validator

from semcal_cli.datasets.ontologies import read_ontology
from semcal_cli.drive.camera import ImageSide
from semcal_cli.drive.document import Ids
from semcal_cli.errors import InputError, mismatch
from semcal_cli.files.documents import read_document
from semcal_cli.files.validation import StrictModel, Version, check_distinct, length, validate

CARDS = Path(__file__).parent / "cards"
"""Folder of the ready cards."""

MULTIPLE = 32
"""Sides of an image for a network that takes any size are a multiple of this, the stride of most encoders."""
MAX_SIDE = 4096
"""Largest side of an image for a network that takes any size."""

Fit: TypeAlias = Literal["stretch", "letterbox", "tiles", "aspect"]
Color: TypeAlias = Literal["rgb", "bgr", "gray"]
Layout: TypeAlias = Literal["channels_first", "channels_last"]
Kind: TypeAlias = Literal["logits", "probabilities", "ids", "masks"]
Resample: TypeAlias = Literal["nearest", "box", "bilinear", "hamming", "bicubic", "lanczos"]
Channel: TypeAlias = Literal["range", "x", "y", "z", "intensity", "mask"]

CloudChannel: TypeAlias = Literal["x", "y", "z", "intensity", "range", "ring"]

Factor = Annotated[float, Field(ge=-1e6, le=1e6)]
Spread = Annotated[float, Field(gt=0.0, le=1e6)]
Degrees = Annotated[float, Field(ge=-360.0, le=360.0)]
Token = Annotated[int, Field(ge=-(1 << 31), lt=1 << 31)]
ClassName = Annotated[str, Field(min_length=1)]


def _kind_of_classes(classes: object) -> str:
    return "ids" if isinstance(classes, dict) else "names" if isinstance(classes, list | tuple) else "table"


ClassesOfCard: TypeAlias = Annotated[
    Annotated[str, Field(min_length=1), Tag("table")]
    | Annotated[tuple[ClassName, ...], length(2), Tag("names")]
    | Annotated[dict[ClassName, Ids], Field(min_length=1), Tag("ids")],
    Discriminator(_kind_of_classes),
]
"""Classes as a card states them: the name of a table, a list of names, or ids by name."""


class Card(StrictModel):
    """What cards of networks for images and for sweeps share."""

    output: str | None = None
    """Name of the output, if the network has several."""
    classes: ClassesOfCard | None = None
    """Name of a class table, as cityscapes-train, or its file; or the names of the ids from 0 on; or ids by name."""
    ignore: Ids = ()
    """Ids that carry no information, beside those of the class table."""
    licence: Annotated[str, Field(min_length=1)] | None = None
    """Licence of the weights, as their project states it."""

    @field_validator("classes")
    @classmethod
    def _check_classes(cls, classes: object) -> object:
        if isinstance(classes, dict):
            check_distinct({name: [f"id {value}" for value in ids] for name, ids in classes.items()})
        if isinstance(classes, tuple) and len(set(classes)) < len(classes):
            twice = next(name for name in classes if classes.count(name) > 1)
            raise mismatch(f"{twice!r} twice", "different names")
        return classes


class ImageCard(Card):
    """Card of a network for images. What is absent is read from the model, or else guessed, and the guess is told."""

    semcal_image_model: Version
    """Version of this format."""
    size: Annotated[tuple[ImageSide, ...], length(2, 2)] | None = None
    """Columns and rows that the network wants, if it takes any; by default the image's, up to a multiple of 32."""
    fit: Fit = "stretch"
    """How an image comes to that size: stretched, scaled with a border around it, or cut into tiles that overlap."""
    overlap: Annotated[float, Field(ge=0.0, le=0.9)] = 0.25
    """Least share of a tile that its neighbour shows, too."""
    resample: Resample | None = None
    """How an image is scaled, in Pillow's words; by default the mean where it shrinks, and linearly where it grows."""
    multiple: Annotated[int, Field(ge=1, le=1024)] = 1
    """With `fit: aspect`, both sides are rounded to a multiple of this."""
    short_side: ImageSide | None = None
    """Length to which the shorter side of an image is scaled, without size or before it is cut into tiles."""
    long_side: ImageSide | None = None
    """Largest length of the longer side after that."""
    color: Color | None = None
    """Order of the colours; rgb if the network has three channels, gray if it has one."""
    scale: Spread | None = None
    """Factor of the pixels' values from 0 to 255; 1/255 by default."""
    mean: Annotated[tuple[Factor, ...], length(1, 3)] | None = None
    """What is subtracted after scaling, from each channel, or one number from all; 0 by default."""
    std: Annotated[tuple[Spread, ...], length(1, 3)] | None = None
    """What each channel is then divided by; 1 by default. Without scale, mean and std, ImageNet's are guessed."""
    layout: Layout | None = None
    """Place of the channels in the network's input."""
    kind: Kind | None = None
    """What the output is: logits or probabilities of each class, ids, or masks with classes as of Mask2Former."""
    constants: dict[str, Annotated[tuple[Token, ...], length(1)]] = {}
    """Whole numbers for each further input, as OneFormer's `task_inputs`."""
    mask_size: Annotated[tuple[ImageSide, ...], length(2, 2)] | None = None
    """Columns and rows to which the masks of queries are scaled before they are joined; by default they are not."""
    align_corners: bool = False
    """Whether the centres of the outermost cells of a coarse output lie on those of the outermost pixels."""

    @model_validator(mode="after")
    def _check_sides(self) -> ImageCard:
        if self.long_side is not None and self.short_side is None:
            raise ValueError(f"long_side: {mismatch('no short_side', 'both, or short_side alone')}")
        if self.short_side is not None and self.size is not None and self.fit != "tiles":
            raise ValueError(f"short_side: {mismatch(f'size and fit: {self.fit}', 'no size, or fit: tiles')}")
        if self.fit == "aspect" and self.size is None:
            raise ValueError(f"fit: {mismatch('aspect without size', 'both')}")
        if self.multiple != 1 and self.fit != "aspect":
            raise ValueError(f"multiple: {mismatch(f'fit: {self.fit}', 'fit: aspect')}")
        if self.mask_size is not None and self.kind != "masks":
            raise ValueError(f"mask_size: {mismatch(f'kind: {self.kind}', 'kind: masks')}")
        return self


class CompleteImageCard(ImageCard):
    """Card of a network for images in which no key about its input is left open, but a size for any image."""

    color: Color
    scale: float
    mean: tuple[float, ...]
    std: tuple[float, ...]
    layout: Layout

    def size_for(self, width: int, height: int) -> tuple[int, int]:
        """Columns and rows of the network's image for one of `width` x `height` pixels."""
        if self.fit == "aspect":
            return self._near_size(width, height)
        if self.size is not None:
            return self.size[0], self.size[1]
        sides = self.scaled((width, height))
        columns, rows = (min(-(-side // MULTIPLE) * MULTIPLE, MAX_SIDE) for side in sides)
        return columns, rows

    def _near_size(self, width: int, height: int) -> tuple[int, int]:
        """Scale both sides by the factor, that of the width or of the height, which changes the image less.

        This is transformers' `get_resize_output_image_size` of DPT with `keep_aspect_ratio` and `ensure_multiple_of`.
        """
        assert self.size is not None  # checked with the card
        by_width, by_height = self.size[0] / width, self.size[1] / height
        factor = by_width if abs(1.0 - by_width) < abs(1.0 - by_height) else by_height
        columns, rows = (
            max(round(factor * side / self.multiple), 1) * self.multiple for side in (width, height)
        )
        return columns, rows

    def scaled(self, size: tuple[int, int]) -> tuple[int, int]:
        """Columns and rows of an image of a size whose shorter side is brought to `short_side`."""
        if self.short_side is None:
            return size
        factor = min(self.short_side / min(size), (self.long_side or math.inf) / max(size))
        columns, rows = (max(round(side * factor), 1) for side in size)
        return columns, rows

    def describe(self) -> list[tuple[str, str]]:
        """Describe the input, in pairs of a word and a sentence."""
        size = "any, so that of the image" if self.size is None else f"{self.size[0]} x {self.size[1]}"
        if self.fit == "aspect":
            size = f"near {size}, sides a multiple of {self.multiple}"
        if self.short_side is not None:
            most = "" if self.long_side is None else f", the longer one to at most {self.long_side}"
            size += f", its shorter side scaled to {self.short_side}{most}"
        numbers = " ".join(f"{each:g}" for each in (*self.mean, *self.std))
        return [
            ("size", f"{size}, {self.fit}{'' if self.resample is None else f', {self.resample}'}"),
            ("colours", f"{self.color}, {self.layout.replace('_', ' ')}"),
            ("numbers", f"(pixel * {self.scale:g} - mean) / std, with mean and std {numbers}"),
        ]


class NeighborsConfig(StrictModel):
    """How points take their classes from the pixels around them: Milioto et al., RangeNet++, 2019, algorithm 1."""

    count: Annotated[int, Field(ge=1, le=100)] = 5
    """Number of neighbours that vote."""
    search: Annotated[int, Field(ge=1, le=31)] = 5
    """Side of the window, in pixels, in which they are looked for; odd."""
    sigma_px: Annotated[float, Field(gt=0.0, le=100.0)] = 1.0
    """Standard deviation of the Gaussian that brings near pixels nearer."""
    max_difference_m: Annotated[float, Field(gt=0.0, le=1e3)] = 1.0
    """Largest difference between the ranges of a point and of a neighbour, metres."""

    @field_validator("search")
    @classmethod
    def _check_odd(cls, search: int) -> int:
        if search % 2 == 0:
            raise mismatch(search, "an odd number")
        return search


class PointCard(Card):
    """Card of a network for range images of sweeps."""

    semcal_point_model: Version
    """Version of this format."""
    rows: Annotated[int, Field(ge=2, le=4096)]
    """Rows of the range image."""
    columns: Annotated[int, Field(ge=2, le=0xFFFF)]
    """Columns of the range image."""
    elevation_deg: Annotated[tuple[Degrees, ...], length(2, 2)]
    """Elevations of the lower and of the upper border, degrees."""
    azimuth_deg: Annotated[tuple[Degrees, ...], length(2, 2)] = (180.0, -180.0)
    """Azimuths of the left and of the right border, degrees, positive to the left."""
    row_by: Literal["elevation", "ring"] = "elevation"
    """What tells the row of a point: its elevation, or its ring, 0 the uppermost."""
    outside: Literal["clamp", "drop"] = "clamp"
    """What becomes of points above and below: they take the outermost rows, or get no label."""
    channels: Annotated[tuple[Channel, ...], length(1, 16)]
    """Channels of the input, in order. `mask` is 1 where there is a return and is not normalised."""
    mean: Annotated[tuple[Factor, ...], length(1, 16)]
    """What is subtracted from each channel."""
    std: Annotated[tuple[Spread, ...], length(1, 16)]
    """What each channel is then divided by."""
    empty: Factor = 0.0
    """Value of pixels without a return, after this."""
    intensity_scale: Spread = 1.0
    """Factor of the intensities, if the network was trained with another range of them than the LiDAR has."""
    neighbors: NeighborsConfig | None = NeighborsConfig()
    """How points take their classes from pixels; null takes that of the point's own pixel."""

    @model_validator(mode="after")
    def _check_channels(self) -> PointCard:
        for name in ("mean", "std"):
            if len(getattr(self, name)) != len(self.channels):
                needed = f"{len(self.channels)}, one for each channel"
                raise ValueError(f"{name}: {mismatch(f'{len(getattr(self, name))} numbers', needed)}")
        if self.elevation_deg[0] >= self.elevation_deg[1]:
            raise ValueError(f"elevation_deg: {mismatch(list(self.elevation_deg), 'the lower border first')}")
        if not 0.0 < self.azimuth_deg[0] - self.azimuth_deg[1] <= 360.0:
            needed = "the left border first, and at most a turn"
            raise ValueError(f"azimuth_deg: {mismatch(list(self.azimuth_deg), needed)}")
        return self

    def describe(self) -> list[tuple[str, str]]:
        """Describe the input, in pairs of a word and a sentence."""
        (low, high), (left, right) = self.elevation_deg, self.azimuth_deg
        numbers = " ".join(f"{each:g}" for each in (*self.mean, *self.std))
        return [
            ("size", f"{self.columns} x {self.rows}, rows by {self.row_by}"),
            ("field", f"{low:g} to {high:g} degrees up, {left:g} to {right:g} around"),
            ("channels", " ".join(self.channels)),
            ("numbers", f"(channel - mean) / std, with mean and std {numbers}; {self.empty:g} where empty"),
        ]


class FrustumConfig(StrictModel):
    """The grid of directions whose cells a network of points takes beside them, as FRNet's: Xu et al., 2025."""

    rows: Annotated[int, Field(ge=2, le=4096)]
    """Rows of the grid."""
    columns: Annotated[int, Field(ge=2, le=0xFFFF)]
    """Columns of the grid."""
    elevation_deg: Annotated[tuple[Degrees, ...], length(2, 2)]
    """Elevations of the lower and of the upper border, degrees; points beyond take the outermost rows."""

    @field_validator("elevation_deg")
    @classmethod
    def _check_order(cls, elevation_deg: tuple[float, ...]) -> tuple[float, ...]:
        if elevation_deg[0] >= elevation_deg[1]:
            raise mismatch(list(elevation_deg), "the lower border first")
        return elevation_deg


class CloudCard(Card):
    """Card of a network that takes the points of a sweep themselves."""

    semcal_point_model: Version
    """Version of this format."""
    kind: Literal["points"]
    """What the network takes."""
    channels: Annotated[tuple[CloudChannel, ...], length(3, 16)] = ("x", "y", "z", "intensity")
    """Numbers of each point, in order."""
    mean: Annotated[tuple[Factor, ...], length(3, 16)] | None = None
    """What is subtracted from each of them; 0 if absent."""
    std: Annotated[tuple[Spread, ...], length(3, 16)] | None = None
    """What each is then divided by; 1 if absent."""
    intensity_scale: Spread = 1.0
    """Factor of the intensities, if the network was trained with another range of them than the LiDAR has."""
    frustum: FrustumConfig | None = None
    """Grid of the further inputs coors, voxel_coors and inverse_map, if the network has them."""

    @model_validator(mode="after")
    def _check_channels(self) -> CloudCard:
        for name in ("mean", "std"):
            numbers = getattr(self, name)
            if numbers is not None and len(numbers) != len(self.channels):
                needed = f"{len(self.channels)}, one for each channel"
                raise ValueError(f"{name}: {mismatch(f'{len(numbers)} numbers', needed)}")
        return self

    def describe(self) -> list[tuple[str, str]]:
        """Describe the input, in pairs of a word and a sentence."""
        grid = self.frustum
        cells = "" if grid is None else f", in a grid of {grid.columns} x {grid.rows} cells"
        return [("points", f"{' '.join(self.channels)} of each{cells}")]


def card_names() -> list[str]:
    """List the names of the ready cards."""
    return sorted(path.stem for path in CARDS.glob("*.yaml"))


def find_card(name: str | None, model: Path) -> Path | None:
    """Find a ready card by its name, a card's file, or the card beside a model; None if there is none.

    Raises:
        InputError: there is no such card.
    """
    if name is None:
        beside = model.with_suffix(".yaml")
        return beside if beside.exists() else None
    if name in card_names():
        return CARDS / f"{name}.yaml"
    if not Path(name).suffix and not Path(name).exists():
        raise InputError(f"found card {name!r}, needed a file or one of: {', '.join(card_names())}")
    return Path(name)


def read_card(path: Path) -> ImageCard | PointCard | CloudCard:
    """Read a card.

    Raises:
        InputError: the file is missing or wrong.
    """
    document = read_document(path)
    if "semcal_point_model" in document and "kind" in document:
        return validate(CloudCard, document, path)
    if "semcal_point_model" in document:
        return validate(PointCard, document, path)
    return validate(ImageCard, document, path)


def read_classes(card: Card, path: Path) -> tuple[dict[str, tuple[int, ...]], tuple[int, ...]]:
    """Look up the classes of a card that was read from `path`: the ids of each name, and the ids to ignore.

    Raises:
        InputError: the class table does not exist, or is wrong.
    """
    classes, ignore = card.classes, card.ignore
    if classes is None:
        return {}, ignore
    if isinstance(classes, str):
        try:
            table = read_ontology(str(path.parent / classes) if Path(classes).suffix else classes)
        except InputError as error:
            raise InputError(f"{path}: classes: {error}") from None
        named, ignore = table.ids(), (*table.ignore, *ignore)
    elif isinstance(classes, tuple):
        named = {name: [place] for place, name in enumerate(classes)}
    else:
        named = {name: list(ids) for name, ids in classes.items()}
    kept = {name: tuple(value for value in ids if value not in ignore) for name, ids in named.items()}
    return {name: ids for name, ids in kept.items() if ids}, ignore
