"""Checked values of files.

Functions raise an `InputError` that names file and key, what was found and what was needed, where the value is another.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from semcal_cli.drive.camera import Camera
from semcal_cli.errors import InputError, describe, one_of
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
    """Check that a value is a finite number from `low` to `high`; `where` names its file and key."""
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
    """Check the number of pixels along a side of an image; it is never rounded."""
    pixels = number(where, value)
    if not pixels.is_integer() or not 1 <= pixels <= MAX_SIDE:
        raise InputError(f"{where}: found {describe(value)}, needed a whole number from 1 to {MAX_SIDE}")
    return int(pixels)


def stamp_s(where: str, seconds: float) -> float:
    """Check a time in seconds, which must be in the range of a drive's stamps."""
    return number(where, seconds, -MAX_STAMP_S, MAX_STAMP_S)


def rigid(where: str, T: Pose, farthest_m: float = MAX_MOUNT_M) -> Pose:
    """Check a rigid transform that reaches at most `farthest_m` along an axis, and remove its rounding."""
    try:
        check_rigid(T)
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None
    farthest = float(np.abs(T[:3, 3]).max())
    if not farthest <= farthest_m:
        raise InputError(f"{where}: found a translation of {farthest:g}, needed at most {farthest_m:g} m")
    return nearest_rigid(T)


def pick(
    kind: str, wanted: str | None, known: Sequence[str], where: object, *, usual: str | None = None
) -> str:
    """Choose a sequence, a camera or the like: the wanted one, else the usual one, else the only one.

    Args:
        kind: What is chosen, as messages call it.
        wanted: The name that the user gives, if any.
        known: All names.
        where: The file or folder that messages name.
        usual: The name that is taken if none is wanted.
    """
    choice = usual if wanted is None else wanted
    if not known:
        raise InputError(f"{where}: found no {kind}, needed {usual or 'one'}")
    if choice in known:
        return str(choice)
    if choice is None and len(known) == 1:
        return known[0]
    found = "none given" + (f", and no {usual}" if usual else "") if wanted is None else f"found {wanted!r}"
    raise InputError(f"{where}: {kind}: {found}, needed {one_of(choice or '', known)}")


def camera_block(path: Path | str, block: dict[str, Any], keys: Mapping[str, str]) -> dict[str, Any]:
    """Check the camera block of a drive that was made from a file.

    Args:
        path: The file.
        block: The block.
        keys: Names of the block's keys in the file, where they differ; messages name these.
    """
    try:
        validate(Camera, block, Path("camera"))
    except InputError as error:
        found = re.fullmatch(r"camera: (\w+)(.*)", str(error), re.DOTALL)
        key, complaint = found.groups() if found else ("camera", f": {error}")
        raise InputError(f"{path}: {keys.get(key, key)}{complaint}") from None
    return block


def parse_numbers(path: Path, key: str, text: str, *counts: int) -> Vector:
    """Parse the finite numbers (count,) of a text."""
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
    """Parse a finite number."""
    if not _is_finite(text):
        raise InputError(f"{where}: found {text[:40]!r}, needed a finite number")
    return float(text)
