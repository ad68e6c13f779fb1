"""A start for edges, which tell no mountings apart: the rotation that the motion of camera and LiDAR tells."""

from __future__ import annotations

from dataclasses import replace

from semcal_cli.config import InitializationConfig
from semcal_cli.drive.document import Drive
from semcal_cli.drive.observations import Observations
from semcal_cli.errors import InputError
from semcal_cli.initialization.handeye import NotDetermined, hand_eye
from semcal_cli.initialization.search import Initialization, as_given

NO_START = (
    "edges tell no mountings apart, needed a start within 5 degrees and 0.3 m (--init or --init-rpy-xyz, without "
    "--search-deg; `semcal view` makes one by hand), or image labels (--image-model cityscapes)"
)
"""What is missing where a search is asked for by edges without image labels, and motion gives no start."""


def start_by_motion(observations: Observations, drive: Drive, config: InitializationConfig) -> Initialization:
    """Start at the rotation that the motion of camera and LiDAR tells, and at what it tells of the camera's place.

    Args:
        observations: Points and pixels of the frames that are used.
        drive: The drive with all frames, by which motion is seen between them.
        config: Settings of the search, which is left out.

    Raises:
        InputError: motion does not determine the rotation, or an image or the file of the poses is wrong.
    """
    found = hand_eye(drive)
    if isinstance(found, NotDetermined):
        none = "the motion of camera and LiDAR gives none"
        raise InputError(f"{drive.path}: {NO_START}; {none}: {found.why}")
    given = as_given(observations, found.T_camera_lidar, config)
    settings = {**given.settings, "hand_eye": found.record}
    return replace(given, note=found.sentence, settings=settings, by_motion=found)
