"""A start for cues that cannot find the mounting, such as edges, from the motion of camera and LiDAR."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from semcal_cli.config import InitializationConfig
from semcal_cli.drive.document import Drive
from semcal_cli.errors import NoStartError
from semcal_cli.estimation.search.hand_eye import NotDetermined, hand_eye
from semcal_cli.estimation.search.mounting_search import Initialization, unsearched
from semcal_cli.observations.observations import Observations


def no_start(drive: Drive, cues: Sequence[str], why_not_motion: str) -> NoStartError:
    """Make the error of a drive whose cues compare points and pixels only near the right pose, without a start.

    Args:
        drive: The drive.
        cues: Names of these cues.
        why_not_motion: Why the motion of camera and LiDAR gives no start.
    """
    return NoStartError(
        f"{drive.path}: a calibration by {' and '.join(cues)} needs a start within 5 degrees and 0.3 m, or "
        f"{what_finds_mountings(drive)}; the motion of camera and LiDAR gives no start: {why_not_motion}"
    )


def what_finds_mountings(drive: Drive) -> str:
    """Name what a drive needs beside cues that cannot find the mounting."""
    are_labelled = all(frame.image_labels is not None for frame in drive.frames)
    return "segments beside them" if are_labelled else "image labels"


def start_by_motion(
    observations: Observations, drive: Drive, config: InitializationConfig, cues: Sequence[str]
) -> Initialization:
    """Start at the rotation and position that the motion of camera and LiDAR determines.

    Args:
        observations: Points and pixels of the frames that are used.
        drive: The drive with all frames, for the motion between them.
        config: Settings of the search, which is skipped.
        cues: Names of the cues that cannot find the mounting.

    Raises:
        NoStartError: motion does not determine the rotation.
        InputError: an image or the file of the poses is wrong.
    """
    by_motion = hand_eye(drive)
    if isinstance(by_motion, NotDetermined):
        raise no_start(drive, cues, by_motion.why)
    initial = unsearched(observations, by_motion.T_camera_lidar, config)
    settings = {**initial.settings, "hand_eye": by_motion.record}
    return replace(initial, note=by_motion.sentence, settings=settings, by_motion=by_motion)
