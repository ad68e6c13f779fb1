"""A network for pictures: what its file says, what its card adds, and what is left to guess."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from semcal_cli.errors import InputError
from semcal_cli.labelling.card import MULTIPLE, Color, CompletePictureCard, Kind, PictureCard, read_classes
from semcal_cli.labelling.model import Model, output_of, wrong_key
from semcal_cli.labelling.network import Network, Port

IMAGENET = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Mean and standard deviation of ImageNet's red, green and blue, by which most networks normalise."""
MAX_SCALED = 2.0
"""Largest mean or standard deviation of pixels that are scaled to 1, with some room for unusual ones."""
MAX_NETWORK_PIXELS = 1 << 25
"""Most pixels of a network's picture."""
CHANNELS = (1, 3)
AXES = {"channels_first": (1, 2, 3), "channels_last": (3, 1, 2)}
"""Axes of the channels, the rows and the columns in each layout of a batch."""
PLAIN = ("logits", "output", "out", "output_0", "pred", "prediction", "semantic_logits")
"""Names of the one output that matters, in order, where a network has several."""
MASKS = ("class_queries_logits", "masks_queries_logits")
"""Names of the two outputs of Mask2Former and its like."""


def understand(network: Network, card: PictureCard | None, card_path: Path) -> Model[CompletePictureCard]:
    """Join what the model says with what its card adds.

    Args:
        network: The network.
        card: Its card, if it has one.
        card_path: File of the card, or of the model without one.

    Raises:
        InputError: the two contradict one another, or the network is not one for pictures.
    """
    joining = _Joining(network, card or PictureCard(semcal_picture_model=1), card_path)
    found = joining.read_input()
    outputs, kind = joining.read_outputs()
    classes, ignore = read_classes(joining.card, card_path)
    if not classes:
        joining.guesses.append("classes have no names: ids are kept as they are; give classes in a card")
    complete = CompletePictureCard(**{**dict(joining.card), **found, "kind": kind})
    return Model(network, complete, card_path, outputs, classes, ignore, tuple(joining.guesses))


