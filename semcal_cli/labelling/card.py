"""The model card: what a network's file does not say about its input and output."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import AfterValidator, Discriminator, Field, Tag, field_validator, model_validator

from semcal_cli.drive.camera import ImageSide
from semcal_cli.drive.class_ids import Ids
from semcal_cli.errors import InputError, counted, mismatch
from semcal_cli.files.documents import read_document
from semcal_cli.files.validation import StrictModel, Version, check_distinct, length, validate
from semcal_cli.importing.ontologies import read_ontology

CARDS = Path(__file__).parent / "cards"
"""Folder of the ready cards."""

MULTIPLE = 32
"""Sides are rounded up to a multiple of this for networks that take any size: the stride of most encoders."""
MAX_SIDE = 4096
"""Largest side of an image for networks that take any size."""
CHANNELS = (1, 3)
"""Possible numbers of channels of an image."""

ImageFit: TypeAlias = Literal["stretch", "letterbox", "tiles", "aspect"]
Place: TypeAlias = Literal["center", "corner"]
Color: TypeAlias = Literal["rgb", "bgr", "gray"]
Layout: TypeAlias = Literal["channels_first", "channels_last"]
OutputKind: TypeAlias = Literal["logits", "probabilities", "ids", "masks"]
Resample: TypeAlias = Literal["nearest", "box", "bilinear", "hamming", "bicubic", "lanczos"]
Channel: TypeAlias = Literal["range", "x", "y", "z", "intensity", "mask"]

CloudChannel: TypeAlias = Literal["x", "y", "z", "intensity", "range", "ring"]

Factor = Annotated[float, Field(ge=-1e6, le=1e6)]
PositiveFactor = Annotated[float, Field(gt=0.0, le=1e6)]
Degrees = Annotated[float, Field(ge=-360.0, le=360.0)]


def _check_order(elevation_deg: tuple[float, ...]) -> tuple[float, ...]:
    if elevation_deg[0] >= elevation_deg[1]:
        raise mismatch(list(elevation_deg), "the lower border first")
    return elevation_deg


Elevations = Annotated[tuple[Degrees, ...], length(2, 2), AfterValidator(_check_order)]
Token = Annotated[int, Field(ge=-(1 << 31), lt=1 << 31)]
ClassName = Annotated[str, Field(min_length=1)]


def _kind_of_classes(classes: object) -> str:
    return "ids" if isinstance(classes, dict) else "names" if isinstance(classes, list | tuple) else "table"


CardClasses: TypeAlias = Annotated[
    Annotated[str, Field(min_length=1), Tag("table")]
    | Annotated[tuple[ClassName, ...], length(2), Tag("names")]
    | Annotated[dict[ClassName, Ids], Field(min_length=1), Tag("ids")],
    Discriminator(_kind_of_classes),
]
"""Classes of a card: the name of a table, a list of names, or ids by name."""


def _mean_and_std(mean: Sequence[float], std: Sequence[float]) -> str:
    """Write the numbers by which channels are normalised."""
    means, stds = (" ".join(f"{value:g}" for value in numbers) for numbers in (mean, std))
    return f"mean {means}; std {stds}"


class Card(StrictModel):
    """Keys shared by cards for images and for sweeps."""

    output: str | None = None
    """Name of the output to read, if the network has several."""
    classes: CardClasses | None = None
    """Class table by name (such as cityscapes-train) or file, or names of ids 0, 1, ..., or ids by name."""
    ignore: Ids = ()
    """Ids that carry no information, in addition to those of the class table."""
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
    """Card of an image network. Absent keys are read from the model or guessed, and guesses are printed."""

    semcal_image_model: Version
    """Version of this format."""
    size: Annotated[tuple[ImageSide, ...], length(2, 2)] | None = None
    """Columns and rows, for a network that takes any size; by default those of the image, rounded up to a
    multiple of 32."""
    fit: ImageFit = "stretch"
    """How an image is brought to that size: stretched; scaled and padded (letterbox); cut into overlapping tiles; or
    scaled to a size near it, in proportion (aspect)."""
    place: Place = "center"
    """Where a letterboxed image lies: in the middle, on the mean colour, or in the upper left corner, on black, as
    transformers pads images."""
    overlap: Annotated[float, Field(ge=0.0, le=0.9)] = 0.25
    """Smallest overlap of neighbouring tiles, as a fraction of a tile."""
    resample: Resample | None = None
    """Pillow filter that scales images; by default area averaging to shrink, and bilinear to enlarge."""
    multiple: Annotated[int, Field(ge=1, le=1024)] = 1
    """With fit: aspect, both sides are rounded to a multiple of this."""
    short_side: ImageSide | None = None
    """Length to which the shorter side of an image is scaled; instead of size, or before an image is cut into tiles."""
    long_side: ImageSide | None = None
    """Limit of the longer side after that."""
    color: Color | None = None
    """Order of the colours; by default rgb for three channels and gray for one."""
    scale: PositiveFactor | None = None
    """Factor for pixel values from 0 to 255; 1/255 by default."""
    mean: Annotated[tuple[Factor, ...], length(1, 3)] | None = None
    """Mean to subtract after that, one for each channel or one for all; 0 by default."""
    std: Annotated[tuple[PositiveFactor, ...], length(1, 3)] | None = None
    """Standard deviation to divide by; 1 by default. Without scale, mean and std, ImageNet's are guessed."""
    layout: Layout | None = None
    """Whether channels come before or after rows and columns in the input."""
    kind: OutputKind | None = None
    """Kind of the output: logits or probabilities of classes, ids, or masks and classes of queries (Mask2Former)."""
    constants: dict[str, Annotated[tuple[Token, ...], length(1)]] = {}
    """Integers for each additional input, such as task_inputs of OneFormer."""
    mask_size: Annotated[tuple[ImageSide, ...], length(2, 2)] | None = None
    """Columns and rows to which the masks of queries are scaled before they are combined; by default they are not."""
    align_corners: bool = False
    """Whether the outermost cells of a coarse output are centred on the outermost pixels, as in PyTorch."""

    @model_validator(mode="after")
    def _check_sides(self) -> ImageCard:
        if self.long_side is not None and self.short_side is None:
            raise ValueError(f"long_side: {mismatch('no short_side', 'both, or short_side alone')}")
        if self.short_side is not None and self.size is not None and self.fit != "tiles":
            raise ValueError(f"short_side: {mismatch(f'size and fit: {self.fit}', 'no size, or fit: tiles')}")
        if self.fit == "aspect" and self.size is None:
            raise ValueError(f"fit: {mismatch('aspect without size', 'both')}")
        if self.place != "center" and self.fit != "letterbox":
            raise ValueError(f"place: {mismatch(f'fit: {self.fit}', 'fit: letterbox')}")
        if self.multiple != 1 and self.fit != "aspect":
            raise ValueError(f"multiple: {mismatch(f'fit: {self.fit}', 'fit: aspect')}")
        if self.mask_size is not None and self.kind != "masks":
            raise ValueError(f"mask_size: {mismatch(f'kind: {self.kind}', 'kind: masks')}")
        return self


