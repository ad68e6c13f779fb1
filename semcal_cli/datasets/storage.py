"""OpenCV's FileStorage: YAML whose first line no YAML parser takes, XML or JSON."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from semcal_cli.documents import read_text
from semcal_cli.errors import InputError

Array: TypeAlias = npt.NDArray[np.float64]

MARKS = ("%YAML:", "<?xml", "opencv-matrix", "opencv_storage")


def is_storage(text: str) -> bool:
    """Whether a text was written by OpenCV."""
    return any(mark in text for mark in MARKS)


class Storage:
    """A file that OpenCV wrote. Complaints name the file, the key, what was found and what was needed."""

    def __init__(self, path: Path):
        import cv2

        self.path = path
        flags = cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY
        try:
            self._root = cv2.FileStorage(read_text(path), flags)
        except cv2.error as error:
            raise InputError(f"{path}: found no OpenCV FileStorage that can be read: {error.err}") from None

    def names(self) -> list[str]:
        """Keys at the top level."""
        return list(map(str, self._root.root().keys()))

    def array(self, *keys: str) -> Array:
        """The numbers of a matrix or a list, in order; of a number, itself.

        Raises:
            InputError: there is no such key, or it holds no finite numbers.
        """
        node = self._root.root()
        for key in keys:
            node = node.getNode(key)
            if node.empty():
                raise InputError(f"{self.path}: {'.'.join(keys)}: found nothing, needed numbers")
        if node.isMap():
            matrix = node.mat()
            values = np.array([] if matrix is None else matrix, dtype=float).ravel()
        elif node.isSeq():
            values = np.array([node.at(i).real() for i in range(node.size())], dtype=float)
        else:
            values = np.array([node.real()] if node.isReal() or node.isInt() else [], dtype=float)
        if not values.size or not np.isfinite(values).all():
            raise InputError(f"{self.path}: {'.'.join(keys)}: found no finite numbers, needed some")
        return values

    def first(self, names: Sequence[str]) -> Array:
        """The numbers under the first of several names that is there.

        Raises:
            InputError: none is.
        """
        known = self.names()
        for name in names:
            if name in known:
                return self.array(name)
        raise InputError(f"{self.path}: found keys {', '.join(known)}, needed one of: {', '.join(names)}")

    def number(self, *keys: str) -> float:
        """One number.

        Raises:
            InputError: there is no such key, or it holds something else.
        """
        values = self.array(*keys)
        if values.size != 1:
            raise InputError(f"{self.path}: {'.'.join(keys)}: found {values.size} numbers, needed one")
        return float(values[0])
