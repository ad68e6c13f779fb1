"""All cues, and the choice of those by which a drive is calibrated."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial, reduce
from importlib import import_module
from typing import TypeVar, get_args

import numpy as np

from semcal_cli.config import AUTO, LABELS, CueName
from semcal_cli.config.cues import PLUGINS, BuiltInCue, cue_names
from semcal_cli.drive.document import Drive
from semcal_cli.errors import CalibrationError, InputError, one_of
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.observations.cues.cue import Cue, checked
from semcal_cli.observations.cues.policy import Policy
from semcal_cli.observations.frame_selection import select_frames, with_few_frames
from semcal_cli.observations.observations import NO_CLASS, LabelledCloud, LabelledImage, Observations
from semcal_cli.observations.reading import read_clouds

Labelled = TypeVar("Labelled", LabelledCloud, LabelledImage)


CUES: dict[CueName, Cue] = {
    name: import_module(f"{__package__}.{name}").CUE for name in get_args(BuiltInCue) if name not in AUTO
}
"""semcal's own cues: `CUE` of the module of each name; `auto` stands for those that `choose_cues` returns."""


def find_cue(name: CueName) -> Cue:
    """Find a cue of semcal or of a plugin by name.

    Raises:
        InputError: there is no such cue.
        PluginError: the cue is a plugin's, and one of its fields is wrong.
    """
    if name in CUES:
        return CUES[name]
    if (cue := PLUGINS.get(name, Cue)) is None:
        raise InputError(f"cues: found {name!r}, expected {one_of(name, cue_names())}")
    with PLUGINS.name_in_errors(name):
        return checked(cue, partial(PLUGINS.guard, name))


def policy_of(cues: Iterable[CueName]) -> Policy:
    """Combine what cues state."""
    return Policy({name: find_cue(name) for name in cues})


def is_default(cues: Sequence[CueName]) -> bool:
    """Whether the cues are labels alone, the default, which results and messages do not mention."""
    return tuple(cues) == LABELS


def recorded_options(cues: Sequence[CueName]) -> dict[str, object]:
    """Record cues and their settings among the options of a calibration; nothing for labels alone."""
    return {} if is_default(cues) else {"cues": {name: find_cue(name).settings for name in cues}}


def cues_of_options(options: Mapping[str, object]) -> tuple[CueName, ...]:
    """Name the cues that the options of a calibration record: labels if there are none.

    Cues of plugins that are not installed here are left out.
    """
    settings = options.get("cues")
    if not isinstance(settings, dict) or not settings:
        return LABELS
    others = PLUGINS.names if settings.keys() - CUES.keys() else ()
    return tuple(cue for cue in (*CUES, *others) if cue in settings)


def cues_with_files(cues: tuple[CueName, ...], drive: Drive) -> tuple[CueName, ...]:
    """Keep the cues whose files a drive has; `auto` if none is left, and for labels, which `auto` prefers anyway."""

    def has_files(cue: CueName) -> bool:
        return all(any(getattr(frame, key) for frame in drive.frames) for key in find_cue(cue).files)

    return AUTO if is_default(cues) else tuple(filter(has_files, cues)) or AUTO


def choose_cues(cues: Sequence[CueName], drive: Drive, sweeps: SweepCache) -> tuple[CueName, ...]:
    """Replace `auto` by the best of semcal's own cues that the files of a drive allow.

    On real drives, the error is a tenth of a degree with edges, and a degree with segments, which need no start. If the
    files allow neither, labels are chosen, whose error says what is missing.

    Raises:
        InputError: the first sweep is missing or wrong.
    """
    if tuple(cues) != AUTO:
        return tuple(cues)
    # If a frame lacks a file that others have, the cue is chosen nevertheless: its error names the file.
    has_image_labels = any(frame.image_labels is not None for frame in drive.frames)
    has_image = [frame.image is not None for frame in drive.frames]
    has_images = all(has_image) if has_image_labels else any(has_image)
    if has_image_labels:
        has_point_labels = any(frame.point_labels is not None for frame in drive.frames)
        if not has_point_labels:  # Clouds may have a field of labels.
            first = drive.model_copy(update={"frames": drive.frames[:1]})
            (cloud,) = read_clouds(first, sweeps)
            has_point_labels = cloud.labels is not None or cloud.label_shares is not None
        if has_point_labels:
            return LABELS
    has_files: dict[CueName, bool] = {"segments": has_image_labels, "edges": has_images}
    return tuple(cue for cue, is_there in has_files.items() if is_there) or LABELS


