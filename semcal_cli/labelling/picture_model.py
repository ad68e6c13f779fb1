"""A network for pictures: what its file says, what its card adds, and what is left to guess."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from semcal_cli.errors import InputError
from semcal_cli.labelling.card import Color, Fit, Kind, PictureCard, read_classes
from semcal_cli.labelling.network import Network, Port

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)
"""Mean and standard deviation of ImageNet's red, green and blue, by which most networks normalise."""
MAX_SCALED = 2.0
"""Largest mean or standard deviation of pixels that are scaled to 1, with some room for unusual ones."""
MULTIPLE = 32
"""Sides of a picture for a network that takes any size are a multiple of this, the stride of most encoders."""
MAX_SIDE = 4096
"""Largest side of a picture for a network that takes any size."""
MAX_NETWORK_PIXELS = 1 << 25
"""Most pixels of a network's picture."""
CHANNELS = (1, 3)
PLAIN = ("logits", "output", "out", "output_0", "pred", "prediction", "semantic_logits")
"""Names of the one output that matters, in order, where a network has several."""
MASKS = ("class_queries_logits", "masks_queries_logits")
"""Names of the two outputs of Mask2Former and its like."""


@dataclass(frozen=True, eq=False)
class PictureModel:
    """A network for pictures, with all that is needed to run it."""

    network: Network
    size: tuple[int, int] | None
    """Columns and rows; None for those of the picture, up to a multiple of `MULTIPLE`."""
    fit: Fit
    color: Color
    channels_last: bool
    """Whether the channels are the last axis of the input."""
    scale: float
    mean: tuple[float, ...]
    std: tuple[float, ...]
    """Normalisation: (pixel * scale - mean) / std."""
    outputs: tuple[str, ...]
    """Names of the outputs that are read."""
    kind: Kind | None
    """What the output is; None if only its numbers tell."""
    align_corners: bool
    classes: Mapping[str, tuple[int, ...]]
    """Ids of each name; empty without names."""
    ignore: tuple[int, ...]
    """Ids that carry no information."""
    num_listed: int | None
    """Number of names, if these are a list with one for each score."""
    stated_in: Path
    """File that states the classes: the card, or the model without one."""
    guesses: tuple[str, ...]
    """Sentences about what neither the model nor the card says."""

    @property
    def dtype(self) -> npt.DTypeLike:
        """Type of the input."""
        return self.network.input.dtype

    def size_for(self, width: int, height: int) -> tuple[int, int]:
        """Columns and rows of the network's picture for one of `width` x `height` pixels."""
        if self.size is not None:
            return self.size
        return _rounded(width), _rounded(height)

    def check_num_classes(self, num_classes: int) -> None:
        """Check that a number of scores is that of the classes.

        Raises:
            InputError: there are too few, or names that are a list are not as many.
        """
        if num_classes < 2:
            raise InputError(f"{self.network.path}: found scores of {num_classes} class, needed two or more")
        if self.num_listed not in (None, num_classes):
            needed = f"{num_classes}, one for each score of {self.network.path}"
            raise InputError(f"{self.stated_in}: classes: found {self.num_listed} names, needed {needed}")
        highest = max((value for ids in self.classes.values() for value in ids), default=0)
        if highest >= num_classes:
            needed = f"at most {num_classes - 1}, the last score of {self.network.path}"
            raise InputError(f"{self.stated_in}: classes: found id {highest}, needed {needed}")

    def describe(self) -> list[tuple[str, str]]:
        """Describe what was understood, in pairs of a word and a sentence."""
        size = "any, so that of the picture" if self.size is None else f"{self.size[0]} x {self.size[1]}"
        place = "last" if self.channels_last else "first"
        numbers = " ".join(f"{each:g}" for each in (*self.mean, *self.std))
        names = ", ".join(list(self.classes)[:6]) + (", ..." if len(self.classes) > 6 else "")
        return [
            ("input", str(self.network.input)),
            *(("output", str(port)) for port in self.network.outputs),
            ("size", f"{size}, {self.fit}"),
            ("colours", f"{self.color}, channels {place}"),
            ("numbers", f"(pixel * {self.scale:g} - mean) / std, with mean and std {numbers}"),
            ("read", f"{' and '.join(self.outputs)} as {self.kind or 'logits or probabilities'}"),
            ("classes", f"{len(self.classes)}: {names}" if self.classes else "not named"),
            ("ignored", ", ".join(map(str, self.ignore)) or "none"),
            *(("guessed", guess) for guess in self.guesses),
        ]


