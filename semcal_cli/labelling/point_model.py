"""A network for range images of sweeps, with its card."""

from __future__ import annotations

from pathlib import Path

from semcal_cli.labelling.card import PointCard, read_classes
from semcal_cli.labelling.model import Model, output_of, wrong_key
from semcal_cli.labelling.network import Network


def understand_points(network: Network, card: PointCard, card_path: Path) -> Model[PointCard]:
    """Join what the model says with its card.

    Raises:
        InputError: the two contradict one another, or the network is not one for range images.
    """
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