class CompleteImageCard(ImageCard):
    """Card of an image network with every key about its input filled in, except the size if the network takes any."""

    color: Color
    scale: float
    mean: tuple[float, ...]
    std: tuple[float, ...]
    layout: Layout

    def size_for(self, width: int, height: int) -> tuple[int, int]:
        """Return the columns and rows of the network's input for an image of `width` x `height` pixels."""
        if self.fit == "aspect":
            return self._near_size(width, height)
        if self.size is not None:
            return self.size[0], self.size[1]
        sides = self.scaled_size((width, height))
        columns, rows = (min(-(-side // MULTIPLE) * MULTIPLE, MAX_SIDE) for side in sides)
        return columns, rows

    def _near_size(self, width: int, height: int) -> tuple[int, int]:
        """Scale both sides by one factor, that of the width or the height, whichever changes the image less.

        As `get_resize_output_image_size` of DPT in transformers, with `keep_aspect_ratio` and `ensure_multiple_of`.
        """
        assert self.size is not None  # _check_sides needs it for this fit
        by_width, by_height = self.size[0] / width, self.size[1] / height
        factor = by_width if abs(1.0 - by_width) < abs(1.0 - by_height) else by_height
        columns, rows = (
            max(round(factor * side / self.multiple), 1) * self.multiple for side in (width, height)
        )
        return columns, rows

    def scaled_size(self, size: tuple[int, int]) -> tuple[int, int]:
        """Return the columns and rows of an image after its shorter side is scaled to `short_side`.

        Rounded as `get_size_with_aspect_ratio` of transformers does.
        """
        if self.short_side is None:
            return size
        short, long = min(size), max(size)
        target: float = self.short_side
        if self.long_side is not None and long / short * target > self.long_side:
            target = self.long_side * short / long
        sides = max(round(target), 1), max(int(target * long / short), 1)
        return sides if size[0] == short else sides[::-1]

    def describe(self) -> list[tuple[str, str]]:
        """Describe the input, as pairs of a label and a text."""
        size = "that of the image" if self.size is None else f"{self.size[0]} x {self.size[1]}"
        if self.fit == "aspect":
            size = f"near {size}, sides a multiple of {self.multiple}"
        if self.short_side is not None:
            limit = "" if self.long_side is None else f", the longer side at most {self.long_side}"
            size += f", shorter side scaled to {self.short_side}{limit}"
        return [
            ("size", f"{size}, {self.fit}{'' if self.resample is None else f', {self.resample}'}"),
            ("colours", f"{self.color}, {self.layout.replace('_', ' ')}"),
            ("values", f"(pixel * {self.scale:g} - mean) / std; {_mean_and_std(self.mean, self.std)}"),
        ]


class NeighborsConfig(StrictModel):
    """Vote of the pixels around a point for its class: Milioto et al., RangeNet++, 2019, algorithm 1."""

    count: Annotated[int, Field(ge=1, le=100)] = 5
    """Number of neighbours that vote."""
    search: Annotated[int, Field(ge=1, le=31)] = 5
    """Side of the search window, pixels; odd."""
    sigma_px: Annotated[float, Field(gt=0.0, le=100.0)] = 1.0
    """Standard deviation of the Gaussian that favours near pixels, pixels."""
    max_difference_m: Annotated[float, Field(gt=0.0, le=1e3)] = 1.0
    """Largest difference in range between a point and a neighbour, metres."""

    @field_validator("search")
    @classmethod
    def _check_odd(cls, search: int) -> int:
        if search % 2 == 0:
            raise mismatch(search, "an odd number")
        return search


class PointCard(Card):
    """Card of a network for range images."""

    semcal_point_model: Version
    """Version of this format."""
    rows: Annotated[int, Field(ge=2, le=4096)]
    """Rows of the range image."""
    columns: Annotated[int, Field(ge=2, le=0xFFFF)]
    """Columns of the range image."""
    elevation_deg: Elevations
    """Elevations of the lower and the upper border, degrees."""
    azimuth_deg: Annotated[tuple[Degrees, ...], length(2, 2)] = (180.0, -180.0)
    """Azimuths of the left and the right border, degrees, positive to the left."""
    row_by: Literal["elevation", "ring"] = "elevation"
    """Whether the row of a point follows from its elevation or its ring; ring 0 is the uppermost."""
    outside: Literal["clamp", "drop"] = "clamp"
    """Whether points above and below fall into the outermost rows (clamp) or get no label (drop)."""
    channels: Annotated[tuple[Channel, ...], length(1, 16)]
    """Channels of the input, in order. mask is 1 where there is a return, and is not normalised."""
    mean: Annotated[tuple[Factor, ...], length(1, 16)]
    """Mean to subtract, one for each channel."""
    std: Annotated[tuple[PositiveFactor, ...], length(1, 16)]
    """Standard deviation to divide by, one for each channel."""
    empty: Factor = 0.0
    """Value of pixels without a return, after normalisation."""
    intensity_scale: PositiveFactor = 1.0
    """Factor for intensities, if the network was trained with another range than the LiDAR's."""
    neighbors: NeighborsConfig | None = NeighborsConfig()
    """How points take their classes from pixels; null takes the class of the point's own pixel."""

    @model_validator(mode="after")
    def _check_channels(self) -> PointCard:
        _check_lengths(self)
        if not 0.0 < self.azimuth_deg[0] - self.azimuth_deg[1] <= 360.0:
            needed = "the left border first, at most 360 degrees apart"
            raise ValueError(f"azimuth_deg: {mismatch(list(self.azimuth_deg), needed)}")
        return self

    def describe(self) -> list[tuple[str, str]]:
        """Describe the input, as pairs of a label and a text."""
        (low, high), (left, right) = self.elevation_deg, self.azimuth_deg
        return [
            ("size", f"{self.columns} x {self.rows}, rows by {self.row_by}"),
            ("field", f"elevation {low:g} to {high:g}, azimuth {left:g} to {right:g} degrees"),
            ("channels", " ".join(self.channels)),
            (
                "values",
                f"(channel - mean) / std; {_mean_and_std(self.mean, self.std)}; {self.empty:g} if empty",
            ),
        ]


class CloudCard(Card):
    """Card of a network that takes the points of a sweep."""

    semcal_point_model: Version
    """Version of this format."""
    kind: Literal["points"]
    """Input of the network."""
    channels: Annotated[tuple[CloudChannel, ...], length(3, 16)] = ("x", "y", "z", "intensity")
    """Values of each point, in order."""
    mean: Annotated[tuple[Factor, ...], length(3, 16)] | None = None
    """Mean to subtract, one for each channel; 0 by default."""
    std: Annotated[tuple[PositiveFactor, ...], length(3, 16)] | None = None
    """Standard deviation to divide by, one for each channel; 1 by default."""
    intensity_scale: PositiveFactor = 1.0
    """Factor for intensities, if the network was trained with another range than the LiDAR's."""

    @model_validator(mode="after")
    def _check_channels(self) -> CloudCard:
        _check_lengths(self)
        return self

    def describe(self) -> list[tuple[str, str]]:
        """Describe the input, as pairs of a label and a text."""
        return [("points", " ".join(self.channels))]


def _check_lengths(card: PointCard | CloudCard) -> None:
    """Check that there is a mean and a standard deviation for each channel."""
    for name, numbers in (("mean", card.mean), ("std", card.std)):
        if numbers is not None and len(numbers) != len(card.channels):
            needed = f"{len(card.channels)}, one for each channel"
            raise ValueError(f"{name}: {mismatch(counted(len(numbers), 'number'), needed)}")


def card_names() -> list[str]:
    """List the names of the ready cards."""
    return sorted(path.stem for path in CARDS.glob("*.yaml"))


def find_card(name: str | None, model: Path) -> Path | None:
    """Find a card by the name of a ready one, by its file, or beside the model; None if there is none.

    Raises:
        InputError: there is no such card.
    """
    if name is None:
        beside = model.with_suffix(".yaml")
        return beside if beside.exists() else None
    if name in card_names():
        return CARDS / f"{name}.yaml"
    if not Path(name).suffix and not Path(name).exists():
        raise InputError(f"found card {name!r}, expected a file or one of: {', '.join(card_names())}")
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
    """Look up the classes of a card read from `path`: the ids of each name, and the ids to ignore.

    Raises:
        InputError: the class table is missing or wrong.
    """
    classes, ignore = card.classes, card.ignore
    if classes is None:
        return {}, ignore
    if isinstance(classes, str):
        try:
            table = read_ontology(str(path.parent / classes) if Path(classes).suffix else classes)
        except InputError as error:
            raise InputError(f"{path}: classes: {error}") from None
        ids_by_name, ignore = table.ids(), (*table.ignore, *ignore)
    elif isinstance(classes, tuple):
        ids_by_name = {name: [index] for index, name in enumerate(classes)}
    else:
        ids_by_name = {name: list(ids) for name, ids in classes.items()}
    informative = {
        name: tuple(value for value in ids if value not in ignore) for name, ids in ids_by_name.items()
    }
    return {name: ids for name, ids in informative.items() if ids}, ignore
