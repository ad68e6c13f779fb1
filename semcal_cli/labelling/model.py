"""A network with its card: what the file says, what the card adds, and what remains to be guessed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeAlias, TypeVar

from semcal_cli.errors import InputError, counted, mismatch
from semcal_cli.labelling.card import (
    CHANNELS,
    MULTIPLE,
    Card,
    CloudCard,
    Color,
    CompleteImageCard,
    ImageCard,
    OutputKind,
    PointCard,
    find_card,
    read_card,
    read_classes,
)
from semcal_cli.labelling.hub import licence_of
from semcal_cli.labelling.onnx_network import Network, Port
from semcal_cli.labelling.sidecars import read_sidecars

SHOWN_NAMES = 6
"""Number of class names that `--show` prints."""
IMAGENET = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""ImageNet's mean and standard deviation of red, green and blue, which most networks use."""
BYTE_SCALE = 1.0 / 255.0
MAX_SCALED = 2.0
"""Largest plausible mean or standard deviation of pixels from 0 to 1."""
MAX_NETWORK_PIXELS = 1 << 25
"""Largest number of pixels of a network's image."""
AXES = {"channels_first": (1, 2, 3), "channels_last": (3, 1, 2)}
"""Axes of the channels, rows and columns in each layout of a batch."""
PREFERRED_OUTPUTS = ("logits", "output", "out", "output_0", "pred", "prediction", "semantic_logits")
"""Names of the output to read if a network has several, in order of preference."""
MASKS = ("class_queries_logits", "masks_queries_logits")
"""Names of the two outputs of Mask2Former and similar networks."""
AnyStatedCard: TypeAlias = ImageCard | PointCard | CloudCard
AnyCard = TypeVar("AnyCard", CompleteImageCard, PointCard, CloudCard)


@dataclass(frozen=True, eq=False)
class Model(Generic[AnyCard]):
    """A network, and what its file and its card say about it."""

    network: Network
    card: AnyCard
    """Card with all that is needed filled in."""
    card_path: Path
    """File of the card, or of the model if there is no card."""
    outputs: tuple[str, ...]
    """Names of the outputs to read."""
    classes: Mapping[str, tuple[int, ...]]
    """Ids of each name; empty without names."""
    ignore: tuple[int, ...]
    """Ids that carry no information."""
    guesses: tuple[str, ...] = ()
    """Sentences about what neither the model nor the card says."""

    @property
    def licence(self) -> str | None:
        """Licence of the weights, if the card or the list of short names states one."""
        return self.card.licence or licence_of(self.network.path)

    def describe(self) -> list[tuple[str, str]]:
        """Describe how the network is understood, as pairs of a label and a text."""
        read = " and ".join(self.outputs)
        if isinstance(self.card, CompleteImageCard):
            read += f" as {self.card.kind or 'logits or probabilities'}"
        names = ", ".join(list(self.classes)[:SHOWN_NAMES])
        more = ", ..." if len(self.classes) > SHOWN_NAMES else ""
        return [
            ("card", "none" if self.card_path == self.network.path else str(self.card_path)),
            ("input", str(self.network.input)),
            *(("output", str(port)) for port in self.network.outputs),
            *self.card.describe(),
            ("read", read),
            ("classes", f"{len(self.classes)}: {names}{more}" if self.classes else "not named"),
            ("ignored", ", ".join(map(str, self.ignore)) or "none"),
            ("licence", self.licence or "not stated"),
            *(("guessed", guess) for guess in self.guesses),
        ]


def image_model(network: Network, card: str | None) -> Model[CompleteImageCard]:
    """Combine an image network with its card.

    Args:
        network: The network.
        card: Name or file of the card; None for MODEL.yaml beside the model, if it exists.

    Raises:
        InputError: the card is missing, wrong or for sweeps, or the network contradicts it.
    """
    stated_card, card_path = card_of(network, card)
    if isinstance(stated_card, PointCard | CloudCard):
        raise network.unfit("a card for sweeps", "one for images")
    completion = _CardCompletion(network, stated_card or ImageCard(semcal_image_model=1), card_path)
    input_keys = completion.read_input()
    completion.check_constants()
    outputs, kind = completion.read_outputs()
    classes, ignore = read_classes(completion.card, card_path)
    if not classes:
        completion.guesses.append("classes have no names, and ids stay as they are; a card can name them")
    complete_card = CompleteImageCard(**{**dict(completion.card), **input_keys, "kind": kind})
    return Model(network, complete_card, card_path, outputs, classes, ignore, tuple(completion.guesses))


