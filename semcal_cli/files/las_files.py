"""Reading of LAS and LAZ by laspy, the extra `las`, after a check of what their headers promise."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from semcal_cli.errors import InputError, describe
from semcal_cli.files.input_files import size_of
from semcal_cli.geometry.arrays import Array

if TYPE_CHECKING:
    import laspy

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
FIELDS = {"intensity": "intensity", "gps_time": "time", "classification": "label"}
"""Fields of a LAS file that are used in addition to the coordinates, with their names in a cloud."""
OWN_COLUMN = "dimension {}"
"""Name of the column with the dimension that tells the LiDAR's own points: one of no other meaning."""


def check_las(path: Path, file: BinaryIO, max_points: int) -> None:
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


def read_las(path: Path, file: BinaryIO, own: str | None = None) -> Array:
    """Read the points of a checked file as records, with the dimension `own` in OWN_COLUMN, if it is given.

    Raises:
        InputError: the file holds no points, or has no such dimension of one number.
    """
    import laspy

    # The parallel backend aborts the process when a damaged file makes two of its threads panic.
    backend = laspy.LazBackend.Lazrs
    with laspy.open(file, read_evlrs=False, closefd=False, laz_backend=backend) as reader:
        point_format = reader.header.point_format
        dimensions = list(point_format.dimension_names)
        sources = {axis: axis for axis in "xyz"}
        sources |= {name: field for field, name in FIELDS.items() if field in dimensions}
        if own is not None:
            sources[OWN_COLUMN.format(own)] = source = _find(path, own, dimensions)
            if source in dimensions and point_format.dimension_by_name(source).num_elements != 1:
                raise InputError(f"{path}: field {describe(source)} is not a single number")
        chunks = []
        for chunk in reader.chunk_iterator(CHUNK):
            columns = {name: np.asarray(chunk[field]) for name, field in sources.items()}
            dtype = [(name, column.dtype) for name, column in columns.items()]
            chunks.append(np.rec.fromarrays(columns.values(), dtype))
    if not chunks:
        raise InputError(f"{path}: holds no points")
    return np.concatenate(chunks)


def _find(path: Path, own: str, dimensions: Sequence[str]) -> str:
    """Find a dimension, in any case; x, y and z are the coordinates, in metres."""
    if matches := [name for name in ("x", "y", "z", *dimensions) if name.lower() == own.lower()]:
        return own if own in matches else matches[0]
    raise InputError(
        f"{path}: found the fields {' '.join(dimensions)}, expected {describe(own)} among them, which "
        "lidar.own_points states (--own-points at import)"
    )


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
