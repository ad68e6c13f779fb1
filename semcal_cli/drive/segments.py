"""The segments cue: parts of sweeps, found by their geometry alone, against the labels of the pictures.

Networks that label pictures travel well between cameras; those that label sweeps are trained for one LiDAR. Mutual
information asks for no names: each cell of the ground and each object of each sweep is a class of its own. What it
tells is counted above null partitions, see `rust/partitions.rs`. The initial calibration needs classes that frames
share, and takes the two kinds of segments: ground and objects.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.drive.classes import NO_CLASS
from semcal_cli.drive.cue_config import SegmentsConfig
from semcal_cli.drive.document import Drive
from semcal_cli.drive.motion import compensated
from semcal_cli.drive.observations import LabelledCloud, Observations
from semcal_cli.drive.reading import make_observations, mend, read_clouds, read_image_classes
from semcal_cli.errors import CalibrationError
from semcal_cli.files.point_clouds import Sweeps

KINDS = {_core.GROUND: "ground", _core.OBJECT: "objects"}
"""Names of the kinds of segments."""


def observe_segments(
    drive: Drive, config: SegmentsConfig, sweeps: Sweeps | None = None, *, is_raw: bool = False
) -> Observations:
    """Load every frame of a drive, with segments of its sweep instead of labels of points.

    Args:
        drive: The drive; each frame needs a label image.
        config: Settings of the cue.
        sweeps: Sweeps that have already been read.
        is_raw: Whether isolated pixels of the label images stay as they are.

    Returns:
        Observations whose points have the kind of their segment as class, and the segments as partitions.

    Raises:
        InputError: a file is missing or wrong.
        CalibrationError: the pictures carry a single class, or the sweeps show no segments.
    """
    images, image_class_names = read_image_classes(drive)
    clouds = read_clouds(drive, sweeps)
    moved = compensated(drive, clouds)
    points = [sweep.points for sweep in moved]
    segmented = _core.segment_sweeps(points, config.segmentation)
    if not any(sweep.num_segments for sweep in segmented):
        raise CalibrationError(f"{drive.path}: found no segments in any sweep, needed ground or objects")
    partitions = _core.turned_partitions(points, segmented, config.num_turns)
    labelled = [
        LabelledCloud(each, _kinds(sweep), partitions=partition)
        for each, sweep, partition in zip(points, segmented, partitions, strict=True)
    ]
    names = (list(KINDS.values()), image_class_names)
    found = make_observations(drive, clouds, moved, labelled, images, names)
    return found if is_raw else mend(found)


def kinds_of_segments(points: npt.NDArray[np.float32]) -> tuple[str, ...]:
    """Name the kinds of segments that a sweep (N, 3) in metres shows."""
    (sweep,) = _core.segment_sweeps([points], SegmentsConfig().segmentation)
    return tuple(name for kind, name in KINDS.items() if kind in sweep.kinds)


def _kinds(sweep: _core.SegmentedSweep) -> npt.NDArray[np.uint8]:
    """Kind of the segment of each point (N,), or `NO_CLASS`."""
    kinds = np.append(sweep.kinds, NO_CLASS).astype(np.uint8)
    return np.asarray(kinds[np.minimum(sweep.ids, sweep.num_segments)])
