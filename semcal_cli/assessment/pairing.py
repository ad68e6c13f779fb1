"""Frames whose points and pixels do not belong together: another moment, a mirrored picture, another camera."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.assessment.frame_names import frame_list, frame_name
from semcal_cli.assessment.information import information_by_squares
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.poses import Pose
from semcal_cli.result.checks.check import Measured
from semcal_cli.result.checks.table import ODD_FRAMES

MIN_PAIRS = 500.0
"""Least number of pairs of points and pixels of a frame that tell anything."""
NUM_EXCHANGES = 3
"""Number of other frames whose pictures are tried."""

Information = npt.NDArray[np.float64]


def check_pairs(
    observations: Observations, T_camera_lidar: Pose, agreement: _core.Agreement, names: Sequence[str]
) -> tuple[Measured, ...]:
    """Check for each frame that its points agree with its own pixels.

    Labels are judged by the classes that go together in all frames. What tells less, segments, edges and intensity, is
    judged square by square of the pictures, whose scatter says how much of it is chance.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4) pose of all frames, metres.
        agreement: Agreement of all frames at this pose.
        names: Name of each frame: its point cloud.
    """
    own, num_pairs, most_exchanged, measure = _of_frames(observations, T_camera_lidar, agreement)
    is_seen = num_pairs >= MIN_PAIRS
    if not is_seen.any() or observations.num_frames < 2:
        return ()
    usual, least = float(np.quantile(own[is_seen], 0.75)), ODD_FRAMES.limit("information")
    doubtful = np.flatnonzero(is_seen & (own < least * usual))
    wrong = []
    if len(doubtful) > 0:
        is_wrong = (own <= 0.0) | (_exchanged(observations, measure) > most_exchanged)
        wrong = doubtful[is_wrong[doubtful]].tolist()
    if not wrong:
        share = float(own[is_seen].min()) / usual if usual > 0.0 else math.nan
        return (ODD_FRAMES.measured(share, limit="information"),)
    worst = min(wrong, key=lambda frame: float(own[frame]))
    share = float(own[worst]) / usual if usual > 0.0 else -math.inf
    as_well = f"{share:.0%} as well as others" if usual > 0.0 else "worse than others"
    sentence = (
        f"points and pixels of {frame_list(names, wrong)} may not belong together, {frame_name(names, worst)} agrees "
        f"{as_well}, needed at least {least:.0%} or more than with pictures of other frames"
    )
    return (ODD_FRAMES.measured(share, sentence, "information"),)


class _OfFrames(NamedTuple):
    """What the points of each frame tell of pixels."""

    own: Information
    """(F,) information with the frame's own pixels."""
    num_pairs: npt.NDArray[np.float64]
    """(F,) number of pairs of points and pixels."""
    most_exchanged: Information
    """(F,) largest allowed information with the pixels of another frame."""
    measure: Callable[[Observations], Information]
    """Computes the information (F,) with the pixels of other observations."""


def _of_frames(observations: Observations, T_camera_lidar: Pose, agreement: _core.Agreement) -> _OfFrames:
    """Measure frames by the classes that go together in all of them, or square by square."""
    if observations.starts is not None:
        found = information_by_squares(observations, T_camera_lidar)
        most = found.by_frame + ODD_FRAMES.limit("another picture, by squares") * found.sigma_by_frame

        def by_squares(others: Observations) -> Information:
            return information_by_squares(others, T_camera_lidar).by_frame

        return _OfFrames(found.by_frame, found.weight_by_frame, most, by_squares)
    joints = agreement.frame_joints[: observations.num_frames]
    table = pointwise_information(joints.sum(axis=0))
    own = information_by_frame(joints, table)

    def by_classes(others: Observations) -> Information:
        return information_by_frame(_core.agreement(others.core, T_camera_lidar).frame_joints, table)

    return _OfFrames(own, joints.sum(axis=(1, 2)), ODD_FRAMES.limit("another picture") * own, by_classes)


def information_by_frame(joints: npt.NDArray[np.float64], table: npt.NDArray[np.float64]) -> Information:
    """Mean pointwise information (F,) of the pairs of each frame, by a table for all of them, nats.

    Args:
        joints: (F, X, Y) weights of the pairs of each frame.
        table: (X, Y) pointwise mutual information.
    """
    weights = np.maximum(joints.sum(axis=(1, 2)), 1.0)
    return np.asarray((joints * table).sum(axis=(1, 2)) / weights)


def pointwise_information(joint: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Compute the pointwise mutual information of a histogram (X, Y), nats; zero for pairs that were never seen."""
    expected = joint.sum(axis=1, keepdims=True) * joint.sum(axis=0) / max(joint.sum(), 1.0)
    seen = joint > 0.0
    ratio = np.divide(joint, expected, out=np.ones_like(joint), where=seen)
    return np.asarray(np.log(ratio))


def _exchanged(observations: Observations, measure: Callable[[Observations], Information]) -> Information:
    """Largest information of each frame's points with the pixels of some other frames, (F,)."""
    images, count = observations.images, observations.num_frames
    shifts = np.unique(np.linspace(1, count - 1, NUM_EXCHANGES).round().astype(int))
    scenes, found = observations.scenes, []
    for shift in shifts.tolist():
        others = observations.with_images(images[shift:] + images[:shift])
        same = [scenes[frame] == scenes[(frame + shift) % count] for frame in range(count)]
        found.append(np.where(same, -np.inf, measure(others)))
    return np.asarray(np.max(found, axis=0))
