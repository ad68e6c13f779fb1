"""Whether the points of each frame agree with its own pixels.

They do not where an image is from another moment or another camera, or is mirrored.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from semcal_cli import core
from semcal_cli.errors import format_against_limit
from semcal_cli.estimation.uncertainty.information import (
    information_by_frame,
    information_by_squares,
    pointwise_information,
)
from semcal_cli.findings.check import Check, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.geometry.arrays import Numbers, Pose
from semcal_cli.observations.frame_naming import frame_list, frame_name
from semcal_cli.observations.observations import Observations

ODD_FRAMES = Check(
    topic="odd-frames",
    advice="check the times and names of the files, or leave these frames out (--exclude FRAME)",
    entry=Entry(
        title="Single frames do not fit",
        section=PageSection.FILES,
        quotes=(
            (
                "points and pixels of 000003 look mismatched; 000003 agrees 9% as well as a typical frame "
                "(limit 35%): check the times and names of the files, or leave these frames out (--exclude "
                "FRAME)"
            ),
        ),
        meaning="Most frames fit, but these do not.",
        cause="An image is from another moment or mirrored, or labels belong to another file.",
        remedy="Look at the overlays of these frames; correct them, or leave them out by `--exclude FRAME`.",
        figure=(
            "Information of the worst frame, relative to that of the best quarter of frames, and with "
            "images of other frames. The check needs two frames."
        ),
    ),
)
MIN_PAIRS = 500.0
"""Smallest number of pairs of points and pixels with which a frame is checked."""
NUM_EXCHANGES = 3
"""Number of other frames whose images are tried."""


def check_pairs(
    observations: Observations, T_camera_lidar: Pose, agreement: core.Agreement, names: Sequence[str]
) -> tuple[Measured, ...]:
    """Check for each frame that its points agree with its own pixels.

    Labels are judged by the classes that go together in all frames. Segments, edges and intensity carry less
    information and are judged by squares of the images, whose scatter shows how much is chance.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4) pose of all frames, metres.
        agreement: Agreement of all frames at this pose.
        names: Name of each frame: its point cloud.
    """
    if observations.is_multimodal:
        information = information_by_squares(observations, T_camera_lidar)
        own, num_pairs = information.by_frame, information.weight_by_frame
        max_exchanged = own + ODD_FRAMES.limit("another image, by squares") * information.sigma_by_frame
    else:
        joints = agreement.frame_joints[: observations.num_frames]
        table = pointwise_information(joints.sum(axis=0))
        own, num_pairs = information_by_frame(joints, table), joints.sum(axis=(1, 2))
        max_exchanged = ODD_FRAMES.limit("another image") * own

    def measure(others: Observations) -> Numbers:
        """Compute the information (F,) with the pixels of other observations."""
        if others.is_multimodal:
            return information_by_squares(others, T_camera_lidar).by_frame
        return information_by_frame(core.agreement(others.core, T_camera_lidar).frame_joints, table)

    is_seen = num_pairs >= MIN_PAIRS
    if not is_seen.any() or observations.num_frames < 2:
        return ()
    usual, least = float(np.quantile(own[is_seen], 0.75)), ODD_FRAMES.limit("information")
    doubtful = np.flatnonzero(is_seen & (own < least * usual))
    wrong = []
    if len(doubtful) > 0:
        is_wrong = (own <= 0.0) | (_exchanged(observations, measure) > max_exchanged)
        wrong = doubtful[is_wrong[doubtful]].tolist()
    if not wrong:
        share = float(own[is_seen].min()) / usual if usual > 0.0 else math.nan
        return (ODD_FRAMES.measured(share, limit="information"),)
    worst = min(wrong, key=lambda frame: float(own[frame]))
    share = float(own[worst]) / usual if usual > 0.0 else -math.inf
    part, limit = format_against_limit(share, least, unit="%")
    agrees = f"{part} as well as a typical frame (limit {limit})"
    if share < 0.0:
        agrees = f"no better than chance (limit {limit} of a typical frame)"
    sentence = (
        f"points and pixels of {frame_list(names, wrong)} look mismatched; "
        f"{frame_name(names, worst)} agrees {agrees}"
    )
    return (ODD_FRAMES.measured(share, sentence, "information"),)


def _exchanged(observations: Observations, measure: Callable[[Observations], Numbers]) -> Numbers:
    """Compute the largest information of each frame's points with the pixels of some other frames, (F,)."""
    images, count = observations.images, observations.num_frames
    shifts = np.unique(np.linspace(1, count - 1, NUM_EXCHANGES).round().astype(int))
    scenes, exchanged = observations.scenes, []
    for shift in shifts.tolist():
        others = observations.with_images(images[shift:] + images[:shift])
        same = [scenes[frame] == scenes[(frame + shift) % count] for frame in range(count)]
        exchanged.append(np.where(same, -np.inf, measure(others)))
    return np.asarray(np.max(exchanged, axis=0))
