"""The finish: to the top of the mutual information of all points in full resolution, if held-out data agree.

A pose is first polished on a part of the data. The rest says whether it got better or worse there, by the difference of
pointwise mutual information, paired over parts of the pictures. A polish that holds is then repeated on everything.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.config import PolishConfig
from semcal_cli.drive.classes import NO_CLASS
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.poses import Pose

HELD_OUT = 3
"""One of so many frames, or regions of the pictures, is held out."""


@dataclass(frozen=True)
class Polish:
    """What the finish arrived at."""

    T_camera_lidar: Pose
    """The pose before, if the polish was rejected."""
    is_accepted: bool
    is_settled: bool
    moved_px: float
    """How far the last round moved the points, root mean square."""
    gain_nats: float
    """How much better held-out data agree after the polish than before ..."""
    sigma_nats: float
    """... and the standard error of that."""


def polish(observations: Observations, T_camera_lidar: Pose, config: PolishConfig) -> Polish:
    """Polish a pose that is about a pixel off.

    Args:
        observations: Labelled points and label images of all frames.
        T_camera_lidar: (4, 4) to start at.
        config: How.
    """
    kept, held_out = split(observations, config)
    T_kept, moved_px, inverse_curvature = climb(kept, T_camera_lidar, config)
    gain, sigma = _core.held_out_gain(kept.core, held_out.core, T_camera_lidar, T_kept)
    # Without a standard error, nothing speaks for it.
    is_accepted = math.isfinite(sigma) and gain >= -config.max_loss * sigma
    T_polished = T_camera_lidar
    if is_accepted:
        T_polished, moved_px, _ = climb(observations, T_kept, config, inverse_curvature)
    return Polish(T_polished, is_accepted, moved_px <= config.settled_px, moved_px, gain, sigma)


def split(observations: Observations, config: PolishConfig) -> tuple[Observations, Observations]:
    """Divide observations into those to work with and those held out: frames, or regions of the pictures."""
    if observations.num_frames >= config.min_frames:
        is_held_out = np.arange(observations.num_frames) % HELD_OUT == HELD_OUT - 1
        kept, held_out = np.flatnonzero(~is_held_out), np.flatnonzero(is_held_out)
        return observations.of_frames(kept.tolist()), observations.of_frames(held_out.tolist())
    height, width = observations.image_classes[0].shape
    side = max(width / config.regions_across, 1.0)
    row, column = np.arange(height)[:, None] // side, np.arange(width) // side
    # Diagonal stripes, so that each part has pieces of every row and column.
    region = (row + column) % HELD_OUT == HELD_OUT - 1
    return _masked(observations, region), _masked(observations, ~region)


def climb(
    observations: Observations,
    T_camera_lidar: Pose,
    config: PolishConfig,
    inverse_curvature: npt.NDArray[np.float64] | None = None,
) -> tuple[Pose, float, npt.NDArray[np.float64] | None]:
    """Climb to the top from a pose that is about a pixel off, without held-out data.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4) to start at.
        config: How.
        inverse_curvature: (6, 6) of a climb near by, which saves time.

    Returns:
        T_camera_lidar, how far the last round moved the points, pixels, and the inverse curvature, if there is one.
    """
    return _core.polish(
        observations.core,
        T_camera_lidar,
        factor=1,
        edge_band=config.edge_band_px,
        visible_only=True,
        max_rounds=config.max_rounds,
        max_steps=config.max_steps,
        tolerance=config.tolerance_px,
        max_baseline=config.max_baseline_m,
        inverse_curvature=inverse_curvature,
    )


def _masked(observations: Observations, region: np.ndarray) -> Observations:
    blank = [np.where(region, NO_CLASS, image).astype(np.uint8) for image in observations.image_classes]
    return replace(observations, image_classes=blank)
