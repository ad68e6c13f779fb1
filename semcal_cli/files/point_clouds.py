"""Reading of point clouds: laspy, the extra `las`, reads LAS and LAZ; the core reads all other formats."""

from __future__ import annotations

import io
import os
import struct
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, TypeAlias, TypeVar

import numpy as np

from semcal_cli import core
from semcal_cli.config import MAX_POINTS
from semcal_cli.config.point_files import AS_USUAL, PointForm
from semcal_cli.errors import InputError, check_installed
from semcal_cli.files.array_forms import SweepCloud
from semcal_cli.files.input_files import check_size, open_file, size_of

if TYPE_CHECKING:
    import laspy

BYTES_PER_POINT = 64
"""Maximum bytes per point of a file; see `rust/point_cloud/limit.rs`."""
PER_POINT = f", {BYTES_PER_POINT} a point: see --max-points"
"""What a limit in bytes applies to, for messages."""
MIN_LIMIT_BYTES = 1 << 20
"""Bytes that any file may have."""
CHUNK = 1_000_000
"""Points unpacked at a time, so that a header that promises too many costs nothing."""
MAX_INFLATION = 100
"""Maximum ratio of the unpacked size of a LAZ file to its own; a factor of ten is common."""
START = struct.Struct("<94xHII")
"""Start of a header: its size, the offset of the points, and the number of VLRs."""
VLR_BYTES = 54
"""Size of the header of a VLR."""
LASZIP = struct.Struct("<12xI16xH")
"""LASzip's record: points in a chunk, and items in a point."""
MIN_CHUNK_POINTS = 100
"""Minimum number of points in a chunk; with smaller chunks, the table is larger than the data."""

Key: TypeAlias = tuple[Hashable, Hashable]
"""Key of a kept sweep: its points, with the form in which they were read, and its labels."""
Source = TypeVar("Source")

FIELDS = {"intensity": "intensity", "gps_time": "time", "classification": "label"}
"""Fields of a LAS file that are used in addition to the coordinates, with their names in a cloud."""


def read_point_clouds(
    files: Sequence[tuple[Path, Path | None]], max_points: int = MAX_POINTS, form: PointForm = AS_USUAL
) -> list[core.PointCloud]:
    """Read sweeps, each with its label file, or else with its own label field if it has one.

    The sizes of all files are checked before the first is read.

    Args:
        files: Point cloud and label file of each sweep.
        max_points: Maximum number of points of a sweep, including points without a return.
        form: Columns of `.bin` files and unit of point times, where the user states them.

    Raises:
        InputError: a file cannot be read, is too large, is not of the format of its suffix, has other columns than
            stated or usual, or its numbers of points and labels differ.
    """
    for points, _ in files:
        if _is_las(points):
            _check_las(points, max_points)
    read = core.read_point_clouds(
        [file for file in files if not _is_las(file[0])],
        max_points,
        form.point_columns,
        int(form.point_type[1:]),
        form.seconds_per_unit,
    )
    others = iter(read)
    return [_read_las(*file, max_points, form) if _is_las(file[0]) else next(others) for file in files]


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


def _is_las(path: Path) -> bool:
    return path.suffix.lower() in (".las", ".laz")


def _check_las(path: Path, max_points: int) -> None:
    check_installed(str(path), "laspy", "las")
    with _refusing(path), open_file(path) as stream:
        check_size(path, size_of(stream), max_bytes(max_points), PER_POINT)
        _check_header(path, stream, max_points)


def _read_las(path: Path, labels: Path | None, max_points: int, form: PointForm) -> core.PointCloud:
    import laspy

    with _refusing(path), open_file(path) as stream:
        # The parallel backend aborts the process when a damaged file makes two of its threads panic.
        backend = laspy.LazBackend.Lazrs
        with laspy.open(stream, read_evlrs=False, closefd=False, laz_backend=backend) as file:
            dimensions = set(file.header.point_format.dimension_names)
            fields = {
                **{axis: axis for axis in "xyz"},
                **{a: b for a, b in FIELDS.items() if a in dimensions},
            }
            chunks = []
            for chunk in file.chunk_iterator(CHUNK):
                columns = {fields[name]: np.asarray(chunk[name]) for name in fields}
                dtype = [(name, column.dtype) for name, column in columns.items()]
                chunks.append(np.rec.fromarrays(columns.values(), dtype))
    if not chunks:
        raise InputError(f"{path}: holds no points")
    contents = io.BytesIO()
    np.save(contents, np.concatenate(chunks))
    return core.parse_point_cloud(path, contents.getvalue(), labels, max_points, form.seconds_per_unit)


@contextmanager
def _refusing(path: Path) -> Iterator[None]:
    """Refuse a file for which laspy lets through errors of struct, NumPy or lazrs, or panics of lazrs."""
    try:
        yield
    except InputError:
        raise
    except BaseException as error:
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{path}: is not a readable LAS file: {reason}") from None


def _check_header(path: Path, file: BinaryIO, max_points: int) -> None:
    """Refuse wrong counts of points, records and chunks, which laspy and lazrs would trust."""
    import laspy

    start, size = file.read(START.size), size_of(file)
    if len(start) < START.size or not start.startswith(b"LASF"):
        raise InputError(f"{path}: is not a readable LAS file: it has no LAS header")
    header_bytes, offset, num_vlrs = START.unpack(start)
    if offset > size or header_bytes + num_vlrs * VLR_BYTES > offset:
        raise InputError(
            f"{path}: promises a header of {header_bytes} bytes and {num_vlrs} records before byte {offset} of {size}"
        )
    file.seek(0)
    header = laspy.LasHeader.read_from(file)
    count, record_bytes = header.point_count, header.point_format.size
    if header.are_points_compressed:
        _check_packing(path, file, header)
    if count * record_bytes > (MAX_INFLATION * size if header.are_points_compressed else size - offset):
        raise InputError(f"{path}: promises {count} points of {record_bytes} bytes in {size} bytes")
    if count > max_points:
        raise InputError(f"{path}: found {count:,} points, needed at most {max_points:,}: see --max-points")


def _check_packing(path: Path, file: BinaryIO, header: laspy.LasHeader) -> None:
    """Check LASzip's record, and the table of chunks."""
    offset, size = header.offset_to_point_data, size_of(file)
    records = header.vlrs.get("LasZipVlr")
    if not records or len(records[0].record_data) < LASZIP.size:
        raise InputError(f"{path}: is not a readable LAZ file: it has no LASzip record")
    chunk_points, num_items = LASZIP.unpack_from(records[0].record_data)
    file.seek(offset)
    (table,) = struct.unpack("<q", file.read(8))
    if not offset < table <= size - 8:
        raise InputError(f"{path}: promises a table of chunks at byte {table} of {size}")
    file.seek(table + 4)
    (num_chunks,) = struct.unpack("<I", file.read(4))
    if chunk_points < MIN_CHUNK_POINTS or num_items == 0 or num_chunks > size:
        raise InputError(
            f"{path}: promises {num_chunks} chunks of {chunk_points} points of {num_items} items in {size} bytes"
        )
