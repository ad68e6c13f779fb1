"""Networks that are joined with their cards: of pictures, and of range images of sweeps."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semcal_cli.drive.document import Camera
from semcal_cli.labelling.card import (
    CompletePictureCard,
    PictureCard,
    PointCard,
    find_card,
    read_card,
    read_classes,
)
from semcal_cli.labelling.model import Model, output_of, wrong_key
from semcal_cli.labelling.network import Network
from semcal_cli.labelling.picture_model import understand
from semcal_cli.labelling.pictures import PictureLabeller

SHOWN = (640, 480)
"""Columns and rows of the picture on which a network is tried that takes any size."""
MIDDLE_GRAY = 128


def picture_model(network: Network, card: str | None) -> Model[CompletePictureCard]:
    """Join a network for pictures with its card.

    Args:
        network: The network.
        card: Name or file of the card; None for the one beside the model, MODEL.yaml, if it is there.

    Raises:
        InputError: the card is missing, wrong or of a network for sweeps, or the network contradicts it.
    """
    stated, card_path = _card_of(network, card)
    if isinstance(stated, PointCard):
        raise network.unfit("the card of a network for sweeps", "one for pictures")
    return understand(network, stated, card_path)


def point_model(network: Network, card: str | None) -> Model[PointCard]:
    """Join a network for range images with its card; arguments and errors are those of `picture_model`."""
    stated, card_path = _card_of(network, card)
    if not isinstance(stated, PointCard):
        needed = "one with --point-card"
        raise network.unfit("no card of a network for sweeps (semcal_point_model: 1)", needed)
    return _understand_points(network, stated, card_path)


def describe_model(network: Network, card: str | None) -> list[tuple[str, str]]:
    """Describe what is understood of a network, in pairs of a word and a sentence, and try it if it is for pictures.

    Arguments and errors are those of `picture_model`.
    """
    stated, card_path = _card_of(network, card)
    if isinstance(stated, PointCard):
        return _understand_points(network, stated, card_path).describe()
    model = understand(network, stated, card_path)
    return [*model.describe(), ("tried", _tried(model))]


def _card_of(network: Network, name: str | None) -> tuple[PictureCard | PointCard | None, Path]:
    """Read the card of a network, and give its file, or that of a network without one."""
    path = find_card(name, network.path)
    return (None, network.path) if path is None else (read_card(path), path)


def _understand_points(network: Network, card: PointCard, card_path: Path) -> Model[PointCard]:
    """Join what a network for range images says with its card."""
    port, wanted = network.input, (1, len(card.channels), card.rows, card.columns)
    fits = len(port.shape) == 4 and all(
        size in (None, need) for size, need in zip(port.shape, wanted, strict=True)
    )
    if not fits or not port.dtype.startswith("float"):
        raise network.unfit(f"input {port}", f"{' x '.join(map(str, wanted))} float, as {card_path} says")
    output = output_of(network, card, card_path)
    if output is None:
        names = ", ".join(port.name for port in network.outputs)
        raise wrong_key(card_path, "output", "none", f"one of: {names}")
    return Model(network, card, card_path, (output,), *read_classes(card, card_path))


def _tried(model: Model[CompletePictureCard]) -> str:
    """Run a network on a grey picture, and describe the labels that it gives."""
    width, height = SHOWN if model.card.size is None else model.card.size
    K = ((float(width), 0.0, width / 2.0), (0.0, float(width), height / 2.0), (0.0, 0.0, 1.0))
    camera = Camera(model="plumb_bob", width=width, height=height, K=K)
    ids = PictureLabeller(model, camera).ids(np.full((height, width, 3), MIDDLE_GRAY, np.uint8))
    found = ", ".join(map(str, np.unique(ids)[:8]))
    return f"labels of a grey picture of {width} x {height}: ids {found}"
