"""Opening of models with their cards."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semcal_cli.drive.document import Camera
from semcal_cli.errors import InputError
from semcal_cli.labelling.card import PointCard, find_card, read_card
from semcal_cli.labelling.network import open_network
from semcal_cli.labelling.picture_model import PictureModel, understand
from semcal_cli.labelling.pictures import PictureLabeller
from semcal_cli.labelling.point_model import PointModel, understand_points

SHOWN = (640, 480)
"""Columns and rows of the picture on which a network is tried that takes any size."""
MIDDLE_GRAY = 128


def open_model(
    path: Path, card: str | None, device: str = "cpu", num_threads: int | None = None
) -> PictureModel | PointModel:
    """Open a model with its card.

    Args:
        path: File of the model, .onnx.
        card: Name or file of the card; None for the one beside the model, MODEL.yaml, if it is there.
        device: cpu or cuda.
        num_threads: Threads of a run; None for all cores.

    Raises:
        InputError: the model or the card is wrong, or one contradicts the other.
    """
    found = find_card(card, path)
    stated = None if found is None else read_card(found)
    network = open_network(path, device, num_threads)
    if isinstance(stated, PointCard) and found is not None:
        return understand_points(network, stated, found)
    assert not isinstance(stated, PointCard)
    return understand(network, stated, found or path)


def open_picture_model(
    path: Path, card: str | None, device: str = "cpu", num_threads: int | None = None
) -> PictureModel:
    """Open a model for pictures; see `open_model`.

    Raises:
        InputError: as `open_model`, or the card is one of a network for sweeps.
    """
    model = open_model(path, card, device, num_threads)
    if isinstance(model, PointModel):
        raise InputError(f"{path}: found the card of a network for sweeps, needed one for pictures")
    return model


def open_point_model(
    path: Path, card: str | None, device: str = "cpu", num_threads: int | None = None
) -> PointModel:
    """Open a model for range images; see `open_model`.

    Raises:
        InputError: as `open_model`, or there is no card of a network for sweeps.
    """
    model = open_model(path, card, device, num_threads)
    if isinstance(model, PictureModel):
        raise InputError(
            f"{path}: found no card of a network for sweeps (semcal_point_model: 1), needed one with --point-card"
        )
    return model


def try_out(model: PictureModel) -> str:
    """Run a network on a grey picture, and describe the labels that it gives.

    Raises:
        InputError: the network fails, or its output cannot be labels.
    """
    width, height = SHOWN if model.size is None else model.size
    K = ((float(width), 0.0, width / 2.0), (0.0, float(width), height / 2.0), (0.0, 0.0, 1.0))
    camera = Camera(model="plumb_bob", width=width, height=height, K=K)
    picture = np.full((height, width, 3), MIDDLE_GRAY, np.uint8)
    ids = PictureLabeller(model, camera).ids(picture)
    found = ", ".join(map(str, np.unique(ids)[:8]))
    return f"labels of a grey picture of {width} x {height}: ids {found}"