def choose_frames(drive: Drive, cues: Sequence[CueName], max_frames: int) -> Drive:
    """Keep at most `max_frames` frames of a drive: those whose label images differ most, or evenly spaced ones.

    Raises:
        InputError: a label image is missing or wrong.
    """
    if any("image_labels" in find_cue(cue).files for cue in cues):
        return select_frames(drive, max_frames)
    return with_few_frames(drive, max_frames)


def files_of(cues: Sequence[CueName]) -> list[str]:
    """List the keys of a frame's files that are read for cues, and those that are read for every cue."""
    return [
        *dict.fromkeys(
            ["points", "point_labels", "mask", *(name for cue in cues for name in find_cue(cue).files)]
        )
    ]


def load_cues(
    drive: Drive, cues: Sequence[CueName], sweeps: SweepCache | None = None, *, is_raw: bool = False
) -> Observations:
    """Load every frame of a drive with the classes of one or more cues; each sweep is read once.

    Raw labels keep their speckle, and raw intensities are vectors of one number.

    Raises:
        InputError: a file is missing or wrong, or a cue needs a file that the drive does not name.
        CalibrationError: the points or the pixels carry no information.
    """
    sweeps = SweepCache() if sweeps is None else sweeps
    policy = policy_of(cues)
    observed = [
        cue.observe(drive, sweeps, is_raw).weighed(policy.weight(name)) for name, cue in policy.cues.items()
    ]
    return replace(reduce(summed, observed), starts=policy.starts)


def summed(first: Observations, second: Observations) -> Observations:
    """Add another cue of the same frames, so that their mutual information adds up.

    Each frame is observed again, in the classes of the other cue, and the cues share no class. The joint histogram thus
    has a block for each cue, and its mutual information is the mean of theirs plus a constant (chain rule: the block of
    a pair determines its possible classes on both sides).

    Raises:
        CalibrationError: the cues have too many classes for one histogram.
    """
    num_point, num_image = len(first.point_class_names), len(first.image_class_names)
    if max(num_point + len(second.point_class_names), num_image + len(second.image_class_names)) > NO_CLASS:
        raise CalibrationError(f"found more than {NO_CLASS} classes in all cues together, needed fewer")
    shifted = [
        replace(
            observed, cloud=_shifted(observed.cloud, num_point), image=_shifted(observed.image, num_image)
        )
        for observed in second.frame_observations
    ]
    return replace(
        first,
        frame_observations=(*first.frame_observations, *shifted),
        num_cues=first.num_cues + second.num_cues,
        point_class_names=[*first.point_class_names, *second.point_class_names],
        image_class_names=[*first.image_class_names, *second.image_class_names],
    )


def _shifted(labelled: Labelled, count: int) -> Labelled:
    """Move the classes of a frame's points or pixels behind `count` classes of another cue."""
    table = np.full(256, NO_CLASS, np.uint8)
    table[: NO_CLASS - count] = np.arange(count, NO_CLASS)
    shares = labelled.shares and labelled.shares.renamed(table)
    shifted = replace(labelled, classes=table[labelled.classes], shares=shares)
    if isinstance(shifted, LabelledCloud) and shifted.plain_class is not None:
        return replace(shifted, plain_class=int(table[shifted.plain_class]))
    if isinstance(labelled, LabelledImage) and (lines := labelled.scan_lines) is not None:
        regraded = replace(lines, regraded=lambda along: _shifted(lines.regraded(along), count))
        return replace(shifted, scan_lines=regraded)
    return shifted
