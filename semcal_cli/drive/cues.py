"""Cues that points and pixels are compared by: labels, segments, edges, intensity, several of them, or features."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import reduce
from typing import TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from semcal_cli.config import AUTO, EDGE_STARTS, LABELS, SEGMENT_STARTS, Cue, StartsConfig
from semcal_cli.drive.classes import NO_CLASS
from semcal_cli.drive.cue_config import EdgesConfig, FeaturesConfig, IntensityConfig, SegmentsConfig
from semcal_cli.drive.document import Drive
from semcal_cli.drive.edges import observe_edges
from semcal_cli.drive.features import observe_features
from semcal_cli.drive.frame_selection import evenly_spaced, select_frames
from semcal_cli.drive.intensity import observe_intensity, observe_raw_intensity
from semcal_cli.drive.observations import FrameObservation, Observations
from semcal_cli.drive.reading import load_observations, read_clouds, read_observations
from semcal_cli.drive.segments import observe_segments
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.files.point_clouds import Sweeps

Classes: TypeAlias = npt.NDArray[np.uint8]
CUES: tuple[Cue, ...] = get_args(Cue)

SEGMENTS, EDGES = SegmentsConfig(), EdgesConfig()
INTENSITY, FEATURES = IntensityConfig(), FeaturesConfig()


def maximised(cues: Sequence[Cue]) -> tuple[Cue, ...]:
    """Name the cues by which a pose is refined: where edges make it exact, segments only bring it near."""
    return tuple(cue for cue in cues if cue != "segments" or "edges" not in cues)


def recorded(settings: object) -> tuple[Cue, ...]:
    """Name the cues that the settings of a calibration record under `cues`: labels, where they record none."""
    found = tuple(cue for cue in CUES if isinstance(settings, dict) and cue in settings)
    return found or LABELS


def chosen(cues: Sequence[Cue], drive: Drive, sweeps: Sweeps) -> tuple[Cue, ...]:
    """Replace `auto` by the best cues that the files of a drive allow.

    Real drives end a tenth of a degree off by edges and a degree off by segments, which need no start, however. A drive
    whose files allow none is left to labels, whose error says what is missing.

    Raises:
        InputError: the first sweep is missing or wrong.
    """
    if tuple(cues) != AUTO:
        return tuple(cues)
    # Where a frame lacks a file that others have, the cue is taken all the same: its error says which.
    has_image_labels = any(frame.image_labels is not None for frame in drive.frames)
    has_image = [frame.image is not None for frame in drive.frames]
    has_images = all(has_image) if has_image_labels else any(has_image)
    if has_image_labels and _has_point_labels(drive, sweeps):
        return LABELS
    found: dict[Cue, bool] = {"segments": has_image_labels, "edges": has_images}
    return tuple(cue for cue, is_there in found.items() if is_there) or LABELS


def _has_point_labels(drive: Drive, sweeps: Sweeps) -> bool:
    """Whether all points have labels, in files of their own or in a field of the clouds, as in the first one."""
    if any(frame.point_labels is not None for frame in drive.frames):
        return True  # If another frame has none, the error says which.
    first = drive.model_copy(update={"frames": drive.frames[:1]})
    (cloud,) = read_clouds(first, sweeps)
    return cloud.labels is not None or cloud.label_shares is not None


def load_cues(
    drive: Drive, cues: Sequence[Cue], sweeps: Sweeps | None = None, *, is_raw: bool = False
) -> Observations:
    """Load every frame of a drive with the classes of one or several cues; each sweep is read once.

    Raw labels are not mended, and raw intensities are vectors of one number.

    Raises:
        InputError: a file is missing or wrong, or a cue needs a file that the drive does not name.
        CalibrationError: the points or the pixels carry no information.
    """
    sweeps = Sweeps() if sweeps is None else sweeps
    found = [_load(drive, cue, sweeps, is_raw) for cue in cues]
    if "intensity" in cues:
        found = [
            _weighed(each, SEGMENTS.weight_by_intensity) if each.has_segments else each for each in found
        ]
    observations = reduce(summed, found)
    return replace(observations, starts=_starts(cues))


def _starts(cues: Sequence[Cue]) -> StartsConfig | None:
    """Labels bring a pose near on their own; what other cues tell has many tops."""
    if "labels" in cues or "features" in cues:
        return None
    return EDGE_STARTS if "edges" in cues else SEGMENT_STARTS


def choose_frames(drive: Drive, cues: Sequence[Cue], max_frames: int) -> Drive:
    """Keep at most `max_frames` frames of a drive: those whose label images differ most, or evenly spaced ones.

    Raises:
        InputError: a label image is missing or wrong.
    """
    if "labels" in cues or "segments" in cues:
        return select_frames(drive, max_frames)
    return drive.model_copy(update={"frames": tuple(evenly_spaced(drive.frames, max_frames))})


def files_of(cues: Sequence[Cue]) -> list[str]:
    """List the keys of a frame's files that are read for cues. Labels of points are read with their cloud."""
    of_cue = {
        "labels": ["image_labels"],
        "segments": ["image_labels"],
        "edges": ["image"],
        "intensity": ["image"],
        "features": ["point_features", "image_features"],
    }
    return [*dict.fromkeys(["points", "point_labels", *(name for cue in cues for name in of_cue[cue])])]


def describe_cues(cues: Sequence[Cue]) -> dict[str, object]:
    """Give the settings of each cue, by name."""
    settings = {
        "segments": asdict(SEGMENTS),
        "edges": asdict(EDGES),
        "intensity": asdict(INTENSITY),
        "features": asdict(FEATURES),
    }
    return {cue: settings.get(cue, {}) for cue in cues}


def _load(drive: Drive, cue: Cue, sweeps: Sweeps, is_raw: bool) -> Observations:
    match cue:
        case "labels":
            return read_observations(drive, sweeps) if is_raw else load_observations(drive, sweeps)
        case "segments":
            return observe_segments(drive, SEGMENTS, sweeps, is_raw=is_raw)
        case "edges":
            return observe_edges(drive, EDGES, sweeps)
        case "intensity":
            return (observe_raw_intensity if is_raw else observe_intensity)(drive, INTENSITY, sweeps)
        case "features":
            return observe_features(drive, FEATURES, sweeps)
        case "auto":
            raise InputError("cues: found auto, needed those that were chosen for the drive")


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
