"""Poses from the numbers of a file, and the numbers of a pose."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from semcal_cli.errors import InputError
from semcal_cli.formats.format import FormatOptions
from semcal_cli.formats.node import MAX_MOUNT_M, Node, rigid
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import nearest_rigid, pose_from_quaternion, quaternion_xyzw, rpy

XYZ, RPY = ("x", "y", "z"), ("roll", "pitch", "yaw")
XYZW, WXYZ = ("qx", "qy", "qz", "qw"), ("qw", "qx", "qy", "qz")
ROUNDING = 1e-6
DIGITS = 9
"""Decimals that are written: nanometres, and much less than the rounding that is removed when a file is read."""
MIN_SCALE = 1e-3
"""Minimum ratio of the singular values of a matrix that is repaired; below it, no rotation is near."""


class PoseNotation(Protocol):
    """How the entry of a document holds a pose."""

    def read(self, node: Node, options: FormatOptions) -> Pose:
        """Read the pose (4, 4); raise an `InputError` if a number is wrong or the transform is not rigid."""

    def put(self, entry: dict[Any, Any], T: Pose) -> None:
        """Write the pose into the entry of a new document."""


@dataclass(frozen=True)
class MatrixNotation:
    """A pose as a matrix of 3 or 4 rows, or as a list of their numbers."""

    key: str

    def read(self, node: Node, options: FormatOptions) -> Pose:
        """Read the pose (4, 4)."""
        entry = node.at(self.key)
        is_flat = isinstance(entry.value, list) and not any(isinstance(row, list) for row in entry.value)
        if is_flat and len(entry.value) in (12, 16):
            return from_rows(entry.where, entry.numbers(), options)
        if not isinstance(entry.value, list) or len(entry.value) not in (3, 4):
            raise entry.mismatch("4 rows of 4 numbers")
        return from_rows(entry.where, entry.rows(4), options)

    def put(self, entry: dict[Any, Any], T: Pose) -> None:
        """Write the four rows."""
        entry[self.key] = rounded(T)


@dataclass(frozen=True)
class RotationNotation:
    """A pose as a rotation, nine numbers by rows, and a translation, each under its key."""

    rotation: str
    translation: str

    def read(self, node: Node, options: FormatOptions) -> Pose:
        """Read the pose (4, 4)."""
        R = node.at(self.rotation)
        T = transform(R.matrix(3, 3), node.at(self.translation).numbers(3))
        return check_transform(R.where, T, options)

    def put(self, entry: dict[Any, Any], T: Pose) -> None:
        """Write the nine numbers and the translation."""
        entry[self.rotation], entry[self.translation] = rounded(T[:3, :3].ravel()), rounded(T[:3, 3])


@dataclass(frozen=True)
class NumbersNotation:
    """A pose as the numbers of `XYZ`, and of `XYZW` or `RPY`."""

    parts: Mapping[str, tuple[str, ...]]
    """Names of the numbers under each key, in order; those under the empty key are in the entry itself."""
    are_named: bool = False
    """Whether a part is a mapping of named numbers, such as x y z w, and not a list."""

    def read(self, node: Node, options: FormatOptions) -> Pose:
        """Read the pose (4, 4)."""
        values: dict[str, float] = {}
        for key, names in self.parts.items():
            part = node.at(key) if key else node
            if self.are_named:
                values |= {name: part.at(_short(name)).number() for name in names}
            else:
                values |= dict(zip(names, part.numbers(len(names)), strict=True))
        return pose_of(node.where if len(self.parts) > 1 else part.where, values, options)

    def put(self, entry: dict[Any, Any], T: Pose) -> None:
        """Write the numbers, and keep other keys."""
        values = numbers_of(T)
        for key, names in self.parts.items():
            numbers = rounded([values[name] for name in names])
            if self.are_named:
                part = entry.setdefault(key, {}) if key else entry
                part.update(zip(map(_short, names), numbers, strict=True))
            else:
                entry[key] = numbers


def rounded(values: npt.ArrayLike) -> Any:
    """Round numbers of a transform (...) to the decimals that are written, as nested lists."""
    return (np.round(np.asarray(values, np.float64), DIGITS) + 0.0).tolist()


def number_text(value: float) -> str:
    """Write a number of a transform with the decimals that are needed, at least one and at most nine."""
    whole, point, decimals = f"{rounded(value):.{DIGITS}f}".partition(".")
    return f"{whole}{point}{decimals.rstrip('0') or '0'}"


def _short(name: str) -> str:
    return name.removeprefix("q")


def pose_of(where: str, numbers: Mapping[str, float], options: FormatOptions) -> Pose:
    """Make a transform from its named numbers: x y z in metres, and a quaternion or angles.

    Args:
        where: File and key, for messages.
        numbers: Values of `XYZ`, and of `XYZW`, a unit quaternion, or of `RPY`, in radians as in URDF:
            R = Rz(yaw) Ry(pitch) Rx(roll).
        options: Whether a quaternion of another norm is scaled.

    Raises:
        InputError: the norm of the quaternion is not 1, or the translation exceeds the limit of a rig.
    """
    translation = [numbers[name] for name in XYZ]
    if RPY[0] in numbers:
        from scipy.spatial.transform import Rotation

        R = Rotation.from_euler("xyz", [numbers[name] for name in RPY]).as_matrix()
        return rigid(where, transform(R, translation))
    xyzw = [numbers[name] for name in XYZW]
    norm = math.hypot(*xyzw)
    if options.on_repair is not None and norm > 0.0 and abs(norm - 1.0) > ROUNDING:
        options.on_repair(f"{where}: found a quaternion of norm {norm:.6g}, scaled it to 1")
        xyzw = [value / norm for value in xyzw]
    try:
        return rigid(where, pose_from_quaternion(xyzw, translation))
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None


def numbers_of(T: Pose) -> dict[str, float]:
    """Name the numbers of a transform: its translation in metres, unit quaternion, and angles in radians."""
    values = [*T[:3, 3].tolist(), *quaternion_xyzw(T).tolist(), *rpy(T)]
    return dict(zip((*XYZ, *XYZW, *RPY), values, strict=True))


def transform(R: npt.ArrayLike, translation: npt.ArrayLike = (0.0, 0.0, 0.0)) -> Pose:
    """Make the matrix (4, 4) of a rotation (3, 3) and a translation (3,)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, translation
    return T


