"""Reading of point clouds: libraries of extras read LAS, LAZ and E57; the core reads all other formats."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, NamedTuple, TypeAlias, TypeVar

import numpy as np

from semcal_cli import core
from semcal_cli.config import MAX_POINTS
from semcal_cli.config.point_files import AS_USUAL, PointForm
from semcal_cli.errors import InputError, check_installed
from semcal_cli.files.array_forms import SweepCloud
from semcal_cli.files.e57_files import check_e57, read_e57
from semcal_cli.files.input_files import check_size, open_file, size_of
from semcal_cli.files.las_files import OWN_COLUMN, check_las, read_las
from semcal_cli.geometry.arrays import Array

BYTES_PER_POINT = 64
"""Maximum bytes per point of a file; see `rust/point_cloud/limit.rs`."""
PER_POINT = f", {BYTES_PER_POINT} a point: see --max-points"
"""What a limit in bytes applies to, for messages."""
MIN_LIMIT_BYTES = 1 << 20
"""Bytes that any file may have."""

Key: TypeAlias = tuple[Hashable, Hashable]
"""Key of a kept sweep: its points, with the form in which they were read, and its labels."""
Source = TypeVar("Source")


class _Library(NamedTuple):
    """How a library of an extra reads a format."""

    format: str
    package: str
    """Import name of the library."""
    extra: str
    check: Callable[[Path, BinaryIO, int], None]
    """Refuses what the library would trust, and more than a number of points."""
    read: Callable[[Path, BinaryIO, str | None], Array]
    """Reads the points of a checked file as records, with the field that tells the LiDAR's own points, if given."""
    own_column: str = "{}"
    """Name of the column with that field."""

    @contextmanager
    def refusing(self, path: Path) -> Iterator[None]:
        """Refuse a file for which the library lets through errors of struct, NumPy, lazrs or C++, or panics.

        Their words are for programmers, who find them in the cause of the error.
        """
        try:
            yield
        except (InputError, MemoryError):
            raise
        except BaseException as error:
            if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
                raise
            problem = f"it is damaged, or in a form that {self.package} does not read"
            raise InputError(f"{path}: is not a readable {self.format} file: {problem}") from error


LAS = _Library("LAS", "laspy", "las", check_las, read_las, OWN_COLUMN)
LIBRARIES = {
    ".las": LAS,
    ".laz": LAS,
    ".e57": _Library("E57", "pye57", "e57", check_e57, read_e57),
}
"""Formats that the core does not read, by their suffixes."""


def read_point_clouds(
    files: Sequence[tuple[Path, Path | None]], max_points: int = MAX_POINTS, form: PointForm = AS_USUAL
) -> list[core.PointCloud]:
    """Read sweeps, each with its label file, or else with its own label field if it has one.

    The sizes of all files are checked before the first is read.

    Args:
        files: Point cloud and label file of each sweep.
        max_points: Maximum number of points of a sweep, including points without a return.
        form: Columns of `.bin` files, unit of point times, and the LiDAR's own points, where the user states them.

    Raises:
        InputError: a file cannot be read, is too large, is not of the format of its suffix, has other columns than
            stated or usual, has no point of the LiDAR's own, or its numbers of points and labels differ.
    """
    libraries = [LIBRARIES.get(points.suffix.lower()) for points, _ in files]
    for (points, _), library in zip(files, libraries, strict=True):
        if library is not None:
            _check(points, library, max_points)
    read = core.read_point_clouds(
        [file for file, library in zip(files, libraries, strict=True) if library is None],
        max_points,
        form.point_columns,
        int(form.point_type[1:]),
        form.seconds_per_unit,
        form.own_points,
    )
    others = iter(read)
    return [
        next(others) if library is None else _read(*file, library, max_points, form)
        for file, library in zip(files, libraries, strict=True)
    ]


def max_bytes(max_points: int) -> int:
    """Compute the maximum size in bytes of a point cloud, and of a file of its labels or features."""
    return max(BYTES_PER_POINT * max_points, MIN_LIMIT_BYTES)


class SweepCache:
    """Reads each sweep with its labels once, and keeps it for all cameras and cues."""

    def __init__(self) -> None:
        self._clouds: dict[Key, SweepCloud] = {}

    def read(
        self,
        files: Sequence[tuple[Path, Path | None]],
        max_points: int = MAX_POINTS,
        form: PointForm = AS_USUAL,
    ) -> list[SweepCloud]:
        """Read sweeps as `read_point_clouds` does, with the same arguments and errors."""
        keys = [
            ((os.path.realpath(points), form), None if labels is None else os.path.realpath(labels))
            for points, labels in files
        ]
        return self.get(keys, files, lambda missing: read_point_clouds(missing, max_points, form))

    def get(
        self,
        keys: Sequence[Key],
        sources: Sequence[Source],
        read: Callable[[list[Source]], Sequence[SweepCloud]],
    ) -> list[SweepCloud]:
        """Return the sweep of each key, either kept or read from its source."""
        missing = {key: source for key, source in zip(keys, sources, strict=True) if key not in self._clouds}
        self._clouds.update(zip(missing, read(list(missing.values())), strict=True))
        return [self._clouds[key] for key in keys]

    @property
    def num_different(self) -> int:
        """Number of different point clouds read, whatever their labels."""
        return len({points for points, _ in self._clouds})


def _check(path: Path, library: _Library, max_points: int) -> None:
    check_installed(str(path), library.package, library.extra)
    with library.refusing(path), open_file(path) as file:
        check_size(path, size_of(file), max_bytes(max_points), PER_POINT)
        library.check(path, file, max_points)


def _read(
    path: Path, labels: Path | None, library: _Library, max_points: int, form: PointForm
) -> core.PointCloud:
    own = form.own_points
    with library.refusing(path), open_file(path) as file:
        records = library.read(path, file, None if own is None else own[0])
    contents = io.BytesIO()
    np.save(contents, records)
    return core.parse_point_cloud(
        path,
        contents.getvalue(),
        labels,
        max_points,
        form.seconds_per_unit,
        None if own is None else (library.own_column.format(own[0]), own[1]),
    )
