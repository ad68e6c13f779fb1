"""Whether frames of a drive have the same files."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from contextlib import suppress
from itertools import chain

from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError
from semcal_cli.files.input_files import hash_file
from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.observations.frame_naming import frame_list, frame_name

IDENTICAL_FILES = Check(
    topic="identical-files",
    entry=Entry(
        title="Frames have the same files",
        section=PageSection.INSPECTION,
        quotes=(
            "frames 000002 and 000003 have the same points and images as frame 000001",
            "frame 000001 is listed 2 times, with the same points, point labels and label images",
        ),
        meaning="Files of several frames have the same bytes, so that they add no information.",
        cause="A converter repeated a sweep or an image, or a frame was listed twice.",
        remedy="Remove the copies, or correct the names in `frames:`.",
    ),
)
FILES = {
    "points": "points",
    "point_labels": "point labels",
    "image_labels": "label images",
    "image": "images",
}
"""Keys of a frame's files, with their names in sentences."""


def find_identical_files(drive: Drive) -> list[Finding]:
    """Report the frames whose points, labels or images are identical, in a finding for each group of frames."""
    kinds: dict[tuple[int, ...], list[str]] = defaultdict(list)
    for key, kind in FILES.items():
        for group in _identical(drive, key):
            kinds[group].append(kind)
    names = [frame.points for frame in drive.frames]
    return [_report_group(names, group, of_group) for group, of_group in sorted(kinds.items())]


def _report_group(names: Sequence[str], group: tuple[int, ...], kinds: Sequence[str]) -> Finding:
    """Report frames of a drive that have the same files of some kinds."""
    *firsts, last = kinds
    same = f"{', '.join(firsts)} and {last}" if firsts else last
    # A frame that is listed several times is named once.
    first, *others = sorted({names[index]: index for index in reversed(group)}.values())
    if not others:
        sentence = f"frame {frame_name(names, first)} is listed {len(group)} times, with the same {same}"
        return IDENTICAL_FILES.finding(sentence)
    verb = "have" if len(others) > 1 else "has"
    listed, first_name = frame_list(names, others), frame_name(names, first)
    return IDENTICAL_FILES.finding(f"{listed} {verb} the same {same} as frame {first_name}")


def _identical(drive: Drive, key: str) -> list[tuple[int, ...]]:
    """Group the indices of frames whose files of one kind are the same bytes. Only files of the same size are read."""
    named = [(index, getattr(frame, key)) for index, frame in enumerate(drive.frames)]
    paths = {index: drive.resolve(name) for index, name in named if name is not None}
    by_size, by_content = defaultdict[int, list[int]](list), defaultdict[str, list[int]](list)
    for index, path in paths.items():
        with suppress(OSError):
            by_size[path.stat().st_size].append(index)
    for index in chain.from_iterable(group for group in by_size.values() if len(group) > 1):
        with suppress(InputError):
            by_content[hash_file(paths[index])].append(index)
    return [tuple(group) for group in by_content.values() if len(group) > 1]
