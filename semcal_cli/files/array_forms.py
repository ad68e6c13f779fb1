"""Arrays that a program passes instead of files: both become the same objects, and arrays are copied only if needed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple, TypeAlias

import numpy as np

from semcal_cli import core
from semcal_cli.errors import InputError
from semcal_cli.geometry.arrays import Array, Image, Mask, Numbers, Points, RawIds, Values

Labels: TypeAlias = RawIds | core.ClassShares
"""Raw ids of pixels or points, or their probabilities."""
MAX_ID = 65_535
"""Maximum id of a class."""


class Form(NamedTuple):
    """A form that an array may have."""

    shape: tuple[int | str, ...]
    """Lengths of the axes; a letter stands for any length."""
    kinds: tuple[type[np.generic], ...] = (np.integer, np.floating)
    """Allowed types of the numbers."""
    needed: str = "numbers"
    """Name of these types in messages."""

    def __str__(self) -> str:
        """Write the shape as NumPy does."""
        return f"({', '.join(map(str, self.shape))}{',' * (len(self.shape) == 1)})"

    def fits(self, shape: tuple[int, ...]) -> bool:
        """Return whether an array has this shape."""
        if len(shape) != len(self.shape):
            return False
        return all(
            isinstance(length, str) or length == side for side, length in zip(shape, self.shape, strict=True)
        )


COLORS = (np.uint8,), "uint8"
"""Type of the numbers of an image, and its name in messages."""
POINTS = (Form(("N", 3)), Form(("N", 4)))
"""Forms of the points of a sweep, without and with intensity."""


def check_array(name: str, array: object, forms: Sequence[Form]) -> None:
    """Check that a value is an array of one of several forms.

    Args:
        name: Name in messages.
        array: Any value that a program passes.
        forms: The allowed forms.

    Raises:
        InputError: it is not an array, or its shape or type is wrong.
    """
    shapes = " or ".join(map(str, forms))
    if not isinstance(array, np.ndarray):
        raise InputError(f"{name}: found {type(array).__name__}, expected an array of shape {shapes}")
    form = next((form for form in forms if form.fits(array.shape)), None)
    if form is None:
        raise InputError(f"{name}: found shape {array.shape}, needed {shapes}")
    if not any(np.issubdtype(array.dtype, kind) for kind in form.kinds):
        raise InputError(f"{name}: found {array.dtype}, expected {form.needed}")


@dataclass(frozen=True, eq=False)
class ArrayCloud:
    """A sweep with the fields of `core.PointCloud`, which shares memory with a program's arrays where possible."""

    points: Points
    """(N, 3) metres, LiDAR frame, without no-returns: entries that are not finite or all zero."""
    is_kept: Mask
    """Which of the given entries are points."""
    intensity: Values | None
    """(N,) as given."""
    time: Numbers | None
    """(N,) seconds."""
    labels: RawIds | None
    """(N,) raw class ids."""
    label_shares: core.ClassShares | None
    """Probabilities of raw class ids instead."""
    ring: RawIds | None = None
    """(N,) ring of each point, which arrays do not state."""

    @property
    def num_no_returns(self) -> int:
        """Number of no-returns that were left out."""
        return len(self.is_kept) - len(self.points)


SweepCloud: TypeAlias = core.PointCloud | ArrayCloud
"""A sweep read from a file, or made from arrays."""


def cloud_of(
    name: str, points: Array, times: Array | None = None, labels: tuple[str, Array] | None = None
) -> ArrayCloud:
    """Make a sweep from arrays.

    Args:
        name: Name of the points in messages.
        points: (N, 3) or (N, 4) metres, LiDAR frame, with the intensity in the fourth column.
        times: (N,) seconds.
        labels: Name of the labels in messages, and their ids (N,) or probabilities (N, C).

    Raises:
        InputError: no entry is a point, or labels are wrong.
    """
    with np.errstate(over="ignore"):  # Entries that become infinite are not points.
        columns = points.astype(np.float32, copy=False)
    xyz = columns[:, :3]
    is_return = np.asarray(np.isfinite(xyz).all(axis=1) & xyz.any(axis=1))
    if not is_return.any():
        raise InputError(f"{name}: found no points, expected coordinates that are finite and not all zero")
    selection = slice(None) if is_return.all() else is_return
    point_labels = None if labels is None else labels_of(labels[0], labels[1][selection])
    return ArrayCloud(
        points=np.ascontiguousarray(xyz[selection]),
        is_kept=is_return,
        intensity=np.ascontiguousarray(columns[selection, 3]) if columns.shape[1] > 3 else None,
        time=None if times is None else np.ascontiguousarray(times[selection], np.float64),
        labels=point_labels if isinstance(point_labels, np.ndarray) else None,
        label_shares=point_labels if isinstance(point_labels, core.ClassShares) else None,
    )


def labels_of(name: str, labels: Array, num_sides: int = 1) -> Labels:
    """Convert labels to 16-bit ids, or to shares if they are probabilities; 16-bit ids are not copied.

    Args:
        name: Name of the labels in messages.
        labels: Ids of points (N,) or of pixels (H, W), or probabilities with the classes along one more axis.
        num_sides: Number of axes of ids: 1 for points, 2 for pixels.

    Raises:
        InputError: an id is out of range, a probability is negative or not finite, or there are too many classes.
    """
    if labels.ndim > num_sides:
        return _shares_of(name, labels)
    if not np.can_cast(labels.dtype, np.uint16):
        for wrong in (labels.min(), labels.max()):
            if not 0 <= wrong <= MAX_ID:
                raise InputError(f"{name}: found the id {wrong}, expected ids from 0 to {MAX_ID}")
    return np.ascontiguousarray(labels, np.uint16)


def _shares_of(name: str, probabilities: Array) -> core.ClassShares:
    """Let the core read probabilities (..., C) with its reader of files, from a file that exists only in memory."""
    descriptor = os.memfd_create("semcal")
    path = Path(f"/proc/self/fd/{descriptor}")
    with os.fdopen(descriptor, "w+b") as file:
        np.savez(file, np.ascontiguousarray(probabilities))
        file.flush()
        try:
            (shares,) = core.read_class_shares([path], probabilities.shape[:-1])
        except InputError as error:
            raise InputError(str(error).replace(str(path), name)) from None
    return shares


def image_of(image: Image) -> Image:
    """Convert an image (H, W) or (H, W, 3), red, green, blue, to the form of a file's: (H, W, 3) blue, green, red."""
    if image.ndim == 2:
        return np.repeat(image[..., None], 3, axis=2)
    return np.ascontiguousarray(image[..., ::-1])


def hash_array(array: Array) -> str:
    """Compute the SHA-256 of the .npy file that `numpy.save` would write, in hexadecimal digits."""
    digest = sha256()
    np.save(SimpleNamespace(write=digest.update), array, allow_pickle=False)
    return digest.hexdigest()
