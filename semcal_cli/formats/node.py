"""A value of a document that knows where it stands.

Methods raise an `InputError` that names file and key, what was found and what was needed, where the value is another.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeGuard

import numpy as np
import numpy.typing as npt

from semcal_cli.errors import InputError, describe, listed
from semcal_cli.files.validation import key_part
from semcal_cli.formats.values import image_side, number
from semcal_cli.geometry.poses import Pose


@dataclass(frozen=True)
class Node:
    """A value of a document."""

    file: str
    """Name of the file in messages."""
    value: Any
    key: str = ""
    """Keys that lead to the value, as `results.T_lidar_camera`."""

    @property
    def where(self) -> str:
        """File and key, as messages name them."""
        return f"{self.file}: {self.key}" if self.key else self.file

    @property
    def mapping(self) -> dict[Any, Any]:
        """The value, which must be a mapping."""
        if not isinstance(self.value, dict):
            raise self.mismatch("a mapping")
        return self.value

    def mismatch(self, needed: str) -> InputError:
        """Make the error of a wrong value."""
        return InputError(f"{self.where}: found {describe(self.value)}, needed {needed}")

    def child(self, key: Any, value: Any) -> Node:
        """Make the node of a value under this one."""
        name = f"{self.key}{key_part(key)}" if self.key else key_part(key).removeprefix(".")
        return Node(self.file, value, name)

    def at(self, key: Any) -> Node:
        """Look up a key."""
        found = self.child(key, self.mapping.get(key))
        if found.value is None:
            raise found.mismatch("a value")
        return found

    def first(self, *names: str) -> Node:
        """Look up the first of several names of a value, which may be empty."""
        name = next((name for name in names if name in self.mapping), None)
        if name is None and len(names) == 1:
            raise self.child(names[0], None).mismatch("a value")
        if name is None:
            raise InputError(
                f"{self.where}: found keys {listed(self.mapping)}, needed one of: {', '.join(names)}"
            )
        return self.child(name, self.mapping[name])

    def text(self) -> str:
        """Read a text."""
        if not isinstance(self.value, str) or not self.value:
            raise self.mismatch("a name")
        return self.value

    def number(self, low: float = -math.inf, high: float = math.inf) -> float:
        """Read a finite number from `low` to `high`."""
        return number(self.where, self.value, low, high)

    def side(self) -> int:
        """Read the number of pixels along a side of an image."""
        return image_side(self.where, self.value)

    def numbers(self, *counts: int) -> list[float]:
        """Read a list of finite numbers, of one of some lengths."""
        if not isinstance(self.value, list) or (counts and len(self.value) not in counts):
            raise self.mismatch(f"{' or '.join(map(str, counts))} numbers" if counts else "numbers")
        return [number(self.where, value) for value in self.value]

    def data(self) -> list[Any]:
        """Look up the finite numbers of a matrix, as they are stated: under its key `data`, or under its name."""
        found = Node(self.file, self.value.get("data"), self.key) if isinstance(self.value, dict) else self
        found.numbers()
        values: list[Any] = found.value
        return values

    def matrix(self, rows: int, columns: int) -> npt.NDArray[np.float64]:
        """Read a matrix (rows, columns) of a list of its numbers by rows."""
        return np.reshape(self.numbers(rows * columns), (rows, columns))

    def rows(self) -> list[float]:
        """Read the numbers, by rows, of a 4 x 4 or 3 x 4 matrix: a list of rows, or one of numbers."""
        rows = self.value
        if _is_flat(rows):
            return self.numbers()
        if (
            not isinstance(rows, list)
            or len(rows) not in (3, 4)
            or any(not isinstance(row, list) or len(row) != 4 for row in rows)
        ):
            raise self.mismatch("4 rows of 4 numbers")
        return [number(self.where, value) for row in rows for value in row]


def rows_like(before: object, T: Pose) -> list[Any]:
    """Rows of a transform, laid out as the matrix that they replace: in one list, or without the last row."""
    if _is_flat(before):
        numbers: list[Any] = T.ravel()[: len(before)].tolist()
        return numbers
    rows: list[Any] = T[: 3 if isinstance(before, list) and len(before) == 3 else 4].tolist()
    return rows


def _is_flat(rows: object) -> TypeGuard[list[object]]:
    """Tell whether a matrix is a list of its numbers by rows."""
    return isinstance(rows, list) and len(rows) in (12, 16) and not any(isinstance(row, list) for row in rows)