def point_model(network: Network, card: str | None) -> Model[PointCard]:
    """Combine a network for range images with its card; arguments and errors are those of `image_model`."""
    stated_card, card_path = card_of(network, card)
    if not isinstance(stated_card, PointCard):
        raise network.unfit("no card for sweeps (semcal_point_model: 1)", "one next to it, or --point-card")
    if other_inputs := network.other_inputs():
        raise network.unfit(f"additional inputs {', '.join(other_inputs)}", "only a range image")
    port, expected_shape = (
        network.input,
        (1, len(stated_card.channels), stated_card.rows, stated_card.columns),
    )
    fits = len(port.shape) == 4 and all(
        size in (None, expected) for size, expected in zip(port.shape, expected_shape, strict=True)
    )
    if not fits or not port.dtype.startswith("float"):
        raise network.unfit(
            f"input {port}", f"{' x '.join(map(str, expected_shape))} float, as {card_path} says"
        )
    return _make_model(network, stated_card, card_path)


def cloud_model(network: Network, card: str | None) -> Model[CloudCard]:
    """Combine a network that takes points with its card; arguments and errors are those of `image_model`."""
    stated_card, card_path = card_of(network, card)
    assert isinstance(stated_card, CloudCard)  # callers have checked it
    if other_inputs := network.other_inputs():
        raise network.unfit(f"additional inputs {', '.join(other_inputs)}", "only points")
    port, count = network.input, len(stated_card.channels)
    if not port.dtype.startswith("float") or len(port.shape) not in (2, 3) or count not in port.shape[-2:]:
        raise network.unfit(f"input {port}", f"any x {count} float, as the channels of {card_path}")
    return _make_model(network, stated_card, card_path)


def card_of(network: Network, name: str | None) -> tuple[AnyStatedCard | None, Path]:
    """Read the card of a network, or the transformers files beside it.

    Returns:
        The card, or None, and its file, or that of the network.
    """
    path = find_card(name, network.path)
    if path is None:
        return read_sidecars(network) or (None, network.path)
    return read_card(path), path


def wrong_key(card_path: Path, key: str, found: object, needed: object) -> InputError:
    """Make the error about a key of a card that the network contradicts."""
    return InputError(f"{card_path}: {key}: {mismatch(found, needed)}")


def _find_output(network: Network, card: Card, card_path: Path) -> str | None:
    """Find the output that the card names, or the only one; None if there are several and the card names none."""
    names = [port.name for port in network.outputs]
    if card.output is not None and card.output not in names:
        raise wrong_key(card_path, "output", repr(card.output), f"one of: {', '.join(names)}")
    return card.output or (names[0] if len(names) == 1 else None)


def _make_model(network: Network, card: AnyCard, card_path: Path) -> Model[AnyCard]:
    """Combine a network with its complete card, which need not name the only output."""
    output = _find_output(network, card, card_path)
    if output is None:
        names = ", ".join(port.name for port in network.outputs)
        raise wrong_key(card_path, "output", "none", f"one of: {names}")
    return Model(network, card, card_path, (output,), *read_classes(card, card_path))