def from_line(node: Node, options: FormatOptions | None = None) -> Pose:
    """Make a transform from 12 numbers by rows.

    Raises:
        InputError: these are not 12 numbers, or not a rigid transform.
    """
    return from_rows(node.where, node.numbers(12), options)


def rotation(node: Node, options: FormatOptions | None = None) -> Pose:
    """Read a pure rotation of nine numbers as a transform (4, 4); options may allow its repair.

    Raises:
        InputError: the numbers are not a rotation.
    """
    return check_transform(node.where, transform(node.matrix(3, 3)), options)


def from_rows(
    where: str,
    values: npt.ArrayLike,
    options: FormatOptions | None = None,
    farthest_m: float = MAX_MOUNT_M,
) -> Pose:
    """Make a transform of at most `farthest_m` along each axis from the 12 or 16 numbers of its rows.

    Raises:
        InputError: the numbers are not a rigid transform.
    """
    rows = np.array(values, np.float64).reshape(-1, 4)
    last = rows[3:] if len(rows) == 4 else [[0.0, 0.0, 0.0, 1.0]]
    return check_transform(where, np.vstack([rows[:3], last]), options, farthest_m)


def check_transform(
    where: str, T: Pose, options: FormatOptions | None, farthest_m: float = MAX_MOUNT_M
) -> Pose:
    """Check a transform that a file states, and remove its rounding; if repairs are allowed, use the nearest rotation.

    Raises:
        InputError: the transform is not rigid, or exceeds the limit of a rig. With `options`, the message names the
            option for a repair.
    """
    if options is not None and options.on_repair is not None and np.isfinite(T).all():
        _, scales, _ = np.linalg.svd(T[:3, :3])
        nearest = nearest_rigid(T)
        is_rotation = np.linalg.det(nearest[:3, :3]) > 0.0 and scales[-1] > MIN_SCALE * scales[0]
        if is_rotation and np.abs(scales - 1.0).max() > ROUNDING:
            options.on_repair(
                f"{where}: found a matrix that is not a rotation (determinant {np.prod(scales):.4g}, singular values "
                f"{scales[-1]:.4g} to {scales[0]:.4g}), used the nearest rotation"
            )
            T = nearest
        return rigid(where, T, farthest_m)
    try:
        return rigid(where, T, farthest_m)
    except InputError as error:
        if options is None or "expected a rotation" not in str(error):
            raise
        repair = f"{options.option('repair')} uses the nearest rotation{options.hint('repair')}"
        raise InputError(f"{error}; {repair}") from None
