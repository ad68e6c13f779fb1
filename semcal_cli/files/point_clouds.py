"""Reading of point clouds: laspy, the extra `las`, reads LAS and LAZ; the core reads all other formats."""

from __future__ import annotations

import io
import os
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from semcal_cli import _core
from semcal_cli.config import MAX_POINTS
from semcal_cli.errors import InputError, check_installed
from semcal_cli.files.reading import check_size, open_file, size_of

if TYPE_CHECKING:
    import laspy

BYTES_A_POINT = 64
"""Bytes that a point may take in a file; see `rust/point_cloud/limit.rs`."""
A_POINT = f", {BYTES_A_POINT} a point: see --max-points"
"""Words that say what a limit in bytes applies to."""
LEAST_BYTES = 1 << 20
"""Bytes that any file may have."""
CHUNK = 1_000_000
"""Points unpacked at a time, so that a header that promises too many costs nothing."""
MAX_INFLATION = 100
"""Largest growth of a LAZ file when it is unpacked; a factor of ten is common."""
START = struct.Struct("<94xHII")
"""Start of a header: its size, the offset of the points, and the number of VLRs."""
VLR_BYTES = 54
"""Size of the header of a VLR."""
LASZIP = struct.Struct("<12xI16xH")
"""LASzip's record: points in a chunk, and items in a point."""
MIN_CHUNK_POINTS = 100
"""Least number of points in a chunk; smaller chunks make more table than data."""

FIELDS = {"intensity": "intensity", "gps_time": "time", "classification": "label"}
"""Fields of a LAS file that are used beside the place, with their names in a cloud."""


def read_point_clouds(
    files: Sequence[tuple[Path, Path | None]], max_points: int = MAX_POINTS
) -> list[_core.PointCloud]:
    """Read sweeps, each with its file of labels, or else with its own field of labels, if it has one.

    The sizes of all files are judged before the first is read.

    Args:
        files: The files of each sweep.
        max_points: Points of the largest sweep that is read, no-returns included.

    Raises:
        InputError: a file cannot be read, is too large, is not what its name says, or has another number of points
            than labels.
    """
    for points, _ in files:
        if _is_las(points):
            _check_las(points, max_points)
    others = iter(_core.read_point_clouds([file for file in files if not _is_las(file[0])], max_points))
    return [_read_las(*file, max_points) if _is_las(file[0]) else next(others) for file in files]


def max_bytes(max_points: int) -> int:
    """Size of the largest file of a sweep, or of labels or features of its points."""
    return max(BYTES_A_POINT * max_points, LEAST_BYTES)


class Sweeps:
    """Reads each sweep with its labels once, for all cameras and cues, and keeps it."""

    def __init__(self) -> None:
        self._clouds: dict[tuple[str, str | None], _core.PointCloud] = {}

    def read(
        self, files: Sequence[tuple[Path, Path | None]], max_points: int = MAX_POINTS
    ) -> list[_core.PointCloud]:
        """Read sweeps as `read_point_clouds` does, with the same arguments and errors."""
        keys = [
            (os.path.realpath(points), None if labels is None else os.path.realpath(labels))
            for points, labels in files
        ]
        missing = {key: file for key, file in zip(keys, files, strict=True) if key not in self._clouds}
        self._clouds.update(zip(missing, read_point_clouds(list(missing.values()), max_points), strict=True))
        return [self._clouds[key] for key in keys]

    @property
    def num_different(self) -> int:
        """Number of different clouds read; a cloud with labels for each camera counts once for each."""
        return len({points for points, _ in self._clouds})


def _is_las(path: Path) -> bool:
    return path.suffix.lower() in (".las", ".laz")


def _check_las(path: Path, max_points: int) -> None:
    check_installed(str(path), "laspy", "las")
    with _refusing(path), open_file(path) as stream:
        check_size(path, size_of(stream), max_bytes(max_points), A_POINT)
        _check_header(path, stream, max_points)


def _read_las(path: Path, labels: Path | None, max_points: int) -> _core.PointCloud:
    import laspy

    with _refusing(path), open_file(path) as stream:
        # The parallel one aborts the process where a damaged file makes two of its threads panic.
        backend = laspy.LazBackend.Lazrs
        with laspy.open(stream, read_evlrs=False, closefd=False, laz_backend=backend) as file:
            known = set(file.header.point_format.dimension_names)
            fields = {**{axis: axis for axis in "xyz"}, **{a: b for a, b in FIELDS.items() if a in known}}
            chunks = []
            for chunk in file.chunk_iterator(CHUNK):
                columns = {fields[name]: np.asarray(chunk[name]) for name in fields}
                dtype = [(name, column.dtype) for name, column in columns.items()]
                chunks.append(np.rec.fromarrays(columns.values(), dtype))
    if not chunks:
        raise InputError(f"{path}: holds no points")
    contents = io.BytesIO()
    np.save(contents, np.concatenate(chunks))
    return _core.parse_point_cloud(path, contents.getvalue(), labels, max_points)


@contextmanager
def _refusing(path: Path) -> Iterator[None]:
    """Refuse a file where laspy lets errors of struct, NumPy and lazrs through, and panics of lazrs."""
    try:
        yield
    except InputError:
        raise
    except BaseException as error:
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{path}: is no readable LAS: {reason}") from None


def _check_header(path: Path, file: BinaryIO, max_points: int) -> None:
    """Refuse counts of points, records and chunks that laspy and lazrs would trust."""
    import laspy

    start, size = file.read(START.size), size_of(file)
    if len(start) < START.size or not start.startswith(b"LASF"):
        raise InputError(f"{path}: is no readable LAS: it does not start like one")
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
        raise InputError(f"{path}: is no readable LAZ: it has no record of LASzip's")
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
