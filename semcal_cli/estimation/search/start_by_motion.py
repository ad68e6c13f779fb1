"""A start for edges, which cannot find the mounting: the rotation from the motion of camera and LiDAR."""

from __future__ import annotations

from dataclasses import replace

from semcal_cli.config import InitializationConfig
from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError
from semcal_cli.estimation.search.hand_eye import NotDetermined, hand_eye
from semcal_cli.estimation.search.mounting_search import Initialization, unsearched
from semcal_cli.observations.observations import Observations

NO_START = (
    "edges cannot find the mounting, needed a start within 5 degrees and 0.3 m (--init or --init-rpy-xyz, without "
    "--search-deg; `semcal view` makes one by hand), or {}"
)
"""Error of a search by edges alone if motion gives no start; what segments lack follows."""
WITH_LABELS, WITHOUT_LABELS = "segments (--cue segments,edges)", "image labels (--image-model cityscapes)"


def start_by_motion(observations: Observations, drive: Drive, config: InitializationConfig) -> Initialization:
    """Start at the rotation and position that the motion of camera and LiDAR determines.

    Args:
        observations: Points and pixels of the frames that are used.
        drive: The drive with all frames, for the motion between them.
        config: Settings of the search, which is skipped.

    Raises:
        InputError: motion does not determine the rotation, or an image or the file of the poses is wrong.
    """
    found = hand_eye(drive)
    if isinstance(found, NotDetermined):
        none = "the motion of camera and LiDAR gives no start"
        are_labelled = all(frame.image_labels is not None for frame in drive.frames)
        start = NO_START.format(WITH_LABELS if are_labelled else WITHOUT_LABELS)
        raise InputError(f"{drive.path}: {start}; {none}: {found.why}")
    given = unsearched(observations, found.T_camera_lidar, config)
    settings = {**given.settings, "hand_eye": found.record}
    return replace(given, note=found.sentence, settings=settings, by_motion=found)
