"""The size of a picture as the header of its file states it, before the picture takes any memory."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, NamedTuple, TypeAlias

from semcal_cli.errors import InputError
from semcal_cli.files.reading import open_file, size_of

MAGIC_BYTES = 4
"""Bytes by which a format is recognised."""
PNG = b"\x89PNG"
PNG_HEADER = struct.Struct(">8x4x4sIIxB")
"""Signature, and length, name, width, height and type of the colours of the first chunk."""
TRUE_COLORS = (2, 6)
"""Types of PNG with colours, without and with alpha. The other types have one number a pixel."""
BMP_HEADER = struct.Struct("<14xI8x")
"""Header of the file, and the size of the header of the picture, with the width and height that follow."""
OLD_BMP_BYTES = 12
"""Size of the oldest header of a picture, with sides of two bytes."""
SEGMENT = struct.Struct(">HBHH")
"""Start of a segment of JPEG: length, and in one that states the size, bits, height and width."""
FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
"""Markers of JPEG's segments that state the size of the picture."""
WITHOUT_LENGTH = {0x01, *range(0xD0, 0xD8)}
"""Markers of JPEG that are no segments."""
END, SCAN = 0xD9, 0xDA
"""Markers of JPEG after which no size follows."""

MAX_SEGMENTS, MAX_REST_BYTES = 10_000, 1 << 12
"""Most segments of a JPEG before its size, and most bytes between segments, which are skipped."""
MAX_PIXELS = 100_000_000
"""Most pixels of a picture."""

Size: TypeAlias = tuple[int, int]
"""Columns and rows."""


def read_size(path: Path) -> Size:
    """Read the columns and rows of a PNG, JPEG or BMP from its header.

    Raises:
        InputError: the file is missing, or is not an image.
    """
    with open_file(path) as file:
        return stated_size(path, file)


def stated_size(path: Path, file: BinaryIO) -> Size:
    """Read the columns and rows from the header of an open file, which is left at its start.

    Raises:
        InputError: the file is not an image.
    """
    start = file.read(MAGIC_BYTES)
    read = next((read for magic, read in _READERS.items() if start.startswith(magic)), None)
    if read is None:
        found = f"{size_of(file):,} bytes of no known format"
        raise InputError(f"{path}: found {found}, needed a PNG, JPEG or BMP")
    file.seek(0)
    size = read(file)
    file.seek(0)
    if size is None:
        raise damaged_picture(path)
    return size


def holds_colors(path: Path) -> bool:
    """Tell whether a label image is a PNG of colours, whose pixels are not ids.

    Raises:
        InputError: the file is missing, or cannot be read.
    """
    with open_file(path) as file:
        header = _png_header(file)
    return header is not None and header.color_type in TRUE_COLORS


def damaged_picture(path: Path) -> InputError:
    """Make the error of a picture that cannot be decoded."""
    return InputError(f"{path}: found a damaged picture, needed a whole one")


class _PngHeader(NamedTuple):
    size: Size
    color_type: int


def _png_header(file: BinaryIO) -> _PngHeader | None:
    start = file.read(PNG_HEADER.size)
    if len(start) < PNG_HEADER.size or not start.startswith(PNG):
        return None
    name, width, height, color_type = PNG_HEADER.unpack(start)
    return _PngHeader((width, height), color_type) if name == b"IHDR" else None


def _png(file: BinaryIO) -> Size | None:
    header = _png_header(file)
    return None if header is None else header.size


def _bmp(file: BinaryIO) -> Size | None:
    header = file.read(BMP_HEADER.size)
    if len(header) < BMP_HEADER.size:
        return None
    (header_bytes,) = BMP_HEADER.unpack(header)
    layout = "<HH" if header_bytes == OLD_BMP_BYTES else "<ii"
    width, height = struct.unpack_from(layout, header, 18)
    return width, abs(height)  # Rows from the top down have a negative height.


def _jpeg(file: BinaryIO) -> Size | None:
    """Go from segment to segment, past pictures of preview inside them, to the one that states the size."""
    file.seek(2)
    for _ in range(MAX_SEGMENTS):
        marker = _next_marker(file)
        if marker is None or marker in (END, SCAN):
            return None
        if marker in WITHOUT_LENGTH:
            continue
        segment = file.read(SEGMENT.size)
        if len(segment) < SEGMENT.size:
            return None
        length, _, height, width = SEGMENT.unpack(segment)
        if marker in FRAMES:
            return width, height
        if length < 2:
            return None
        file.seek(length - SEGMENT.size, os.SEEK_CUR)
    return None


def _next_marker(file: BinaryIO) -> int | None:
    """Read the marker that begins the next segment of a JPEG, after any bytes that belong to none."""
    before = b""
    for _ in range(MAX_REST_BYTES):
        byte = file.read(1)
        if not byte:
            return None
        if before == b"\xff" and byte not in (b"\xff", b"\0"):
            return byte[0]
        before = byte
    return None


_READERS: dict[bytes, Callable[[BinaryIO], Size | None]] = {
    PNG: _png,
    b"\xff\xd8\xff": _jpeg,
    b"BM": _bmp,
}
"""Readers of the formats' headers by the first bytes of their files."""
