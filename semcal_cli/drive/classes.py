"""Dense classes, from 0 on, that replace the raw ids of labels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from semcal_cli import _core

NO_CLASS = 255
"""The class of points and pixels that carry no information."""

NUM_IDS = 65536
MAX_CLASSES = NO_CLASS


@dataclass(frozen=True)
class ClassTable:
    """Table from the raw ids of points or of pixels to classes."""

    names: tuple[str, ...]
    """Name of each class, from drive.yaml, or its raw id."""
    lookup: npt.NDArray[np.uint8]
    """(65536,) class of each raw id, or `NO_CLASS`."""

    def __call__(self, ids: npt.NDArray[np.uint16]) -> npt.NDArray[np.uint8]:
        """Look up the classes of raw ids."""
        return _core.look_up_classes(np.ascontiguousarray(ids), self.lookup)


def class_table(
    raw: Sequence[npt.NDArray[np.uint16]], named: Mapping[str, Sequence[int]], ignored: Sequence[int]
) -> ClassTable:
    """Number the classes of the points or of the pixels.

    Args:
        raw: Raw ids of every frame.
        named: Raw ids of each name; ids not listed carry no information. If empty, every id is a class of its own.
        ignored: Raw ids that carry no information.

    Raises:
        ValueError: there are more than 255 classes.
    """
    seen = _core.seen_ids([np.ascontiguousarray(ids) for ids in raw])
    seen[list(ignored)] = False
    groups = named or {str(value): (int(value),) for value in np.flatnonzero(seen)}
    listed = {name: [i for i in ids if seen[i]] for name, ids in groups.items()}
    present = {name: ids for name, ids in listed.items() if ids}
    if len(present) > MAX_CLASSES:
        raise ValueError(f"found {len(present)} classes, needed at most {MAX_CLASSES}")
    lookup = np.full(NUM_IDS, NO_CLASS, dtype=np.uint8)
    for index, group in enumerate(present.values()):
        lookup[group] = index
    return ClassTable(tuple(present), lookup)
