"""Opening of models with their cards."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semcal_cli.drive.document import Camera
from semcal_cli.labelling.card import CompletePictureCard, PictureCard, PointCard, find_card, read_card
from semcal_cli.labelling.model import Model
from semcal_cli.labelling.network import open_network
from semcal_cli.labelling.picture_model import understand
from semcal_cli.labelling.pictures import PictureLabeller
from semcal_cli.labelling.point_model import understand_points

SHOWN = (640, 480)
"""Columns and rows of the picture on which a network is tried that takes any size."""
MIDDLE_GRAY = 128


def open_picture_model(
    path: Path, card: str | None, device: str = "cpu", num_threads: int | None = None
) -> Model[CompletePictureCard]:
    """Open a model for pictures with its card.

    Args:
        path: File of the model, .onnx.
        card: Name or file of the card; None for the one beside the model, MODEL.yaml, if it is there.
        device: cpu or cuda.
        num_threads: Threads of a run; None for all cores.

    Raises:
        InputError: the model or the card is wrong, one contradicts the other, or the card is of a network for sweeps.
    """
    stated, card_path = _card_of(path, card)
    network = open_network(path, device, num_threads)
    if isinstance(stated, PointCard):
        raise network.unfit("the card of a network for sweeps", "one for pictures")
    return understand(network, stated, card_path)


def open_point_model(
    path: Path, card: str | None, device: str = "cpu", num_threads: int | None = None
) -> Model[PointCard]:
    """Open a model for range images with its card; arguments and errors are those of `open_picture_model`."""
    stated, card_path = _card_of(path, card)
    network = open_network(path, device, num_threads)
    if not isinstance(stated, PointCard):
        needed = "one with --point-card"
        raise network.unfit("no card of a network for sweeps (semcal_point_model: 1)", needed)
    return understand_points(network, stated, card_path)


def describe_model(
    path: Path, card: str | None, device: str = "cpu", num_threads: int | None = None
) -> list[tuple[str, str]]:
    """Describe what is understood of a model, in pairs of a word and a sentence, and try it if it is for pictures.

    Arguments and errors are those of `open_picture_model`.
    """
    stated, card_path = _card_of(path, card)
    network = open_network(path, device, num_threads)
    if isinstance(stated, PointCard):
        return understand_points(network, stated, card_path).describe()
    model = understand(network, stated, card_path)
    return [*model.describe(), ("tried", _tried(model))]


def _card_of(model: Path, name: str | None) -> tuple[PictureCard | PointCard | None, Path]:
    """Read the card of a model, and give its file, or that of a model without one."""
    path = find_card(name, model)
    return (None, model) if path is None else (read_card(path), path)


def _tried(model: Model[CompletePictureCard]) -> str:
    """Run a network on a grey picture, and describe the labels that it gives."""
    width, height = SHOWN if model.card.size is None else model.card.size
    K = ((float(width), 0.0, width / 2.0), (0.0, float(width), height / 2.0), (0.0, 0.0, 1.0))
    camera = Camera(model="plumb_bob", width=width, height=height, K=K)
    ids = PictureLabeller(model, camera).ids(np.full((height, width, 3), MIDDLE_GRAY, np.uint8))
    found = ", ".join(map(str, np.unique(ids)[:8]))
    return f"labels of a grey picture of {width} x {height}: ids {found}"
