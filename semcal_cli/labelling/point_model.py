"""A network for range images of sweeps, with its card."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from semcal_cli.errors import InputError
from semcal_cli.labelling.card import PointCard, read_classes
from semcal_cli.labelling.network import Network


@dataclass(frozen=True, eq=False)
class PointModel:
    """A network for range images, with all that is needed to run it."""

    network: Network
    card: PointCard
    output: str
    """Name of the output that is read."""
    classes: Mapping[str, tuple[int, ...]]
    """Ids of each name; empty without names."""
    ignore: tuple[int, ...]
    """Ids that carry no information."""

    def describe(self) -> list[tuple[str, str]]:
        """Describe what was understood, in pairs of a word and a sentence."""
        card = self.card
        (low, high), (left, right) = card.elevation_deg, card.azimuth_deg
        numbers = " ".join(f"{each:g}" for each in (*card.mean, *card.std))
        names = ", ".join(list(self.classes)[:6]) + (", ..." if len(self.classes) > 6 else "")
        return [
            ("input", str(self.network.input)),
            *(("output", str(port)) for port in self.network.outputs),
            ("size", f"{card.columns} x {card.rows}, rows by {card.row_by}"),
            ("field", f"{low:g} to {high:g} degrees up, {left:g} to {right:g} around"),
            ("channels", " ".join(card.channels)),
            ("numbers", f"(channel - mean) / std, with mean and std {numbers}; {card.empty:g} where empty"),
            ("read", self.output),
            ("classes", f"{len(self.classes)}: {names}" if self.classes else "not named"),
            ("ignored", ", ".join(map(str, self.ignore)) or "none"),
        ]


def understand_points(network: Network, card: PointCard, card_path: Path) -> PointModel:
    """Join what the model says with its card.

    Raises:
        InputError: the two contradict one another, or the network is not one for range images.
    """
    port, wanted = network.input, (1, len(card.channels), card.rows, card.columns)
    fits = len(port.shape) == 4 and all(
        size in (None, need) for size, need in zip(port.shape, wanted, strict=True)
    )
    if not fits or not port.dtype.startswith("float"):
        needed = " x ".join(map(str, wanted))
        raise InputError(f"{network.path}: found input {port}, needed {needed} float, as {card_path} says")
    names = [output.name for output in network.outputs]
    if card.output is None and len(names) > 1:
        raise InputError(f"{card_path}: output: found none, needed one of: {', '.join(names)}")
    if card.output is not None and card.output not in names:
        raise InputError(f"{card_path}: output: found {card.output!r}, needed one of: {', '.join(names)}")
    classes, ignore = read_classes(card, card_path)
    return PointModel(network, card, card.output or names[0], classes, ignore)
