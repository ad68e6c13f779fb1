"""Frames of a drive that share files, or whose files have the same content."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

from semcal_cli.assessment.frame_names import frame_list, frame_name
from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError
from semcal_cli.files.reading import hash_file

KINDS = {
    "points": "points",
    "point_labels": "labels of points",
    "image_labels": "label images",
    "image": "pictures",
}
"""Keys of a frame's files, with what a sentence calls them."""

Group = tuple[int, ...]


def find_identical_files(drive: Drive) -> list[str]:
    """Name the frames whose points, labels or pictures are the same bytes, in a sentence for each group of frames."""
    names = [frame.points for frame in drive.frames]
    kinds: dict[Group, list[str]] = defaultdict(list)
    for key, kind in KINDS.items():
        for group in _identical(_paths(drive, key)):
            kinds[group].append(kind)
    return [_sentence(names, group, of_group) for group, of_group in sorted(kinds.items())]


def _paths(drive: Drive, key: str) -> dict[int, Path]:
    found = {index: getattr(frame, key) for index, frame in enumerate(drive.frames)}
    return {index: drive.resolve(name) for index, name in found.items() if name is not None}


def _identical(paths: dict[int, Path]) -> list[Group]:
    """Group the indices of files with the same content. Only files of the same size are read."""
    by_size: dict[int, list[int]] = defaultdict(list)
    for index, path in paths.items():
        try:
            by_size[path.stat().st_size].append(index)
        except OSError:
            continue
    by_content: dict[str, list[int]] = defaultdict(list)
    for index in chain.from_iterable(group for group in by_size.values() if len(group) > 1):
        try:
            by_content[hash_file(paths[index])].append(index)
        except InputError:
            continue
    return [tuple(group) for group in by_content.values() if len(group) > 1]


def _sentence(names: Sequence[str], group: Group, kinds: Sequence[str]) -> str:
    *firsts, last = kinds
    same = f"{', '.join(firsts)} and {last}" if firsts else last
    # A frame that is listed several times is named once.
    first, *others = sorted({names[index]: index for index in reversed(group)}.values())
    if not others:
        return f"frame {frame_name(names, first)} is listed {len(group)} times, with the same {same}"
    verb = "have" if len(others) > 1 else "has"
    return f"{frame_list(names, others)} {verb} the same {same} as frame {frame_name(names, first)}"