class _CardCompletion:
    """An image network and its card, and what had to be guessed."""

    def __init__(self, network: Network, card: ImageCard, card_path: Path) -> None:
        self.network, self.card, self.card_path = network, card, card_path
        self.guesses: list[str] = []

    def read_input(self) -> dict[str, Any]:
        """Complete the keys about the input from its shape."""
        port = self.network.input
        if len(port.shape) != 4 or port.dtype not in ("float32", "float16", "float64", "uint8"):
            raise self.network.unfit(f"input {port}", "four axes of float or uint8: a batch of images")
        if port.shape[0] not in (1, None):
            raise self.network.unfit(f"input {port}", "a batch of one image")
        layout = self.card.layout or self._layout(port)
        channels, rows, columns = (port.shape[axis] for axis in AXES[layout])
        if channels not in (*CHANNELS, None):
            raise self.network.unfit(f"input {port}", "1 or 3 channels")
        size = self._size(columns, rows)
        num_channels = channels or (1 if self.card.color == "gray" else 3)
        color: Color = self.card.color or ("gray" if num_channels == 1 else "rgb")
        if (color == "gray") != (num_channels == 1):
            raise self._wrong("color", color, f"{num_channels} channels")
        scale, mean, std = self._normalisation(color, num_channels)
        normalisation = {"mean": mean * (num_channels // len(mean)), "std": std * (num_channels // len(std))}
        return {"layout": layout, "size": size, "color": color, "scale": scale, **normalisation}

    def check_constants(self) -> None:
        """Check that the card states the values of each additional input."""
        names = self.network.other_inputs()
        if missing := [name for name in names if name not in self.card.constants]:
            needed = "only an image, or constants for them in a card"
            raise self.network.unfit(f"additional inputs {', '.join(missing)}", needed)
        if unknown := [name for name in self.card.constants if name not in names]:
            raise self._wrong("constants", unknown[0], f"one of: {', '.join(names) or 'none'}")

    def read_outputs(self) -> tuple[tuple[str, ...], OutputKind | None]:
        """Choose the outputs to read, and their kind."""
        card, ports = self.card, {port.name: port for port in self.network.outputs}
        has_masks = set(MASKS) <= set(ports)
        if card.kind == "masks" or (card.kind is None and card.output is None and has_masks):
            if not has_masks:
                needed = f"outputs named {' and '.join(MASKS)}, not {', '.join(ports)}"
                raise self._wrong("kind", "masks", needed)
            return MASKS, "masks"
        name = _find_output(self.network, card, self.card_path)
        if name is None:
            name = next((name for name in PREFERRED_OUTPUTS if name in ports), next(iter(ports)))
            self.guesses.append(f"the output to read is {name!r}")
        return (name,), card.kind or self._kind_of(ports[name])

    def _kind_of(self, port: Port) -> OutputKind | None:
        """Distinguish ids from scores by the type and axes of an output; None for scores."""
        if port.dtype.startswith(("int", "uint")):
            return "ids"
        if not port.dtype.startswith("float"):
            raise self.network.unfit(f"output {port}", "class scores or ids")
        # Some exporters state no axes at all.
        if port.shape and len(port.shape) != 4:
            raise self.network.unfit(f"output {port}", "four axes of scores, or ids as whole numbers")
        return None

    def _layout(self, port: Port) -> str:
        possible = [layout for layout, axes in AXES.items() if port.shape[axes[0]] in CHANNELS]
        if not possible:
            self.guesses.append("channels come before rows and columns: the model does not say")
        return next(iter(possible or AXES))

    def _size(self, columns: int | None, rows: int | None) -> tuple[int, int] | None:
        """Combine the size of the input with that of the card."""
        card_size = self.card.size or (None, None)
        for name, actual, card_value in (("columns", columns, card_size[0]), ("rows", rows, card_size[1])):
            if actual is not None and card_value not in (None, actual):
                raise self._wrong("size", f"{card_value} {name}", f"{actual}, as {self.network.path} states")
        if self.card.fit == "aspect" and (columns, rows) != (None, None):
            raise self._wrong("fit", "aspect", f"another: the size of {self.network.path} is fixed")
        columns, rows = columns or card_size[0], rows or card_size[1]
        if columns is not None and rows is not None:
            if columns * rows > MAX_NETWORK_PIXELS:
                raise self._wrong("size", f"{columns:,} x {rows:,} pixels", f"at most {MAX_NETWORK_PIXELS:,}")
            return columns, rows
        if columns is not None or rows is not None or self.card.fit == "tiles":
            raise self._wrong("size", "none", f"columns and rows for {self.network.input}")
        if self.card.short_side is None:
            self.guesses.append(f"the size is that of the image, rounded up to a multiple of {MULTIPLE}")
        return None

    def _normalisation(
        self, color: Color, num_channels: int
    ) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
        """Complete the scale, mean and standard deviation of pixels."""
        card = self.card
        is_stated = (card.scale, card.mean, card.std) != (None, None, None)
        if self.network.input.dtype == "uint8":
            # An 8-bit network takes bytes where its card speaks of pixels from 0 to 1.
            is_plain = (
                card.scale == BYTE_SCALE and not any(card.mean or ()) and set(card.std or (1.0,)) == {1.0}
            )
            if is_stated and not is_plain:
                raise self._wrong("scale, mean, std", "some", f"none: {self.network.path} takes uint8 pixels")
            return 1.0, (0.0,), (1.0,)
        for name, numbers in (("mean", card.mean), ("std", card.std)):
            if numbers is not None and len(numbers) not in (1, num_channels):
                raise self._wrong(name, counted(len(numbers), "number"), num_channels)
            if numbers is not None and card.scale is None and max(numbers) > MAX_SCALED:
                needed = (
                    f"at most {MAX_SCALED:g} for pixels from 0 to 1, or scale: 1.0 for pixels from 0 to 255"
                )
                raise self._wrong(name, f"{max(numbers):g}", needed)
        if card.color is None and num_channels == 3:
            self.guesses.append("colours are in the order red, green, blue")
        scale = BYTE_SCALE if card.scale is None else card.scale
        if is_stated:
            return scale, card.mean or (0.0,), card.std or (1.0,)
        self.guesses.append("pixels are scaled to 1 and normalised by ImageNet's mean and standard deviation")
        mean, std = (
            {"rgb": numbers, "bgr": numbers[::-1], "gray": (sum(numbers) / len(numbers),)}[color]
            for numbers in IMAGENET
        )
        return scale, mean, std

    def _wrong(self, key: str, found: object, needed: object) -> InputError:
        return wrong_key(self.card_path, key, found, needed)
