"""The polish: Newton's method on the mutual information of all points at full resolution, if held-out data agree.

A pose is first polished on a part of the data. The rest shows whether it got better or worse, by the difference of
pointwise mutual information, paired over parts of the images. An accepted polish is then repeated on all data.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.config import PolishConfig
from semcal_cli.estimation.stage import StageResult
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.observations import NO_CLASS, Observations
from semcal_cli.result.sections import HeldOut
from semcal_cli.threads import thread_pool

HELD_OUT = 3
"""One of this many frames, or regions of the images, is held out."""


@dataclass(frozen=True, kw_only=True)
class Polish(StageResult):
    """Result of the polish. If the polish was rejected, its pose is the previous one."""

    held_out: HeldOut
    """Test of the polish on data that it did not use."""
    max_loss: float
    """Largest loss of held-out data, in standard errors, at which the polish is accepted."""
    is_settled: bool
    moved_px: float
    """Root mean square by which the last round moved the points, in pixels; infinite if nothing moves the agreement."""
    max_moved_px: float
    """Largest such movement of a polish that has settled."""

    @property
    def is_accepted(self) -> bool:
        """Whether held-out data did not get worse."""
        return self.held_out.accepted


def polish_pose(observations: Observations, T_camera_lidar: Pose, config: PolishConfig) -> Polish:
    """Polish a pose that is about a pixel off.

    Args:
        observations: Labelled points and label images of all frames.
        T_camera_lidar: (4, 4) to start at.
        config: Settings of Newton's method, and when its result is rejected.
    """
    kept, held_out = split(observations, config)
    polished = newton(kept, T_camera_lidar, config)
    held_out_gain = _held_out_gain(kept, held_out, T_camera_lidar, polished.T_camera_lidar)
    gain, sigma = held_out_gain.gain, held_out_gain.sigma
    max_loss = config.max_loss_of_tops if observations.is_multimodal else config.max_loss
    # Without a standard error, there is no evidence for the polish.
    is_accepted = math.isfinite(sigma) and gain >= -max_loss * sigma
    T_polished = T_camera_lidar
    if is_accepted:
        polished = newton(observations, polished.T_camera_lidar, config, polished.inverse_curvature)
        T_polished = polished.T_camera_lidar
    check = HeldOut(
        accepted=is_accepted,
        held_out_gain_nats=gain,
        held_out_sigma_nats=sigma if math.isfinite(sigma) else None,
    )
    is_settled = polished.moved_px <= config.settled_px
    note = "not better, so the previous pose is kept"
    if is_accepted:
        note = "kept" if is_settled else "kept, still moving at the end"
    return Polish(
        T_camera_lidar=T_polished,
        agreement=core.agreement(observations.core, T_polished),
        settings={"polish": asdict(config) | observations.shared_settings},
        note=note,
        details=f"held out {gain:+.4f} +- {sigma:.4f} {observations.unit}",
        held_out=check,
        max_loss=max_loss,
        is_settled=is_settled,
        moved_px=polished.moved_px,
        max_moved_px=config.settled_px,
    )


def _held_out_gain(
    kept: Observations, held_out: Observations, T_before: Pose, T_after: Pose
) -> core.InformationGain:
    """Compute how much held-out data gain from a polish on the other data.

    Classes are compared by the table of the other data. Segments, which differ from frame to frame, have their own
    table at each pose, so that only the pose is held out.
    """
    if held_out.has_partitions:
        (gain,) = core.information_gains(held_out.core, T_before, [T_after])
        return gain
    return core.held_out_gain(kept.core, held_out.core, T_before, T_after)


def split(observations: Observations, config: PolishConfig) -> tuple[Observations, Observations]:
    """Divide observations into those to work with and those held out: frames, or regions of the images."""
    if observations.num_frames >= config.min_frames:
        is_held_out = np.arange(observations.num_frames) % HELD_OUT == HELD_OUT - 1
        kept, held_out = np.flatnonzero(~is_held_out), np.flatnonzero(is_held_out)
        return observations.of_frames(kept.tolist()), observations.of_frames(held_out.tolist())
    height, width = observations.images[0].classes.shape
    side = max(width / config.regions_across, 1.0)
    row, column = ((np.arange(size) // side).astype(np.int64) for size in (height, width))
    # Diagonal stripes give each part pieces of every row and column.
    region = np.add.outer(row, column) % HELD_OUT == HELD_OUT - 1
    return _masked(observations, region), _masked(observations, ~region)


def newton(
    observations: Observations,
    T_camera_lidar: Pose,
    config: PolishConfig,
    inverse_curvature: npt.NDArray[np.float64] | None = None,
) -> core.Polished:
    """Find the maximum by Newton's method from a pose that is about a pixel off, without held-out data.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4) to start at.
        config: Settings of the polish.
        inverse_curvature: (6, 6) of a run nearby, which saves time.
    """
    return core.polish(observations.core, T_camera_lidar, config, inverse_curvature)


def newton_from_each(observations: Observations, poses: Sequence[Pose], config: PolishConfig) -> list[Pose]:
    """Find the maxima (4, 4) near several poses, as `newton` does, side by side."""
    with thread_pool() as pool:
        return list(pool.map(lambda T: newton(observations, T, config).T_camera_lidar, poses))


def _masked(observations: Observations, region: np.ndarray) -> Observations:
    return observations.with_images(
        image.with_classes(np.where(region, NO_CLASS, image.classes).astype(np.uint8))
        for image in observations.images
    )
