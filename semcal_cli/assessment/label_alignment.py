"""Alignment of labels with what they label, without any pose: points by their order, label images with their pictures.

From entry to entry of a sweep, labels change where the range steps, and borders of a label image lie on edges of its
picture. If the two coincide better at another displacement, labels belong to other points or pixels: a converter lost
an entry, or another tool resized the label images. Where there are no pictures, or points have no order, good drives
give no finding either.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.assessment.displacement import Displaced, find_displaced
from semcal_cli.assessment.frame_names import frame_list
from semcal_cli.assessment.picture_alignment import Move, find_moved_pixels
from semcal_cli.drive.document import Drive
from semcal_cli.drive.observations import Observations
from semcal_cli.drive.reading import read_frame_image
from semcal_cli.errors import InputError
from semcal_cli.result.checks.check import Check, Measured, findings_among
from semcal_cli.result.checks.table import SHIFTED_LABEL_IMAGES, SHIFTED_POINT_LABELS
from semcal_cli.result.stage import Finding

MAX_ENTRIES = 32
"""Largest displacement of the labels of points that is tried, in entries."""
NUM_BLOCKS = 128
"""Number of blocks of consecutive entries of a sweep."""


class LabelAlignment(NamedTuple):
    """What labels say of the points and pixels that they belong to."""

    measured: tuple[Measured, ...]
    """How much better labels fit where they are displaced."""
    notes: tuple[str, ...] = ()
    """Sentences about pictures that could not be looked at."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Labels that belong to others."""
        return findings_among(self.measured)


def check_label_alignment(drive: Drive, observations: Observations) -> LabelAlignment:
    """Check that labels of points and pixels belong to them, and say which labels do not.

    Args:
        drive: The drive, for its pictures and the names of its frames. Pictures that cannot be read are left out.
        observations: Labelled points, in the order of their files, and label images of the same frames.
    """
    names = [frame.points for frame in drive.frames]
    found, unread = list[Measured](), list[str]()
    if not observations.has_segments:
        points, entries = find_moved_points(observations)
        end = "start" if entries < 0 else "end"
        shift = f"{abs(entries)} {'entry' if abs(entries) == 1 else 'entries'} towards the {end} of the file"
        of = _of(names, points.frames)
        sentence = f"labels of points{of} fit the clouds better shifted by {shift}, {_by(points, SHIFTED_POINT_LABELS)}"
        found.append(SHIFTED_POINT_LABELS.measured(points.z, sentence))
    pixels = find_moved_pixels(observations, partial(_read_picture, drive, unread))
    if pixels is not None:
        of = _of(names, pixels.displaced.frames, pixels.num_pictures)
        sentence = (
            f"label images{of} fit their pictures better {_words(pixels.move)}, "
            f"{_by(pixels.displaced, SHIFTED_LABEL_IMAGES)}"
        )
        found.append(SHIFTED_LABEL_IMAGES.measured(pixels.displaced.z, sentence))
    return LabelAlignment(tuple(found), _note(sorted(set(unread))))


def _note(unread: Sequence[str]) -> tuple[str, ...]:
    if not unread:
        return ()
    more = f", and {len(unread) - 1} more" if len(unread) > 1 else ""
    return (f"whether label images fit their pictures was not tested on all: {unread[0]}{more}",)


def find_moved_points(observations: Observations) -> tuple[Displaced, int]:
    """Find the number of entries by which labels of points fit better, towards the end of the file if positive."""
    clouds = [cloud.core for cloud in observations.clouds]
    steps = _core.steps_at_label_changes(clouds, reach=MAX_ENTRIES, num_blocks=NUM_BLOCKS)
    entries = np.arange(-MAX_ENTRIES, MAX_ENTRIES + 1)
    found = find_displaced(np.array(steps, np.float64), entries == 0)
    return found, int(entries[found.candidate])


def _read_picture(drive: Drive, unread: list[str], index: int) -> npt.NDArray[np.uint8] | None:
    """Read the picture of a frame; None if it has none that can be read. Errors are added to `unread`."""
    image = drive.frames[index].image
    if image is None:
        return None
    try:
        return read_frame_image(drive, drive.frames[index])
    except InputError as error:
        unread.append(str(error).replace(str(drive.resolve(image)), image))
        return None


def _of(names: Sequence[str], frames: Sequence[int], num_frames: int | None = None) -> str:
    """Name the frames, unless they are all frames that were looked at."""
    is_all = len(frames) in (0, len(names) if num_frames is None else num_frames)
    return "" if is_all else f" of {frame_list(names, frames)}"


def _by(displaced: Displaced, check: Check) -> str:
    return f"by {displaced.z:.1f} standard errors, needed at most {check.limit():g}"


def _words(move: Move) -> str:
    """Say how label images are to be moved: "shifted by 3 pixels right and 2 down"."""
    sides = [(move.right_px, "right", "left"), (move.down_px, "down", "up")]
    far = [(abs(px), after if px > 0 else before) for px, after, before in sides if px]
    parts = [f"{px}{_pixels(px) if place == 0 else ''} {side}" for place, (px, side) in enumerate(far)]
    shifted = [f"shifted by {' and '.join(parts)}"] if parts else []
    scaled = [f"scaled by {1.0 + move.scale:g} about the middle"] if move.scale else []
    return " and ".join(scaled + shifted)


def _pixels(count: int) -> str:
    return " pixel" if count == 1 else " pixels"
