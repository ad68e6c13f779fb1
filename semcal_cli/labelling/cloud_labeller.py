"""Point labels from networks that take the points of a sweep."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from semcal_cli.errors import InputError
from semcal_cli.files.array_forms import SweepCloud
from semcal_cli.labelling.card import CloudCard, PointCard
from semcal_cli.labelling.model import Model


class CloudLabeller:
    """Labels sweeps with a network that takes points. Threads may share it."""

    def __init__(self, model: Model[CloudCard]) -> None:
        """Take a network with its card."""
        self.model = model

    def ids(self, cloud: SweepCloud) -> npt.NDArray[np.uint16]:
        """Label the points of a sweep.

        Returns:
            (N,) ids.

        Raises:
            InputError: the cloud lacks a field that the network needs, or the network or its output is wrong.
        """
        network, card = self.model.network, self.model.card
        port, tensor = network.input, self.tensor(cloud)
        if port.shape[-1] != len(card.channels):
            tensor = tensor.T
        tensors = {port.name: tensor[None] if len(port.shape) == 3 else tensor}
        (output,) = network.run(tensors, self.model.outputs).values()
        return self._ids(output, len(cloud.points))

    def tensor(self, cloud: SweepCloud) -> npt.NDArray[np.float32]:
        """Make the network's input (N, C) from the points."""
        card = self.model.card
        columns = [channel_values(cloud, channel, self.model) for channel in card.channels]
        numbers = np.stack(columns, axis=1) - (card.mean or 0.0)
        return np.asarray(numbers / (card.std or 1.0), np.float32)

    def _ids(self, output: npt.NDArray[Any], count: int) -> npt.NDArray[np.uint16]:
        """Read classes (N,) from scores (N x classes or classes x N) or ids, with or without a batch axis of one."""
        network = self.model.network
        values = output[0] if output.ndim == 3 and len(output) == 1 else output
        if np.issubdtype(values.dtype, np.integer) and values.size == count:
            return network.as_ids(values.ravel())
        if np.issubdtype(values.dtype, np.floating) and values.ndim == 2 and count in values.shape:
            if not np.isfinite(values).all():
                raise network.unfit("a score that is not finite", "finite ones")
            axis = 1 if len(values) == count else 0
            if values.shape[axis] > 1:
                return np.asarray(values.argmax(axis), np.uint16)
        needed = f"{count} x classes, or {count} ids as whole numbers"
        raise network.unfit(f"output {output.shape} of {output.dtype}", needed)


def channel_values(
    cloud: SweepCloud, channel: str, model: Model[PointCard] | Model[CloudCard]
) -> npt.NDArray[Any]:
    """Compute a channel of a network's input for each point (N,), before normalisation.

    Raises:
        InputError: the cloud lacks a field that the network needs.
    """
    if channel == "range":
        return np.asarray(np.linalg.norm(cloud.points.astype(np.float64), axis=1))
    if channel in "xyz":
        return cloud.points[:, "xyz".index(channel)].astype(np.float64)
    values: npt.NDArray[Any] | None = getattr(cloud, channel)
    if values is None:
        raise InputError(f"found points without {channel}, which {model.network.path} needs")
    return values * model.card.intensity_scale if channel == "intensity" else values