def understand(network: Network, card: PictureCard | None, card_path: Path) -> PictureModel:
    """Join what the model says with what its card adds.

    Args:
        network: The network.
        card: Its card, if it has one.
        card_path: File of the card, or of the model without one.

    Raises:
        InputError: the two contradict one another, or the network is not one for pictures.
    """
    guesses: list[str] = []
    card = card or PictureCard(semcal_picture_model=1)
    channels_last, num_channels, size = _read_input(network, card, card_path, guesses)
    color, scale, mean, std = _normalisation(network, card, card_path, num_channels, guesses)
    outputs, kind = _read_outputs(network, card, card_path, guesses)
    classes, ignore = read_classes(card, card_path)
    if not classes:
        guesses.append("classes have no names: ids are kept as they are; give classes in a card")
    return PictureModel(
        network,
        size,
        card.fit,
        color,
        channels_last,
        scale,
        mean,
        std,
        outputs,
        kind,
        card.align_corners,
        classes,
        ignore,
        len(card.classes) if isinstance(card.classes, tuple) else None,
        card_path,
        tuple(guesses),
    )


def _rounded(side: int) -> int:
    return min(-(-side // MULTIPLE) * MULTIPLE, MAX_SIDE)


def _read_input(
    network: Network, card: PictureCard, card_path: Path, guesses: list[str]
) -> tuple[bool, int, tuple[int, int] | None]:
    """Read the place and the number of the channels, and the size, from the shape of the input."""
    port = network.input
    if len(port.shape) != 4 or port.dtype not in ("float32", "float16", "float64", "uint8"):
        raise InputError(
            f"{network.path}: found input {port}, needed four axes of float or uint8: a batch of pictures"
        )
    if port.shape[0] not in (1, None):
        raise InputError(f"{network.path}: found input {port}, needed a batch of one picture")
    if card.layout is not None:
        is_last = card.layout == "channels_last"
    else:
        may_be_first, may_be_last = port.shape[1] in CHANNELS, port.shape[3] in CHANNELS
        if not may_be_first and not may_be_last:
            guesses.append("channels stand before rows and columns: the model leaves them open")
        is_last = may_be_last and not may_be_first
    channels, rows, columns = (
        (port.shape[3], *port.shape[1:3]) if is_last else (port.shape[1], *port.shape[2:])
    )
    if channels not in (*CHANNELS, None):
        raise InputError(f"{network.path}: found input {port}, needed 1 or 3 channels")
    wanted = card.size or (None, None)
    for name, found, needed in (("columns", columns, wanted[0]), ("rows", rows, wanted[1])):
        if found is not None and needed is not None and found != needed:
            raise InputError(
                f"{card_path}: size: found {needed} {name}, needed the {found} of {network.path}"
            )
    columns, rows = columns or wanted[0], rows or wanted[1]
    size = None if columns is None or rows is None else (columns, rows)
    if size is None:
        if columns is not None or rows is not None or card.fit == "tiles":
            raise InputError(f"{card_path}: size: found none, needed columns and rows for {port}")
        guesses.append(f"the size is the picture's, up to a multiple of {MULTIPLE}")
    elif size[0] * size[1] > MAX_NETWORK_PIXELS:
        area = f"{size[0]:,} x {size[1]:,} pixels"
        raise InputError(f"{card_path}: size: found {area}, needed at most {MAX_NETWORK_PIXELS:,}")
    return is_last, channels or (1 if card.color == "gray" else 3), size


def _normalisation(
    network: Network, card: PictureCard, card_path: Path, num_channels: int, guesses: list[str]
) -> tuple[Color, float, tuple[float, ...], tuple[float, ...]]:
    """Complete the order of the colours and the normalisation of pixels."""
    color: Color = card.color or ("gray" if num_channels == 1 else "rgb")
    if (color == "gray") != (num_channels == 1):
        raise InputError(f"{card_path}: color: found {color}, needed {num_channels} channels")
    is_raw = network.input.dtype == "uint8"
    mean, std = card.mean, card.std
    if is_raw:
        if card.scale is not None or mean is not None or std is not None:
            raise InputError(
                f"{card_path}: scale, mean, std: found some, needed none: {network.path} takes uint8 pixels"
            )
        return color, 1.0, (0.0,) * num_channels, (1.0,) * num_channels
    for name, numbers in (("mean", mean), ("std", std)):
        if numbers is not None and len(numbers) not in (1, num_channels):
            raise InputError(f"{card_path}: {name}: found {len(numbers)} numbers, needed {num_channels}")
        if card.scale is None and numbers is not None and max(numbers) > MAX_SCALED:
            needed = f"at most {MAX_SCALED:g} for pixels from 0 to 1, or scale: 1.0 for pixels from 0 to 255"
            raise InputError(f"{card_path}: {name}: found {max(numbers):g}, needed {needed}")
    if card.color is None and num_channels == 3:
        guesses.append("colours are red, green, blue")
    if card.scale is None and mean is None and std is None:
        guesses.append("pixels are scaled to 1 and normalised by ImageNet's mean and standard deviation")
        mean, std = IMAGENET_MEAN, IMAGENET_STD
        if num_channels == 1:
            mean, std = (sum(mean) / len(mean),), (sum(std) / len(std),)
        elif color == "bgr":
            mean, std = mean[::-1], std[::-1]
    scale = 1.0 / 255.0 if card.scale is None else card.scale
    return color, scale, _each(mean or (0.0,), num_channels), _each(std or (1.0,), num_channels)


def _each(numbers: tuple[float, ...], num_channels: int) -> tuple[float, ...]:
    """Give one number for each channel."""
    return numbers * (num_channels // len(numbers))


def _read_outputs(
    network: Network, card: PictureCard, card_path: Path, guesses: list[str]
) -> tuple[tuple[str, ...], Kind | None]:
    """Choose the outputs that are read, and what they are."""
    ports = {port.name: port for port in network.outputs}
    if card.kind == "masks" or (card.kind is None and card.output is None and set(MASKS) <= set(ports)):
        if not set(MASKS) <= set(ports):
            raise InputError(
                f"{card_path}: kind: found masks, needed outputs named {' and '.join(MASKS)}, not "
                f"{', '.join(ports)}"
            )
        return MASKS, "masks"
    if card.output is not None and card.output not in ports:
        raise InputError(f"{card_path}: output: found {card.output!r}, needed one of: {', '.join(ports)}")
    if card.output is None and len(ports) > 1:
        name = next((name for name in PLAIN if name in ports), next(iter(ports)))
        guesses.append(f"of the outputs, {name!r} is the one that matters")
    else:
        name = card.output or next(iter(ports))
    return (name,), card.kind or _kind_of(network, ports[name])


def _kind_of(network: Network, port: Port) -> Kind | None:
    """Tell ids from scores by the type and the axes of an output; None for scores."""
    if port.dtype.startswith(("int", "uint")):
        return "ids"
    if not port.dtype.startswith("float"):
        raise InputError(f"{network.path}: found output {port}, needed scores or ids of classes")
    # Some runtimes leave the axes of an output open altogether.
    if port.shape and len(port.shape) != 4:
        raise InputError(
            f"{network.path}: found output {port}, needed four axes of scores, or ids as whole numbers"
        )
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
