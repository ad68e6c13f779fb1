"""Whether labels of points were made from those of the pictures, through some transform.

Such labels agree best at that transform, right or wrong, so that they tell nothing of the camera. They betray
themselves behind things: a point that the camera does not see has the class of what hides it. Pixels then tell as much
of hidden points as of visible ones, however many labels are wrong.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.frame_selection import few_frames
from semcal_cli.drive.observations import NO_CLASS, Observations
from semcal_cli.geometry.poses import Pose
from semcal_cli.result.checks.check import Measured
from semcal_cli.result.checks.table import LEAKED_LABELS

NUM_FRAMES = 5
"""Number of frames that are looked at."""
LEAST_POINTS = 200
"""Number of hidden points, or fewer, that tell nothing."""
LEAST_CLASSES = 2.0
"""Number of equally frequent classes that hidden points vary like, or fewer, that tell nothing."""
LEAST_EXPLAINED = 0.1
"""Share of the classes of visible points that counts at least as told: it was 29 to 100 %, also with 30 % wrong labels
and 1 degree off, and at a pose where pixels tell nothing the ratio is chance."""


def check_leaks(observations: Observations, T_camera_lidar: Pose) -> tuple[Measured, ...]:
    """Check that hidden points have classes of their own, and not those of what hides them.

    Args:
        observations: Labelled points and label images, of labels alone.
        T_camera_lidar: (4, 4) pose, metres.
    """
    hidden, visible = _joints(few_frames(observations, NUM_FRAMES), T_camera_lidar)
    if hidden.sum() < LEAST_POINTS or _entropy(hidden.sum(axis=1)) < np.log(LEAST_CLASSES):
        return ()
    # At a wrong pose pixels tell little of any point, and by chance as much of both.
    share = _share_explained(hidden) / max(_share_explained(visible), LEAST_EXPLAINED)
    found = (
        f"labels of points seem to be made from those of the pictures, pixels tell {share:.0%} as much of points that "
        f"are hidden behind what they show as of visible points, needed at most {LEAKED_LABELS.limit():.0%}"
    )
    return (LEAKED_LABELS.measured(share, found),)


def _joints(
    observations: Observations, T_camera_lidar: Pose
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Count the classes of hidden and of visible points, and of the pixels that they land on (C, C) each."""
    camera, counts = core_camera(observations.camera), np.zeros((2, NO_CLASS + 1, NO_CLASS + 1))
    height, width = observations.images[0].classes.shape
    for cloud, image in zip(observations.clouds, observations.images, strict=True):
        projected = _core.project_points(camera, cloud.points, T_camera_lidar)
        is_seen = np.isfinite(projected.ranges)
        column, row = np.rint(projected.pixels[is_seen]).astype(np.int64).T
        pixels = image.classes[row.clip(0, height - 1), column.clip(0, width - 1)]
        is_visible = (~projected.is_hidden[is_seen]).astype(np.int64)
        np.add.at(counts, (is_visible, cloud.classes[is_seen], pixels), 1.0)
    hidden, visible = counts[:, :NO_CLASS, :NO_CLASS]
    return hidden, visible


def _share_explained(joint: npt.NDArray[np.float64]) -> float:
    """Compute the share of the entropy of the points' classes that the pixels tell, from how often both come up."""
    points_nats, pixels_nats = _entropy(joint.sum(axis=1)), _entropy(joint.sum(axis=0))
    num_points, num_pixels = (np.count_nonzero(joint.any(axis=axis)) for axis in (1, 0))
    # Miller's correction: chance tells so much of few points.
    by_chance = (num_points - 1) * (num_pixels - 1) / (2.0 * max(joint.sum(), 1.0))
    return float((points_nats + pixels_nats - _entropy(joint.ravel()) - by_chance) / max(points_nats, 1e-9))


def _entropy(counts: npt.NDArray[np.float64]) -> float:
    """Compute the entropy of classes, nats, from how often they come up."""
    shares = counts[counts > 0.0] / max(counts.sum(), 1.0)
    return float(-(shares * np.log(shares)).sum())
