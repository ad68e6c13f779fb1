"""Files of `key: values` lines, as KITTI's and OpenCalib's calibrations are."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from semcal_cli.errors import InputError
from semcal_cli.files.messages import one_of
from semcal_cli.files.reading import read_text
from semcal_cli.formats.format import FormatOptions, Source
from semcal_cli.formats.pose import checked, from_rows, transform
from semcal_cli.formats.values import image_side, parse_numbers
from semcal_cli.geometry.poses import Pose, Vector


@dataclass(frozen=True)
class Keyed:
    """The lines of a file."""

    path: Path
    text: str

    @classmethod
    def read(cls, path: Path) -> Keyed:
        """Read a file.

        Raises:
            InputError: the file is missing, or is not text.
        """
        return cls(path, read_text(path))

    @cached_property
    def values(self) -> dict[str, list[str]]:
        """Values of each key, one for each of its lines."""
        values: dict[str, list[str]] = {}
        for key, colon, value in (line.partition(":") for line in self.text.splitlines()):
            if colon:
                values.setdefault(key.strip(), []).append(value)
        return values

    def where(self, key: str) -> str:
        """File and key, as messages name them."""
        return f"{self.path}: {key}"

    def numbers(self, key: str, *counts: int) -> Vector:
        """Read the finite numbers (count,) under a key.

        Raises:
            InputError: the key is missing or stands on several lines, or its value is something else.
        """
        if key not in self.values:
            raise InputError(f"{self.path}: found no key {key!r}, needed {one_of(key, list(self.values))}")
        if len(self.values[key]) > 1:
            raise InputError(f"{self.where(key)}: found it twice, needed it once")
        return parse_numbers(self.path, key, self.values[key][0], *counts)

    def matrix(self, key: str, rows: int, columns: int) -> npt.NDArray[np.float64]:
        """Read a matrix (rows, columns).

        Raises:
            InputError: the key is missing, or does not hold so many numbers.
        """
        return self.numbers(key, rows * columns).reshape(rows, columns)

    def transform(self, key: str, options: FormatOptions | None = None) -> Pose:
        """Read a transform (4, 4) of 12 numbers; options may allow its repair.

        Raises:
            InputError: the key is missing, or the transform is not rigid.
        """
        return from_rows(self.where(key), self.numbers(key, 12), options)

    def rotation(self, key: str, options: FormatOptions | None = None) -> Pose:
        """Read a pure rotation of nine numbers as a transform (4, 4); options may allow its repair.

        Raises:
            InputError: the key is missing, or its numbers are no rotation.
        """
        return checked(self.where(key), transform(self.matrix(key, 3, 3)), options)

    def image_size(self, key: str) -> tuple[int, int]:
        """Read the width and height of images, in pixels.

        Raises:
            InputError: the key is missing, or its values are no whole numbers of pixels.
        """
        width, height = (image_side(self.where(key), side) for side in self.numbers(key, 2).tolist())
        return width, height


def keyed_in(source: Source) -> Keyed:
    """The lines of a file of a transform; none if it is not text, for recognising formats."""
    with suppress(InputError):
        return Keyed(source.path, source.text)
    return Keyed(source.path, "")


def keyed_line(key: str, T: Pose) -> bytes:
    """Write a line with the first 12 numbers of a transform, by rows."""
    return f"{key}: {row(T)}\n".encode()


def row(T: Pose) -> str:
    """Write the first 12 numbers of a transform, by rows."""
    return " ".join(map(repr, T[:3].ravel().tolist()))
