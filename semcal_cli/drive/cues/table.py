"""All cues, and which of them a drive is calibrated by."""

from __future__ import annotations

from collections.abc import Sequence

from semcal_cli.config import AUTO, LABELS, CueName
from semcal_cli.drive.cues import edges, features, intensity, labels, segments
from semcal_cli.drive.cues.cue import Cue
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frame_selection import evenly_spaced, select_frames
from semcal_cli.drive.reading import read_clouds
from semcal_cli.files.point_clouds import Sweeps

CUES: dict[CueName, Cue] = {
    "labels": labels.CUE,
    "segments": segments.CUE,
    "edges": edges.CUE,
    "intensity": intensity.CUE,
    "features": features.CUE,
}
"""Every cue, by its name; `auto` names those that `chosen` gives."""


def maximised(cues: Sequence[CueName]) -> tuple[CueName, ...]:
    """Name the cues by which a pose is refined: where edges make it exact, segments only bring it near."""
    return tuple(cue for cue in cues if cue != "segments" or "edges" not in cues)


def recorded(settings: object) -> tuple[CueName, ...]:
    """Name the cues that the settings of a calibration record under `cues`: labels, where they record none."""
    found = tuple(cue for cue in CUES if isinstance(settings, dict) and cue in settings)
    return found or LABELS


def chosen(cues: Sequence[CueName], drive: Drive, sweeps: Sweeps) -> tuple[CueName, ...]:
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
    found: dict[CueName, bool] = {"segments": has_image_labels, "edges": has_images}
    return tuple(cue for cue, is_there in found.items() if is_there) or LABELS


def _has_point_labels(drive: Drive, sweeps: Sweeps) -> bool:
    """Whether all points have labels, in files of their own or in a field of the clouds, as in the first one."""
    if any(frame.point_labels is not None for frame in drive.frames):
        return True  # If another frame has none, the error says which.
    first = drive.model_copy(update={"frames": drive.frames[:1]})
    (cloud,) = read_clouds(first, sweeps)
    return cloud.labels is not None or cloud.label_shares is not None


def choose_frames(drive: Drive, cues: Sequence[CueName], max_frames: int) -> Drive:
    """Keep at most `max_frames` frames of a drive: those whose label images differ most, or evenly spaced ones.

    Raises:
        InputError: a label image is missing or wrong.
    """
    if any("image_labels" in CUES[cue].files for cue in cues):
        return select_frames(drive, max_frames)
    return drive.model_copy(update={"frames": tuple(evenly_spaced(drive.frames, max_frames))})


def files_of(cues: Sequence[CueName]) -> list[str]:
    """List the keys of a frame's files that are read for cues. Labels of points are read with their cloud."""
    return [*dict.fromkeys(["points", "point_labels", *(name for cue in cues for name in CUES[cue].files)])]
