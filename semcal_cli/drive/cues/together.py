"""The observations of a drive by one cue, or by several together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from semcal_cli.config import CueName, StartsConfig
from semcal_cli.drive.classes import NO_CLASS
from semcal_cli.drive.cues.segments import SEGMENTS
from semcal_cli.drive.cues.table import CUES
from semcal_cli.drive.document import Drive
from semcal_cli.drive.observations import FrameObservation, Observations
from semcal_cli.errors import CalibrationError
from semcal_cli.files.point_clouds import Sweeps

Classes: TypeAlias = npt.NDArray[np.uint8]


def load_cues(
    drive: Drive, cues: Sequence[CueName], sweeps: Sweeps | None = None, *, is_raw: bool = False
) -> Observations:
    """Load every frame of a drive with the classes of one or several cues; each sweep is read once.

    Raw labels are not mended, and raw intensities are vectors of one number.

    Raises:
        InputError: a file is missing or wrong, or a cue needs a file that the drive does not name.
        CalibrationError: the points or the pixels carry no information.
    """
    sweeps = Sweeps() if sweeps is None else sweeps
    found = [CUES[cue].observe(drive, sweeps, is_raw) for cue in cues]
    if "intensity" in cues:
        found = [
            _weighed(each, SEGMENTS.weight_by_intensity) if each.has_segments else each for each in found
        ]
    return replace(reduce(summed, found), starts=_starts(cues))


def _starts(cues: Sequence[CueName]) -> StartsConfig | None:
    """Give the starts of the cue that asks for the farthest; none where a cue brings the pose near on its own."""
    starts = [found for cue in cues if (found := CUES[cue].starts) is not None]
    return max(starts, key=lambda each: each.farthest_deg) if len(starts) == len(cues) else None


def summed(first: Observations, second: Observations) -> Observations:
    """Add another cue of the same frames, so that their mutual information adds up.

    Each frame is observed once more, in the classes of the other cue, and the cues share no class. So the joint
    histogram has a block for each cue, and its mutual information is the mean of theirs plus a constant (chain rule:
    the block of a pair determines its possible classes on both sides).

    Raises:
        CalibrationError: the cues have too many classes for one histogram.
    """
    num_point, num_image = len(first.point_class_names), len(first.image_class_names)
    if max(num_point + len(second.point_class_names), num_image + len(second.image_class_names)) > NO_CLASS:
        raise CalibrationError(f"found more classes than {NO_CLASS} with those of all cues, needed fewer")
    shifted = [_shifted(observed, num_point, num_image) for observed in second.frame_observations]
    return replace(
        first,
        frame_observations=(*first.frame_observations, *shifted),
        num_cues=first.num_cues + second.num_cues,
        point_class_names=[*first.point_class_names, *second.point_class_names],
        image_class_names=[*first.image_class_names, *second.image_class_names],
    )


def _weighed(observations: Observations, weight: float) -> Observations:
    weighed = tuple(replace(each, weight=weight) for each in observations.frame_observations)
    return replace(observations, frame_observations=weighed)


def _shifted(observed: FrameObservation, by_point: int, by_image: int) -> FrameObservation:
    """Move the classes of a frame's points and pixels behind those of another cue."""
    cloud, image = observed.cloud, observed.image
    of_points, of_pixels = _table(by_point), _table(by_image)
    shifted_cloud = replace(
        cloud, classes=of_points[cloud.classes], shares=cloud.shares and cloud.shares.renamed(of_points)
    )
    shifted_image = replace(
        image, classes=of_pixels[image.classes], shares=image.shares and image.shares.renamed(of_pixels)
    )
    return replace(observed, cloud=shifted_cloud, image=shifted_image)


def _table(by: int) -> Classes:
    """Make the table (256,) that moves the classes of the second cue behind those of the first."""
    table = np.full(256, NO_CLASS, np.uint8)
    table[: NO_CLASS - by] = np.arange(by, NO_CLASS)
    return table
