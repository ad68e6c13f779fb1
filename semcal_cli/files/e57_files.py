"""Reading of E57 (ASTM E2807) by pye57, the extra `e57`, after a check of the header and of the XML.

A file is made of pages, each with a checksum. Its XML describes scans, and names the place of their packed points.
Points are in the frame of their scanner: the pose of a scan, which places it among others, is not used.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO
from xml.parsers import expat

import numpy as np

from semcal_cli.config.file_limits import MAX_DOCUMENT_BYTES, MAX_E57_ELEMENTS
from semcal_cli.errors import InputError, counted, describe
from semcal_cli.files.input_files import check_size, size_of
from semcal_cli.files.yaml_values import MAX_DEPTH
from semcal_cli.geometry.arrays import Array

SIGNATURE = b"ASTM-E57"
HEADER = struct.Struct("<8s8xQQQQ")
"""Signature, size of the file, place of the XML, its size without checksums, and size of a page."""
PAGE_BYTES, CONTENT_BYTES = 1024, 1020
"""Size of a page, and without its checksum."""
SYSTEMS = {
    "cartesian": ("cartesianX", "cartesianY", "cartesianZ"),
    "spherical": ("sphericalRange", "sphericalAzimuth", "sphericalElevation"),
}
"""Fields of a point in either coordinate system; metres and radians."""
FIELDS = {"intensity": ("intensity", "f4"), "timeStamp": ("time", "f8")}
"""Fields that are used in addition to the coordinates, with their names and types in a cloud. Rows of a scanner's grid
are no rings of a LiDAR: a grid has thousands of them, and the search for a scan pattern does without."""
FLAGS = {"intensity": "isIntensityInvalid", "time": "isTimeStampInvalid"}
"""Fields that are not zero where the value of a column means nothing."""


def check_e57(path: Path, file: BinaryIO, max_points: int) -> None:
    """Refuse a file that is cut off, XML that takes libE57 long or makes it open other files, and too many points."""
    _check_xml(path, _read_xml(path, file))
    with _opened(path) as (_, points):
        if (count := points.childCount()) < 0:
            raise InputError(f"{path}: promises {count:,} points: it is damaged")
        if count > max_points:
            raise InputError(
                f"{path}: found {count:,} points, needed at most {max_points:,}: see --max-points"
            )


def read_e57(path: Path, _: BinaryIO, own: str | None = None) -> Array:
    """Read the points of a checked file as records: zeros where nothing returned, NaN for other invalid values.

    A column without a valid value is left out. `own` adds no column to x, y, z, intensity and time.
    """
    from numpy.lib.recfunctions import repack_fields  # which loads masked arrays
    from pye57 import libe57

    with _opened(path) as (image, points):
        prototype, count = libe57.StructureNode(points.prototype()), points.childCount()
        system = next(
            (name for name, axes in SYSTEMS.items() if all(prototype.isDefined(axis) for axis in axes)), None
        )
        if system is None:
            needed = ", or ".join(", ".join(axes) for axes in SYSTEMS.values())
            raise InputError(f"{path}: found points without coordinates, expected the fields {needed}")
        if count == 0:
            raise InputError(f"{path}: holds no points")
        # libE57 refuses to make floats of infinite doubles, which are no returns.
        axes = {axis: (name, "f8") for axis, name in zip(SYSTEMS[system], "xyz", strict=True)}
        flags = {flag: (flag, "i2") for flag in FLAGS.values()}
        fields = {**axes, **FIELDS, **flags, f"{system}InvalidState": ("state", "i2")}
        fields = {field: column for field, column in fields.items() if prototype.isDefined(field)}
        records: Array = np.zeros(count, list(fields.values()))
        buffers = libe57.VectorSourceDestBuffer()
        for field, (name, _type) in fields.items():
            column = (records[name], count, True, True, records.itemsize)
            buffers.append(libe57.SourceDestBuffer(image, field, *column))
        if (found := points.reader(buffers).read()) != count:
            raise InputError(f"{path}: promises {count:,} points, holds {found:,}")
    if system == "spherical":
        records["x"], records["y"], records["z"] = _cartesian(records["x"], records["y"], records["z"])
    if f"{system}InvalidState" in fields:
        for name in "xyz":
            records[name][records["state"] != 0] = 0
    names = [name for name, _type in fields.values()]
    for name, flag in FLAGS.items():
        if name in names and flag in names:
            is_invalid = records[flag] != 0
            records[name][is_invalid] = np.nan
            if is_invalid.all():
                names.remove(name)
    return repack_fields(records[names])


def _cartesian(distance: Array, azimuth: Array, elevation: Array) -> tuple[Array, Array, Array]:
    """Convert coordinates as the standard defines them: from x towards y, and up from their plane."""
    with np.errstate(invalid="ignore"):  # An infinite coordinate is no return.
        over_ground = distance * np.cos(elevation)
        return over_ground * np.cos(azimuth), over_ground * np.sin(azimuth), distance * np.sin(elevation)


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, Any]]:
    """Open a file with the points of its only scan."""
    from pye57 import libe57

    image = libe57.ImageFile(os.fsencode(path), "r")
    try:
        root = image.root()
        scans: Any = root["data3D"] if root.isDefined("data3D") else ()
        if len(scans) != 1:
            advice = (
                ": write each scan to a file of its own, in the frame of its scanner" if len(scans) else ""
            )
            raise InputError(f"{path}: found {counted(len(scans), 'scan')}, needed one{advice}")
        yield image, scans[0]["points"]
    finally:
        image.close()


def _read_xml(path: Path, file: BinaryIO) -> bytes:
    """Read the XML without its checksums, which libE57 tests."""
    start, size = file.read(HEADER.size), size_of(file)
    if len(start) < HEADER.size or not start.startswith(SIGNATURE):
        raise InputError(f"{path}: is not a readable E57 file: it has no E57 header")
    _, stated, place, length, page_bytes = HEADER.unpack(start)
    if stated != size:
        raise InputError(
            f"{path}: promises {stated:,} bytes, has {size:,}: it is damaged, or not all of it is here"
        )
    if page_bytes != PAGE_BYTES or place + length > size:
        raise InputError(
            f"{path}: promises XML of {length:,} bytes at byte {place:,} of {size:,}, in pages of {page_bytes:,}: "
            "it is damaged"
        )
    check_size(path, length, MAX_DOCUMENT_BYTES, " of XML")
    first, skipped = divmod(place, PAGE_BYTES)
    file.seek(first * PAGE_BYTES)
    pages = file.read((skipped + length) // CONTENT_BYTES * PAGE_BYTES + PAGE_BYTES)
    contents = [pages[page : page + CONTENT_BYTES] for page in range(0, len(pages), PAGE_BYTES)]
    return b"".join(contents)[skipped : skipped + length]


def _check_xml(path: Path, content: bytes) -> None:
    """Refuse XML for which libE57 would open other files or addresses, or whose size and depth cost it minutes."""
    parser = expat.ParserCreate(encoding="utf-8")
    num_elements = depth = 0

    def declare(version: str, encoding: str | None, standalone: int) -> None:
        if encoding is not None and encoding.upper() != "UTF-8":
            raise InputError(f"{path}: found XML in {describe(encoding)}, expected UTF-8")

    def begin_doctype(*_: object) -> None:
        raise InputError(f"{path}: found <!DOCTYPE, expected XML without declarations")

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal num_elements, depth
        num_elements, depth = num_elements + 1, depth + 1
        if any(key.lower().endswith("schemalocation") for key in attributes):
            raise InputError(f"{path}: found an external schema of its XML, expected none")
        if num_elements > MAX_E57_ELEMENTS or depth > MAX_DEPTH:
            raise InputError(
                f"{path}: found XML of more elements, needed at most {MAX_E57_ELEMENTS:,}, in {MAX_DEPTH} levels"
            )

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    parser.XmlDeclHandler, parser.StartDoctypeDeclHandler = declare, begin_doctype
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise InputError(
            f"{path}: line {error.lineno} of its XML is not well-formed: it is damaged"
        ) from None