class _Joining:
    """A network and its card, and what had to be guessed between the two."""

    def __init__(self, network: Network, card: PictureCard, card_path: Path) -> None:
        self.network, self.card, self.card_path = network, card, card_path
        self.guesses: list[str] = []

    def read_input(self) -> dict[str, Any]:
        """Complete the card's keys about the input by its shape."""
        port = self.network.input
        if len(port.shape) != 4 or port.dtype not in ("float32", "float16", "float64", "uint8"):
            raise self.network.unfit(f"input {port}", "four axes of float or uint8: a batch of pictures")
        if port.shape[0] not in (1, None):
            raise self.network.unfit(f"input {port}", "a batch of one picture")
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
        each = {"mean": mean * (num_channels // len(mean)), "std": std * (num_channels // len(std))}
        return {"layout": layout, "size": size, "color": color, "scale": scale, **each}

    def read_outputs(self) -> tuple[tuple[str, ...], Kind | None]:
        """Choose the outputs that are read, and what they are."""
        card, ports = self.card, {port.name: port for port in self.network.outputs}
        if card.kind == "masks" or (card.kind is None and card.output is None and set(MASKS) <= set(ports)):
            if not set(MASKS) <= set(ports):
                needed = f"outputs named {' and '.join(MASKS)}, not {', '.join(ports)}"
                raise self._wrong("kind", "masks", needed)
            return MASKS, "masks"
        name = output_of(self.network, card, self.card_path)
        if name is None:
            name = next((name for name in PLAIN if name in ports), next(iter(ports)))
            self.guesses.append(f"of the outputs, {name!r} is the one that matters")
        return (name,), card.kind or _kind_of(self.network, ports[name])

    def _layout(self, port: Port) -> str:
        possible = [layout for layout, axes in AXES.items() if port.shape[axes[0]] in CHANNELS]
        if not possible:
            self.guesses.append("channels stand before rows and columns: the model leaves them open")
        return next(iter(possible or AXES))

    def _size(self, columns: int | None, rows: int | None) -> tuple[int, int] | None:
        """Join the size of the input with that of the card."""
        wanted = self.card.size or (None, None)
        for name, found, needed in (("columns", columns, wanted[0]), ("rows", rows, wanted[1])):
            if found is not None and needed not in (None, found):
                raise self._wrong("size", f"{needed} {name}", f"the {found} of {self.network.path}")
        columns, rows = columns or wanted[0], rows or wanted[1]
        if columns is not None and rows is not None:
            if columns * rows > MAX_NETWORK_PIXELS:
                area = f"{columns:,} x {rows:,} pixels"
                raise self._wrong("size", area, f"at most {MAX_NETWORK_PIXELS:,}")
            return columns, rows
        if columns is not None or rows is not None or self.card.fit == "tiles":
            raise self._wrong("size", "none", f"columns and rows for {self.network.input}")
        self.guesses.append(f"the size is the picture's, up to a multiple of {MULTIPLE}")
        return None

    def _normalisation(
        self, color: Color, num_channels: int
    ) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
        """Complete the scale, the mean and the standard deviation of pixels."""
        card = self.card
        is_stated = (card.scale, card.mean, card.std) != (None, None, None)
        if self.network.input.dtype == "uint8":
            if is_stated:
                raise self._wrong("scale, mean, std", "some", f"none: {self.network.path} takes uint8 pixels")
            return 1.0, (0.0,), (1.0,)
        self._check_numbers(num_channels)
        if card.color is None and num_channels == 3:
            self.guesses.append("colours are red, green, blue")
        mean, std = card.mean or (0.0,), card.std or (1.0,)
        if not is_stated:
            self.guesses.append(
                "pixels are scaled to 1 and normalised by ImageNet's mean and standard deviation"
            )
            mean, std = (_of_color(numbers, color) for numbers in IMAGENET)
        scale = 1.0 / 255.0 if card.scale is None else card.scale
        return scale, mean, std

    def _check_numbers(self, num_channels: int) -> None:
        for name, numbers in (("mean", self.card.mean), ("std", self.card.std)):
            if numbers is None:
                continue
            if len(numbers) not in (1, num_channels):
                raise self._wrong(name, f"{len(numbers)} numbers", num_channels)
            if self.card.scale is None and max(numbers) > MAX_SCALED:
                needed = (
                    f"at most {MAX_SCALED:g} for pixels from 0 to 1, or scale: 1.0 for pixels from 0 to 255"
                )
                raise self._wrong(name, f"{max(numbers):g}", needed)

    def _wrong(self, key: str, found: object, needed: object) -> InputError:
        return wrong_key(self.card_path, key, found, needed)


def _of_color(numbers: tuple[float, ...], color: Color) -> tuple[float, ...]:
    """Arrange numbers of red, green and blue for an order of colours."""
    return {"rgb": numbers, "bgr": numbers[::-1], "gray": (sum(numbers) / len(numbers),)}[color]


def _kind_of(network: Network, port: Port) -> Kind | None:
    """Tell ids from scores by the type and the axes of an output; None for scores."""
    if port.dtype.startswith(("int", "uint")):
        return "ids"
    if not port.dtype.startswith("float"):
        raise network.unfit(f"output {port}", "scores or ids of classes")
    # Some runtimes leave the axes of an output open altogether.
    if port.shape and len(port.shape) != 4:
        raise network.unfit(f"output {port}", "four axes of scores, or ids as whole numbers")
    return None


def joined_masks(outputs: Mapping[str, npt.NDArray[Any]]) -> npt.NDArray[np.float32]:
    """Join classes and masks of queries to probabilities (1, C, h, w): Cheng et al., Mask2Former, 2022.

    Args:
        outputs: Logits of the classes (1, Q, C + 1), the last of which is none, and of the masks (1, Q, h, w).
    """
    classes, masks = (np.asarray(outputs[name], np.float64)[0] for name in MASKS)
    likely = np.exp(classes - classes.max(1, keepdims=True))
    likely /= likely.sum(1, keepdims=True)
    inside = 1.0 / (1.0 + np.exp(-masks))
    return np.asarray(np.einsum("qc,qhw->chw", likely[:, :-1], inside)[None], np.float32)
