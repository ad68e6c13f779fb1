"""A start for cues that cannot find the mounting, such as edges, from the motion of camera and LiDAR."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from semcal_cli.config import InitializationConfig
from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError
from semcal_cli.estimation.search.hand_eye import NotDetermined, hand_eye
from semcal_cli.estimation.search.mounting_search import Initialization, unsearched
from semcal_cli.observations.observations import Observations

NEEDED_LABELS = "image labels (--image-model cityscapes)"
"""What brings the pose near where there are no labels of images."""


def needed_start(cues: Sequence[str], drive: Drive) -> str:
    """Describe what cues need that cannot find the mounting of a drive."""
    are_labelled = all(frame.image_labels is not None for frame in drive.frames)
    needed = f"segments (--cue segments,{','.join(cues)})" if are_labelled else NEEDED_LABELS
    return (
        f"{' and '.join(cues)} cannot find the mounting, needed a start within 5 degrees and 0.3 m (--init or "
        f"--init-rpy-xyz, without --search-deg; `semcal view` makes one by hand), or {needed}"
    )


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
        InputError: motion does not determine the rotation, or an image or the file of the poses is wrong.
    """
    by_motion = hand_eye(drive)
    if isinstance(by_motion, NotDetermined):
        none = "the motion of camera and LiDAR gives no start"
        raise InputError(f"{drive.path}: {needed_start(cues, drive)}; {none}: {by_motion.why}")
    initial = unsearched(observations, by_motion.T_camera_lidar, config)
    settings = {**initial.settings, "hand_eye": by_motion.record}
    return replace(initial, note=by_motion.sentence, settings=settings, by_motion=by_motion)
