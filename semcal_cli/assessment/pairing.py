"""Frames whose points and pixels do not belong together: another moment, a mirrored picture, another camera."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.assessment.frame_names import frame_list, frame_name
from semcal_cli.assessment.segment_information import segment_information
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.poses import Pose
from semcal_cli.result.stage import Finding

MIN_INFORMATION = 0.35
"""Least information of a frame, as a share of that of the best quarter of frames, that needs no second look. On good
drives it was at least 0.6; with a picture of another moment or a mirrored one at most 0.35 in 29 of 36 frames."""
MAX_EXCHANGED = 0.5
"""Largest allowed information with the picture of another frame, as a share of that with the frame's own."""
MIN_PAIRS = 500.0
"""Least number of pairs of points and pixels of a frame that tell anything."""
MAX_EXCHANGED_SIGMAS = 2.0
"""The same for other cues than labels, as a distance above that with the frame's own picture, in its standard errors:
some frames have few segments or edges, and streets are alike."""
NUM_EXCHANGES = 3
"""Number of other frames whose pictures are tried."""

Information = npt.NDArray[np.float64]


def check_pairs(
    observations: Observations, T_camera_lidar: Pose, agreement: _core.Agreement, names: Sequence[str]
) -> tuple[Finding, ...]:
    """Check for each frame that its points agree with its own pixels.

    Labels are judged by the classes that go together in all frames. What tells less, segments, edges and intensity, is
    judged square by square of the pictures, whose scatter says how much of it is chance.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4) pose of all frames, metres.
        agreement: Agreement of all frames at this pose.
        names: Name of each frame: its point cloud.
    """
    if observations.starts is not None:
        found = segment_information(observations, T_camera_lidar)
        own, num_pairs = found.by_frame, found.weight_by_frame
        most_exchanged = own + MAX_EXCHANGED_SIGMAS * found.sigma_by_frame

        def measure(others: Observations) -> Information:
            return segment_information(others, T_camera_lidar).by_frame
    else:
        joints = agreement.frame_joints[: observations.num_frames]
        table = pointwise_information(joints.sum(axis=0))
        own, num_pairs = information_by_frame(joints, table), joints.sum(axis=(1, 2))
        most_exchanged = MAX_EXCHANGED * own

        def measure(others: Observations) -> Information:
            joints = _core.agreement(others.core, T_camera_lidar).frame_joints
            return information_by_frame(joints, table)

    is_seen = num_pairs >= MIN_PAIRS
    usual = float(np.quantile(own[is_seen], 0.75)) if is_seen.any() else 0.0
    doubtful = np.flatnonzero(is_seen & (own < MIN_INFORMATION * usual))
    if len(doubtful) == 0 or observations.num_frames < 2:
        return ()
    exchanged = _exchanged(observations, measure)
    is_wrong = (own <= 0.0) | (exchanged > most_exchanged)
    wrong = doubtful[is_wrong[doubtful]].tolist()
    if not wrong:
        return ()
    worst = min(wrong, key=lambda frame: float(own[frame]))
    as_well = f"{own[worst] / usual:.0%} as well as others" if usual > 0.0 else "worse than others"
    sentence = (
        f"points and pixels of {frame_list(names, wrong)} may not belong together, {frame_name(names, worst)} agrees "
        f"{as_well}, needed at least {MIN_INFORMATION:.0%} or more than with pictures of other frames"
    )
    return (
        Finding(
            "odd-frames", sentence, "check the times and the names of their files, or take these frames out"
        ),
    )


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
