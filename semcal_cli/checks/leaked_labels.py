"""Whether point labels were made from image labels.

Such labels agree best at the transform that made them, right or wrong, so they carry no information about the camera.
Hidden points reveal them: a point that the camera does not see has the class of what hides it. Pixels then say as much
about hidden points as about visible ones, however many labels are wrong.
"""

from __future__ import annotations

import numpy as np

from semcal_cli import core
from semcal_cli.drive.camera import core_camera
from semcal_cli.errors import format_against_limit
from semcal_cli.estimation.uncertainty.information import entropy
from semcal_cli.findings.check import Check, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.geometry.arrays import Numbers, Pose
from semcal_cli.observations.frame_selection import few_frames
from semcal_cli.observations.observations import NO_CLASS, Observations

LEAKED_LABELS = Check(
    topic="leaked-labels",
    advice="label the points without the images, or calibrate with --cue segments,edges",
    entry=Entry(
        title="Point labels come from the images",
        section=PageSection.FILES,
        quotes=(
            (
                "point labels seem to come from image labels, since pixels say 98% as much about hidden "
                "points as about visible ones (limit 88%): label the points without the images, "
                "or calibrate with --cue segments,edges"
            ),
        ),
        meaning=(
            "Points hidden behind an object have its class. Such labels agree best at the transform "
            "that made them, right or wrong."
        ),
        cause="The clouds were labelled by projecting label images with an older transform.",
        remedy="Label the points with a network for point clouds, or leave out their labels.",
        figure=(
            "Information of pixels about the classes of hidden points, relative to that about visible "
            "points. The check needs labels on both sides, and at least 200 hidden points of several "
            "classes."
        ),
    ),
)
NUM_FRAMES = 5
"""Number of frames whose hidden points are looked at."""
MIN_POINTS = 200
"""Smallest number of hidden points that the check needs."""
MIN_CLASSES = 2.0
"""Smallest effective number of classes of hidden points that the check needs."""
MIN_EXPLAINED = 0.1
"""Smallest share of the classes of visible points that counts as explained: it was 29 to 100 %, also with 30 % wrong
labels and 1 degree off, and at a pose where pixels say nothing the ratio is chance."""


def check_leaks(observations: Observations, T_camera_lidar: Pose) -> tuple[Measured, ...]:
    """Check that hidden points have their own classes, and not those of what hides them.

    Args:
        observations: Labelled points and label images, of labels alone.
        T_camera_lidar: (4, 4) pose, metres.
    """
    hidden, visible = _joints(few_frames(observations, NUM_FRAMES), T_camera_lidar)
    if hidden.sum() < MIN_POINTS or entropy(hidden.sum(axis=1)) < np.log(MIN_CLASSES):
        return ()
    # At a wrong pose, pixels say little about any point, and by chance as much about both kinds.
    share = _share_explained(hidden) / max(_share_explained(visible), MIN_EXPLAINED)
    as_much, most = format_against_limit(share, LEAKED_LABELS.limit(), unit="%")
    sentence = (
        f"point labels seem to come from image labels, since pixels say {as_much} as much about hidden points as about "
        f"visible ones (limit {most})"
    )
    return (LEAKED_LABELS.measured(share, sentence),)


def _joints(observations: Observations, T_camera_lidar: Pose) -> tuple[Numbers, Numbers]:
    """Count the classes of hidden and of visible points, and of the pixels that they land on (C, C) each."""
    camera, counts = core_camera(observations.camera), np.zeros((2, NO_CLASS + 1, NO_CLASS + 1))
    height, width = observations.images[0].classes.shape
    for cloud, image in zip(observations.clouds, observations.images, strict=True):
        projected = core.project_points(camera, cloud.points, T_camera_lidar, observations.origin_m)
        is_seen = np.isfinite(projected.ranges)
        column, row = np.rint(projected.pixels[is_seen]).astype(np.int64).T
        pixels = image.classes[row.clip(0, height - 1), column.clip(0, width - 1)]
        is_visible = (~projected.is_hidden[is_seen]).astype(np.int64)
        np.add.at(counts, (is_visible, cloud.classes[is_seen], pixels), 1.0)
    hidden, visible = counts[:, :NO_CLASS, :NO_CLASS]
    return hidden, visible


def _share_explained(joint: Numbers) -> float:
    """Compute the fraction of the entropy of the points' classes that the pixels explain, from joint counts."""
    points_nats, pixels_nats = entropy(joint.sum(axis=1)), entropy(joint.sum(axis=0))
    num_points, num_pixels = (np.count_nonzero(joint.any(axis=axis)) for axis in (1, 0))
    # Miller's correction: the information that chance adds for few points.
    by_chance = (num_points - 1) * (num_pixels - 1) / (2.0 * max(joint.sum(), 1.0))
    return float((points_nats + pixels_nats - entropy(joint.ravel()) - by_chance) / max(points_nats, 1e-9))
