"""Point labels from a network for range images, or from geometry alone."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.files.array_forms import SweepCloud
from semcal_cli.labelling.card import CloudCard, NeighborsConfig, PointCard
from semcal_cli.labelling.cloud_labeller import CloudLabeller, channel_values
from semcal_cli.labelling.model import Model, card_of, cloud_model, point_model
from semcal_cli.labelling.onnx_network import Network
from semcal_cli.observations.cues.segments import SegmentationConfig

OWN_PIXEL = NeighborsConfig(count=1, search=1)
"""Neighbours of a point that simply takes the class of its own pixel."""
KIND_IDS = {"ground": 1, "objects": 2}
"""Ids of the kinds of segments in label files; 0 means none."""
INSTANCE_BITS = 16
"""Number of bits of a label below those of the instance: SemanticKITTI's layout."""


class SweepLabeller:
    """Labels sweeps with a network for range images. Threads may share it."""

    def __init__(self, model: Model[PointCard]) -> None:
        """Plan the range image.

        Raises:
            InputError: its size or field of view is impossible.
        """
        self.model, card = model, model.card
        elevations, azimuths = (
            (math.radians(first), math.radians(last))
            for first, last in (card.elevation_deg, card.azimuth_deg)
        )
        self.view = core.RangeView(card.rows, card.columns, elevations, azimuths, card.outside == "clamp")

    def ids(self, cloud: SweepCloud) -> npt.NDArray[np.uint16]:
        """Label the points of a sweep.

        Returns:
            (N,) ids; `core.NO_ID` outside the range image.

        Raises:
            InputError: the cloud lacks a field that the network needs, or the network or its output is wrong.
        """
        card = self.model.card
        network = self.model.network
        rings = channel_values(cloud, "ring", self.model) if card.row_by == "ring" else None
        projection = self.view.project(cloud.points, rings)
        tensor = self.tensor(cloud, projection.points)
        (output,) = network.run({network.input.name: tensor}, self.model.outputs).values()
        pixels = self._pixels(output)
        pixels[projection.points == core.NO_PIXEL] = core.NO_ID
        neighbors = card.neighbors or OWN_PIXEL
        return self.view.carry_back(projection, cloud.points, pixels, neighbors)

    def tensor(self, cloud: SweepCloud, points: npt.NDArray[np.uint32]) -> npt.NDArray[np.float32]:
        """Make the network's input (1, C, rows, columns) from the index of the point in each pixel (P,)."""
        card = self.model.card
        is_filled = points != core.NO_PIXEL
        planes = np.full((len(card.channels), len(points)), card.empty, np.float32)
        for plane, channel, mean, std in zip(planes, card.channels, card.mean, card.std, strict=True):
            if channel == "mask":
                plane[:] = is_filled
                continue
            values = channel_values(cloud, channel, self.model)[points[is_filled]]
            plane[is_filled] = (values - mean) / std
        return planes.reshape(1, len(planes), card.rows, card.columns)

    def _pixels(self, output: npt.NDArray[Any]) -> npt.NDArray[np.uint16]:
        """Read the classes of the pixels (P,) from scores (1, C, rows, columns) or ids."""
        network, size = self.model.network, (self.model.card.rows, self.model.card.columns)
        if output.ndim == 4 and output.shape[0] == 1 and output.shape[1] > 1 and output.shape[2:] == size:
            if not np.isfinite(output).all():
                raise network.unfit("a score that is not finite", "finite ones")
            return np.asarray(output[0].argmax(axis=0).ravel(), np.uint16)
        is_whole = np.issubdtype(output.dtype, np.integer)
        if is_whole and tuple(side for side in output.shape if side != 1) == size:
            return network.as_ids(output).ravel()
        needed = f"1 x classes x {size[0]} x {size[1]}, or ids as whole numbers"
        raise network.unfit(f"output {output.shape} of {output.dtype}", needed)


def segment_labels(points: npt.NDArray[np.float32]) -> npt.NDArray[np.uint32]:
    """Label the points (N, 3) of a sweep by geometry: the kind in the lower 16 bits, the segment in the upper 16.

    Segments are numbered from 1; 0 means none.
    """
    (sweep,) = core.segment_sweeps([points], SegmentationConfig())
    kinds = np.append(np.where(sweep.kinds == core.GROUND, KIND_IDS["ground"], KIND_IDS["objects"]), 0)
    place = np.minimum(sweep.ids, sweep.num_segments)
    instances = np.where(place < sweep.num_segments, (place + 1) % (1 << INSTANCE_BITS), 0)
    return np.asarray(kinds[place] + (instances << INSTANCE_BITS), np.uint32)


def sweep_labeller(network: Network, card: str | None) -> SweepLabeller | CloudLabeller:
    """Make the labeller for a network, which takes range images or points, as its card says.

    Arguments and errors are those of `point_model`.
    """
    if isinstance(card_of(network, card)[0], CloudCard):
        return CloudLabeller(cloud_model(network, card))
    return SweepLabeller(point_model(network, card))
