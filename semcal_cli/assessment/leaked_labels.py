"""Whether labels of points were made from those of the pictures, through some transform.

Such labels agree best at that transform, right or wrong, so that they tell nothing of the camera. They betray
themselves behind things: a point that the camera does not see has the class of what hides it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.checks.belonging import LEAKED_LABELS
from semcal_cli.checks.check import Measured
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.classes import NO_CLASS
from semcal_cli.drive.frame_selection import few_frames
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.poses import Pose

NUM_FRAMES = 5
"""Number of frames that are looked at."""
LEAST_POINTS = 200
"""Number of hidden points, or fewer, that tell nothing."""
LEAST_CLASSES = 2.0
"""Number of equally frequent classes that hidden points vary like, or fewer, that tell nothing."""


def check_leaks(observations: Observations, T_camera_lidar: Pose) -> tuple[Measured, ...]:
    """Check that hidden points have classes of their own, and not those of what hides them.

    Args:
        observations: Labelled points and label images, of labels alone.
        T_camera_lidar: (4, 4) pose, metres.
    """
    joint = _joint_of_hidden(few_frames(observations, NUM_FRAMES), T_camera_lidar)
    of_points, of_pixels = (_entropy(joint.sum(axis=axis)) for axis in (1, 0))
    count = joint.sum()
    if count < LEAST_POINTS or of_points < np.log(LEAST_CLASSES):
        return ()
    num_points, num_pixels = (np.count_nonzero(joint.any(axis=axis)) for axis in (1, 0))
    # Miller's correction: chance tells so much of few points.
    by_chance = (num_points - 1) * (num_pixels - 1) / (2.0 * count)
    told = (of_points + of_pixels - _entropy(joint.ravel()) - by_chance) / of_points
    found = (
        f"labels of points seem to be made from those of the pictures, pixels tell {told:.0%} of the classes of points "
        f"that are hidden behind what they show, needed at most {LEAKED_LABELS.limit():.0%}"
    )
    return (LEAKED_LABELS.measured(float(told), found),)


def _joint_of_hidden(observations: Observations, T_camera_lidar: Pose) -> npt.NDArray[np.float64]:
    """Count the classes of hidden points and of the pixels that they land on (256, 256)."""
    camera, counts = core_camera(observations.camera), np.zeros((NO_CLASS + 1, NO_CLASS + 1))
    height, width = observations.images[0].classes.shape
    for cloud, image in zip(observations.clouds, observations.images, strict=True):
        projected = _core.project_points(camera, cloud.points, T_camera_lidar)
        hidden = np.isfinite(projected.ranges) & projected.is_hidden
        column, row = np.rint(projected.pixels[hidden]).astype(np.int64).T
        pixels = image.classes[row.clip(0, height - 1), column.clip(0, width - 1)]
        np.add.at(counts, (cloud.classes[hidden], pixels), 1.0)
    return counts[:NO_CLASS, :NO_CLASS]


def _entropy(counts: npt.NDArray[np.float64]) -> float:
    """Compute the entropy of classes, nats, from how often they come up."""
    shares = counts[counts > 0.0] / max(counts.sum(), 1.0)
    return float(-(shares * np.log(shares)).sum())
