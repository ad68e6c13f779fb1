"""Checked values of a data set's files: the message on a wrong value names its file and key."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np
import numpy.typing as npt

from semcal_cli.drive.document import Camera
from semcal_cli.errors import InputError
from semcal_cli.files.messages import describe, one_of
from semcal_cli.files.reading import read_text
from semcal_cli.files.validation import validate
from semcal_cli.geometry.poses import Pose, Vector, check_rigid, nearest_rigid

MAX_SIDE = 0xFFFF
"""Largest number of pixels along a side of an image in a drive."""
MAX_STAMP_S = 1e10
"""Largest stamp of a drive, seconds."""
MAX_MOUNT_M = 1e5
"""Largest distance between two frames of a rig: a tenth of a drive's limit, so that several in a row stay below."""
MAX_WORLD_M = 1e8
"""Largest distance between two places on Earth."""


def number(where: str, value: object, low: float = -math.inf, high: float = math.inf) -> float:
    """Check that a value is a finite number from `low` to `high`; `where` names its file and key.

    Raises:
        InputError: the value is not such a number.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where}: found {describe(value)}, needed a number")
    try:
        found = float(value)
    except OverflowError:
        found = math.inf
    if not math.isfinite(found):
        raise InputError(f"{where}: found {describe(value)}, needed a finite number")
    if not low <= found <= high:
        raise InputError(f"{where}: found {describe(value)}, needed at least {low:g} and at most {high:g}")
    return found


def image_side(where: str, value: object) -> int:
    """Check the number of pixels along a side of an image; it is never rounded.

    Raises:
        InputError: the value is not a whole number in the range of image sides.
    """
    pixels = number(where, value)
    if not pixels.is_integer() or not 1 <= pixels <= MAX_SIDE:
        raise InputError(f"{where}: found {describe(value)}, needed a whole number from 1 to {MAX_SIDE}")
    return int(pixels)


def stamp_s(where: str, seconds: float) -> float:
    """Check a time in seconds.

    Raises:
        InputError: the time is outside the range of a drive's stamps.
    """
    return number(where, seconds, -MAX_STAMP_S, MAX_STAMP_S)


def rigid(where: str, T: Pose, farthest_m: float = MAX_MOUNT_M) -> Pose:
    """Check a rigid transform that a file states, and remove its rounding.

    Raises:
        InputError: the matrix is not rigid, or reaches farther than `farthest_m` along an axis.
    """
    try:
        check_rigid(T)
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None
    farthest = float(np.abs(T[:3, 3]).max())
    if not farthest <= farthest_m:
        raise InputError(f"{where}: found a translation of {farthest:g}, needed at most {farthest_m:g} m")
    return nearest_rigid(T)


def pose_from_rows(where: str, values: npt.NDArray[np.float64], farthest_m: float = MAX_MOUNT_M) -> Pose:
    """Make a transform (4, 4) from the 12 numbers of its first three rows.

    Raises:
        InputError: it is not rigid, or too far.
    """
    return rigid(where, np.vstack([values.reshape(3, 4), [0.0, 0.0, 0.0, 1.0]]), farthest_m)


def camera_block(path: Path, block: dict[str, Any], keys: Mapping[str, str]) -> dict[str, Any]:
    """Check the camera block of a drive that was made from a file.

    Args:
        path: The file.
        block: The block.
        keys: Names of the block's keys in the file, where they differ.

    Raises:
        InputError: the block is wrong; the message names the file's own key.
    """
    try:
        validate(Camera, block, Path("camera"))
    except InputError as error:
        found = re.fullmatch(r"camera: (\w+)(.*)", str(error), re.DOTALL)
        key, complaint = found.groups() if found else ("camera", f": {error}")
        raise InputError(f"{path}: {keys.get(key, key)}{complaint}") from None
    return block


def read_keyed(path: Path) -> dict[str, str]:
    """Read `key: values` lines, as KITTI's calibration files have them.

    Raises:
        InputError: the file is missing, or is not text.
    """
    return keyed_lines(read_text(path))


GIVEN_TWICE = "\0"
"""Value of a key that stands on several lines: nobody can tell which is meant."""


def keyed_lines(text: str) -> dict[str, str]:
    """Map the keys of `key: values` lines to their values."""
    keyed: dict[str, str] = {}
    for key, colon, values in (line.partition(":") for line in text.splitlines()):
        if colon:
            keyed[key.strip()] = GIVEN_TWICE if key.strip() in keyed else values.strip()
    return keyed


def numbers(path: Path, keyed: dict[str, str], key: str, *counts: int) -> Vector:
    """Parse the finite numbers (count,) under a key of a file that `read_keyed` read.

    Raises:
        InputError: the key is missing, or its value is something else.
    """
    if key not in keyed:
        raise InputError(f"{path}: found no key {key!r}, needed {one_of(key, list(keyed))}")
    if keyed[key] == GIVEN_TWICE:
        raise InputError(f"{path}: {key}: found it twice, needed it once")
    return parse_numbers(path, key, keyed[key], *counts)


def transform(path: Path, keyed: dict[str, str], key: str) -> Pose:
    """Read a transform (4, 4) from the 12 numbers under a key.

    Raises:
        InputError: the key is missing, or the transform is not rigid.
    """
    return pose_from_rows(f"{path}: {key}", numbers(path, keyed, key, 12))


def parse_numbers(path: Path, key: str, text: str, *counts: int) -> Vector:
    """Parse the finite numbers (count,) of a text.

    Raises:
        InputError: the text is something else.
    """
    words = text.split()
    needed = " or ".join(map(str, counts))
    if (wrong := next((word for word in words if not _is_finite(word)), None)) is not None:
        raise InputError(f"{path}: {key}: found {wrong[:40]!r}, needed {needed} numbers, all finite")
    if len(words) not in counts:
        raise InputError(f"{path}: {key}: found {len(words)} numbers, needed {needed}, all finite")
    return np.array([float(word) for word in words])


def _is_finite(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False


def parse_number(where: str, text: str) -> float:
    """Parse a finite number.

    Raises:
        InputError: the text is not a finite number.
    """
    if not _is_finite(text):
        raise InputError(f"{where}: found {text[:40]!r}, needed a finite number")
    return float(text)


def mapping_at(where: str, value: object) -> dict[Any, Any]:
    """Check that a value is a mapping.

    Raises:
        InputError: the value is something else.
    """
    if not isinstance(value, dict):
        raise InputError(f"{where}: found {describe(value)}, needed a mapping")
    return value


def at(where: str, node: object, key: str) -> Any:
    """Look up a key of a mapping in a document.

    Raises:
        InputError: the key is missing, or the node is not a mapping.
    """
    mapping = mapping_at(where, node)
    if mapping.get(key) is None:
        raise InputError(f"{where}: {key}: found nothing, needed a value")
    return mapping[key]


def text_at(where: str, node: object, key: str) -> str:
    """Look up the text under a key.

    Raises:
        InputError: the key is missing, or its value is not a text.
    """
    value = at(where, node, key)
    if not isinstance(value, str) or not value:
        raise InputError(f"{where}: {key}: found {describe(value)}, needed a name")
    return value


def numbers_in(where: str, node: object, key: str, count: int) -> list[float]:
    """Look up the list of `count` finite numbers under a key.

    Raises:
        InputError: the key is missing, or its value is not such a list.
    """
    values = at(where, node, key)
    if not isinstance(values, list) or len(values) != count:
        raise InputError(f"{where}: {key}: found {describe(values)}, needed {count} numbers")
    return [number(f"{where}: {key}", value) for value in values]


def numbers_at(where: str, node: object, key: str, names: Sequence[str]) -> list[float]:
    """Look up the finite numbers that the mapping under a key has under some names.

    Raises:
        InputError: there is no mapping with all of the names.
    """
    part = mapping_at(f"{where}: {key}", at(where, node, key))
    return [number(f"{where}: {key}.{name}", at(f"{where}: {key}", part, name)) for name in names]


def _is_flat(rows: object) -> TypeGuard[list[object]]:
    """Tell whether a matrix is a list of its numbers by rows."""
    return isinstance(rows, list) and len(rows) in (12, 16) and not any(isinstance(row, list) for row in rows)


def rows_like(before: object, T: Pose) -> list[Any]:
    """Rows of a transform, laid out as the matrix that they replace: in one list, or without the last row."""
    if _is_flat(before):
        numbers: list[Any] = T.ravel()[: len(before)].tolist()
        return numbers
    rows: list[Any] = T[: 3 if isinstance(before, list) and len(before) == 3 else 4].tolist()
    return rows


def matrix_at(where: str, node: object, key: str) -> list[float]:
    """Look up the numbers, by rows, of the 4 x 4 or 3 x 4 matrix under a key: a list of rows, or one of numbers.

    Raises:
        InputError: the key is missing, or its value is not such a matrix.
    """
    rows = at(where, node, key)
    if _is_flat(rows):
        return [number(f"{where}: {key}", value) for value in rows]
    if (
        not isinstance(rows, list)
        or len(rows) not in (3, 4)
        or any(not isinstance(row, list) or len(row) != 4 for row in rows)
    ):
        raise InputError(f"{where}: {key}: found {describe(rows)}, needed 4 rows of 4 numbers")
    return [number(f"{where}: {key}", value) for row in rows for value in row]
