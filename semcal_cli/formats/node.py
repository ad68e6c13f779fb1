"""Checked values of files, and values of a document that know their file and key.

An `InputError` about a value names the file and key, what was found and what was needed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from semcal_cli.drive.camera import Camera
from semcal_cli.errors import ChoiceError, InputError, counted, describe, listed, mismatch, one_of
from semcal_cli.files.validation import key_part, validate
from semcal_cli.geometry.arrays import Matrix, Pose, Vector
from semcal_cli.geometry.poses import check_rigid, nearest_rigid

NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?")
"""A number in a text."""
MAX_SIDE = 0xFFFF
"""Maximum number of pixels along a side of an image in a drive."""
MAX_STAMP_S = 1e10
"""Maximum stamp of a drive, seconds."""
MAX_MOUNT_M = 1e5
"""Maximum distance between two frames of a rig: a tenth of a drive's limit, so that a chain of several stays below."""
MAX_WORLD_M = 1e8
"""Maximum distance between two places on Earth."""


@dataclass(frozen=True)
class Node:
    """A value of a document."""

    file: str
    """Name of the file in messages."""
    value: Any
    key: str = ""
    """Keys that lead to the value, such as `results.T_lidar_camera`."""

    @property
    def where(self) -> str:
        """File and key, for messages."""
        return f"{self.file}: {self.key}" if self.key else self.file

    @property
    def mapping(self) -> dict[Any, Any]:
        """The value, which must be a mapping."""
        if not isinstance(self.value, dict):
            raise self.mismatch("a mapping")
        return self.value

    def mismatch(self, needed: str) -> InputError:
        """Make the error of a wrong value."""
        return InputError(f"{self.where}: {mismatch(describe(self.value), needed)}")

    def child(self, key: Any, value: Any) -> Node:
        """Make the node of a value under this one."""
        name = f"{self.key}{key_part(key)}" if self.key else key_part(key).removeprefix(".")
        return Node(self.file, value, name)

    def at(self, key: Any) -> Node:
        """Look up a key."""
        node = self.child(key, self.mapping.get(key))
        if node.value is None:
            raise node.mismatch("a value")
        return node

    def first(self, names: Sequence[str]) -> Node:
        """Look up a value under the first of several names that is present; the value may be null."""
        for name in names:
            if name in self.mapping:
                return self.child(name, self.mapping[name])
        raise InputError(
            f"{self.where}: found keys {listed(self.mapping)}, expected one of: {', '.join(names)}"
        )

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
        """Read a list of finite numbers whose length is one of `counts`, if any are given."""
        if not isinstance(self.value, list) or (counts and len(self.value) not in counts):
            raise self.mismatch(f"{' or '.join(map(str, counts))} numbers" if counts else "numbers")
        return [number(self.where, value) for value in self.value]

    def rows(self, *counts: int) -> list[list[float]]:
        """Read rows of finite numbers, as many in each as one of `counts`, if any are given."""
        if not isinstance(self.value, list):
            raise self.mismatch("rows of numbers")
        return [self.child(index, row).numbers(*counts) for index, row in enumerate(self.value)]

    def data(self) -> list[Any]:
        """Look up the finite numbers of a matrix, unconverted: under its key `data`, or as the value itself."""
        node = Node(self.file, self.value.get("data"), self.key) if isinstance(self.value, dict) else self
        node.numbers()
        values: list[Any] = node.value
        return values

    def matrix(self, rows: int, columns: int) -> Matrix:
        """Read a matrix (rows, columns) from a list of its numbers by rows."""
        return np.reshape(self.numbers(rows * columns), (rows, columns))


def number(where: str, value: object, low: float = -math.inf, high: float = math.inf) -> float:
    """Check that a value is a finite number from `low` to `high`; `where` names its file and key."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where}: found {describe(value)}, expected a number")
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    if not math.isfinite(result):
        raise InputError(f"{where}: found {describe(value)}, expected a finite number")
    if not low <= result <= high:
        raise InputError(f"{where}: found {describe(value)}, needed at least {low:g} and at most {high:g}")
    return result


def image_side(where: str, value: object) -> int:
    """Check the number of pixels along a side of an image; it is never rounded."""
    pixels = number(where, value)
    if not pixels.is_integer() or not 1 <= pixels <= MAX_SIDE:
        raise InputError(f"{where}: found {describe(value)}, expected a whole number from 1 to {MAX_SIDE}")
    return int(pixels)


def stamp_s(where: str, seconds: float) -> float:
    """Check a time in seconds, which must be in the range of a drive's stamps."""
    return number(where, seconds, -MAX_STAMP_S, MAX_STAMP_S)


def rigid(where: str, T: Pose, farthest_m: float = MAX_MOUNT_M) -> Pose:
    """Check a rigid transform of at most `farthest_m` along each axis, and remove its rounding."""
    try:
        check_rigid(T)
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None
    farthest = float(np.abs(T[:3, 3]).max())
    if not farthest <= farthest_m:
        raise InputError(f"{where}: found a translation of {farthest:g}, needed at most {farthest_m:g} m")
    return nearest_rigid(T)


def pick(
    kind: str,
    name: str | None,
    names: Sequence[str],
    where: object,
    *,
    default: str | None = None,
    expected: str | None = None,
) -> str:
    """Choose a sequence, a camera or the like: the named one, or else the default, or else the only one.

    Args:
        kind: What is chosen, for messages.
        name: The name that the user gives, if any.
        names: All names.
        where: The file or folder, for messages.
        default: Default name.
        expected: What is expected where there is none, for messages.

    Raises:
        ChoiceError: none is named, and there are several.
        InputError: there is none, or none of this name.
    """
    choice = default if name is None else name
    if not names:
        raise InputError(f"{where}: found no {kind}, expected {expected or default or 'one'}")
    if choice in names:
        return str(choice)
    if choice is None and len(names) == 1:
        return names[0]
    needed = one_of(choice or "", names)
    if name is not None:
        raise InputError(f"{where}: {kind}: found {name!r}, expected {needed}")
    without_default = f", and no {default}" if default else ""
    raise ChoiceError(
        f"{where}: found {counted(len(names), kind)}{without_default}",
        needed,
        [(f"--{kind}", known) for known in names],
    )


def checked_camera_block(path: Path | str, block: dict[str, Any], keys: Mapping[str, str]) -> dict[str, Any]:
    """Check the camera block of a drive that was made from a file.

    Args:
        path: The file.
        block: The block.
        keys: Names of the block's keys in the file, where they differ, for messages.
    """
    validate(Camera, block, path, keys)
    return block


def parse_numbers(path: Path, key: str, text: str, *counts: int) -> Vector:
    """Parse the finite numbers (count,) of a text."""
    words = text.split()
    needed = "a finite number" if counts == (1,) else f"{' or '.join(map(str, counts))} numbers, all finite"
    for word in words:
        if _finite(word) is None:
            raise InputError(f"{path}: {key}: {mismatch(repr(word[:40]), needed)}")
    if len(words) not in counts:
        raise InputError(f"{path}: {key}: {mismatch(counted(len(words), 'number'), needed)}")
    return np.array([float(word) for word in words])


def parse_number(where: str, text: str) -> float:
    """Parse a finite number."""
    value = _finite(text)
    if value is None:
        raise InputError(f"{where}: found {text[:40]!r}, expected a finite number")
    return value


def _finite(word: str) -> float | None:
    with suppress(ValueError):
        return value if math.isfinite(value := float(word)) else None
    return None
