"""A network that is joined with its card: all that is needed to run it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from semcal_cli.errors import InputError, mismatch
from semcal_cli.labelling.card import Card, CompletePictureCard, PointCard
from semcal_cli.labelling.network import Network

SHOWN_NAMES = 6
AnyCard = TypeVar("AnyCard", CompletePictureCard, PointCard)


@dataclass(frozen=True, eq=False)
class Model(Generic[AnyCard]):
    """A network, and what its file and its card say of it."""

    network: Network
    card: AnyCard
    """Card in which nothing is left open that is needed."""
    card_path: Path
    """File of the card, or of the model without one."""
    outputs: tuple[str, ...]
    """Names of the outputs that are read."""
    classes: Mapping[str, tuple[int, ...]]
    """Ids of each name; empty without names."""
    ignore: tuple[int, ...]
    """Ids that carry no information."""
    guesses: tuple[str, ...] = ()
    """Sentences about what neither the model nor the card says."""

    def describe(self) -> list[tuple[str, str]]:
        """Describe what was understood, in pairs of a word and a sentence."""
        read = " and ".join(self.outputs)
        if isinstance(self.card, CompletePictureCard):
            read += f" as {self.card.kind or 'logits or probabilities'}"
        names = ", ".join(list(self.classes)[:SHOWN_NAMES])
        more = ", ..." if len(self.classes) > SHOWN_NAMES else ""
        return [
            ("input", str(self.network.input)),
            *(("output", str(port)) for port in self.network.outputs),
            *self.card.describe(),
            ("read", read),
            ("classes", f"{len(self.classes)}: {names}{more}" if self.classes else "not named"),
            ("ignored", ", ".join(map(str, self.ignore)) or "none"),
            *(("guessed", guess) for guess in self.guesses),
        ]


def wrong_key(card_path: Path, key: str, found: object, needed: object) -> InputError:
    """Make the error of a key of a card that its network contradicts."""
    return InputError(f"{card_path}: {key}: {mismatch(found, needed)}")


def output_of(network: Network, card: Card, card_path: Path) -> str | None:
    """Find the output that a card names, or the only one; None if there are several and it names none.

    Raises:
        InputError: the network has no such output.
    """
    names = [port.name for port in network.outputs]
    if card.output is not None and card.output not in names:
        raise wrong_key(card_path, "output", repr(card.output), f"one of: {', '.join(names)}")
    return card.output or (names[0] if len(names) == 1 else None)
