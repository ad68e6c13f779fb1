"""Dense classes: what raw ids become before anything is counted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

NO_CLASS = 255
"""The class of points and pixels that carry no information."""

NUM_IDS = 65536
MAX_CLASSES = NO_CLASS


@dataclass(frozen=True)
class ClassTable:
    """Maps the raw ids of one side, points or image, to classes."""

    names: tuple[str, ...]
    """The name of each class: that of drive.yaml, or the raw id."""
    lookup: npt.NDArray[np.uint8]
    """(65536,) the class of each raw id, or `NO_CLASS`."""

    def __call__(self, ids: npt.NDArray[np.uint16]) -> npt.NDArray[np.uint8]:
        """Classes of raw ids."""
        return self.lookup[ids]


def class_table(
    raw: Sequence[npt.NDArray[np.uint16]], named: Mapping[str, Sequence[int]], ignored: Sequence[int]
) -> ClassTable:
    """Number the classes of one side.

    Args:
        raw: The raw ids of every frame.
        named: Raw ids under each name; ids not listed carry no information. Empty: every id is its own class.
        ignored: Raw ids that carry no information.

    Raises:
        ValueError: there are more than 255 classes.
    """
    seen = np.zeros(NUM_IDS, dtype=bool)
    for ids in raw:
        seen |= np.bincount(ids.ravel(), minlength=NUM_IDS) > 0
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
