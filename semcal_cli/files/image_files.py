"""Reading and writing of images, whose sizes are read from their headers before they take any memory."""

from __future__ import annotations

import os
import re
import struct
import zlib
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TypeAlias

import numpy as np

from semcal_cli.config import MAX_PIXELS
from semcal_cli.config.file_limits import MAX_JPEG_SCANS, MAX_JPEG_SEGMENTS
from semcal_cli.errors import InputError, counted
from semcal_cli.files.input_files import check_size, open_file, size_of
from semcal_cli.files.output_files import write_bytes
from semcal_cli.geometry.arrays import Image, RawPixels

BYTES_PER_PIXEL, MORE_BYTES = 8, 1 << 24
"""Maximum size of an image file: bytes per pixel, and bytes for anything else, such as a preview."""
MAX_HEADER_BYTES = 16 << 20
"""Bytes at the start of a large file in which its header is searched for."""
PNG, JPEG, BMP = b"\x89PNG", b"\xff\xd8\xff", b"BM"
"""First bytes of the formats."""
JPEG_MARKER = re.compile(rb"\xff[\xc0-\xcf\xd9-\xfe]")
"""Markers of a JPEG before a segment, which states its length, and its end. In the data of a scan, a zero or the number
of a restart follows each byte of ones."""
JPEG_SCAN, JPEG_END = b"\xff\xda", b"\xff\xd9"
PNG_SIGNATURE_BYTES, PNG_CHUNK_BYTES = 8, 12
"""Bytes before the first chunk of a PNG, and of a chunk without its data."""
PNG_INFLATED, PNG_END = (b"zTXt", b"iTXt", b"iCCP"), b"IEND"
"""Chunks of a PNG with compressed text or a profile, and its last chunk."""
PNG_DEPTH_AT = 24
"""Place of the byte with the bits of a PNG's numbers (its first chunk, IHDR)."""
PNG_HEADER = struct.Struct(">8xI4sIIxBxB")
"""Start of a PNG with its first chunk: length and name of the chunk, width, height, kind of the pixels, and filter."""
PNG_FIRST, PNG_FILTER = (13, b"IHDR"), 0
"""The only length, name and filter that the standard allows."""
PNG_COLORS = (2, 6)
"""Kinds of pixels that are colours; those of other kinds have one number, or one and alpha."""

Size: TypeAlias = tuple[int, int]
"""Columns and rows."""


class Levels(NamedTuple):
    """The values of 16-bit images that are shown as black and as white."""

    black: int
    white: int

    def apply(self, pixels: RawPixels) -> Image:
        """Map 16-bit pixels to 8 bits: those up to `black` to 0, those from `white` to 255; 8-bit ones stay."""
        if pixels.dtype == np.uint8:
            return pixels.astype(np.uint8, copy=False)
        above = np.arange(1 << 16) - self.black
        # With all 16 bits, these are the upper 8.
        table: Image = np.clip(256 * above // (self.white + 1 - self.black), 0, 255).astype(np.uint8)
        return table[pixels]


FULL = Levels(0, (1 << 16) - 1)
"""Levels of images that use all 16 bits."""


def read_image(path: Path, size: Size | None = None, levels: tuple[int, int] | None = None) -> Image:
    """Read a colour image in 8 bits; its EXIF orientation is ignored.

    The size in its header is checked before the image is decoded.

    Args:
        path: A PNG, JPEG or BMP.
        size: Columns and rows that the image must have; None accepts any size up to `MAX_PIXELS` pixels.
        levels: Values of a 16-bit image that are shown as black and as white; None for `FULL`.

    Returns:
        (H, W, 3) blue, green, red.

    Raises:
        InputError: the file is missing, is not an image, or has another size.
    """
    return Levels(*(levels or FULL)).apply(read_pixels(path, size))


def read_pixels(path: Path, size: Size | None = None) -> RawPixels:
    """Read an image as `read_image` does, (H, W, 3) blue, green, red, in 8 bits or 16 as it is stored."""
    import cv2

    with open_file(path) as file:
        width, height = header_size = size_in_header(path, file)
        _check_pixels(path, header_size, size)
        limit = BYTES_PER_PIXEL * width * height + MORE_BYTES
        check_size(path, size_of(file), limit, f" for {width} x {height} pixels")
        content = file.read(size_of(file))
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    image = decode_image(path, content, flags)
    if image is None or image.shape[1::-1] != header_size:
        raise _damage_error(path)
    return image


def decode_image(path: Path, content: bytes, flags: int) -> RawPixels | None:
    """Decode an image whose size was checked; None if it is damaged.

    Args:
        path: Name of the file in messages.
        content: Its bytes.
        flags: How OpenCV reads it.

    Raises:
        InputError: decoding would take longer, or more memory, than its size says.
    """
    import cv2

    if content.startswith(JPEG):
        _check_scans(path, content)
    elif content.startswith(PNG):
        if (plain := _checked_png(content)) is None:
            return None
        content = plain
    pixels: Any = None
    with suppress(cv2.error):
        pixels = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), flags)
    return None if pixels is None else np.asarray(pixels)


def _check_scans(path: Path, content: bytes) -> None:
    """Check the number of scans of a JPEG up to its end; segments may hold previews, and a video may follow.

    Raises:
        InputError: it has too many scans or segments.
    """
    num_scans = num_segments = 0
    found = JPEG_MARKER.search(content)
    while found is not None and found[0] != JPEG_END:
        num_scans += found[0] == JPEG_SCAN
        num_segments += 1
        if num_scans > MAX_JPEG_SCANS:
            raise InputError(
                f"{path}: found a JPEG of {num_scans} or more scans, needed at most {MAX_JPEG_SCANS}"
            )
        if num_segments > MAX_JPEG_SEGMENTS:
            most = f"{MAX_JPEG_SEGMENTS:,}"
            raise InputError(f"{path}: found a JPEG of more than {most} segments, needed at most {most}")
        # The length counts its own two bytes.
        length = int.from_bytes(content[found.end() : found.end() + 2], "big")
        found = JPEG_MARKER.search(content, found.end() + max(2, length))


def _checked_png(content: bytes) -> bytes | None:
    """Leave out the chunks of a PNG that inflate to anything, and that no image needs; what follows its end, too.

    None if there is no end, if a chunk states more bytes than there are, which OpenCV would allocate, or if a checksum
    is wrong, of which libpng would print a line.
    """
    kept, place, start, kind = [], PNG_SIGNATURE_BYTES, 0, b""
    pieces = memoryview(content)
    while kind != PNG_END:
        end = place + PNG_CHUNK_BYTES + int.from_bytes(content[place : place + 4], "big")
        if end > len(content):
            return None
        kind = content[place + 4 : place + 8]
        is_intact = zlib.crc32(pieces[place + 4 : end - 4]) == int.from_bytes(content[end - 4 : end], "big")
        if not is_intact and kind[:1].isupper():
            return None
        if not is_intact or kind in PNG_INFLATED:
            kept.append(content[start:place])
            start = end
        place = end
    return b"".join([*kept, content[start:place]])


def has_16_bits(path: Path) -> bool:
    """Return whether a file is a PNG of 16-bit numbers.

    Raises:
        InputError: the file is missing.
    """
    with open_file(path) as file:
        start = file.read(PNG_DEPTH_AT + 1)
    return start.startswith(PNG) and start[PNG_DEPTH_AT:] == b"\x10"


def check_image(path: Path, size: Size) -> None:
    """Check the columns and rows of an image by its header, without decoding it.

    Raises:
        InputError: the file is missing, is not an image, or has another size.
    """
    _check_pixels(path, read_size(path), size)


def read_size(path: Path) -> Size:
    """Read the columns and rows of a PNG, JPEG or BMP from its header.

    Raises:
        InputError: the file is missing or is not an image.
    """
    with open_file(path) as file:
        return size_in_header(path, file)


def size_in_header(path: Path, file: BinaryIO) -> Size:
    """Read the columns and rows from the header of an open file, and go back to its start.

    Raises:
        InputError: the file is not an image.
    """
    num_bytes = file.seek(0, os.SEEK_END)
    file.seek(0)
    start = file.read(len(PNG))
    if not start.startswith((PNG, JPEG, BMP)):
        description = f"{counted(num_bytes, 'byte')} of an unknown format"
        raise InputError(f"{path}: found {description}, expected a PNG, JPEG or BMP")
    file.seek(0)
    # An endless header would take memory and time.
    head = file if num_bytes <= MAX_HEADER_BYTES else BytesIO(file.read(MAX_HEADER_BYTES))
    try:
        size = _parse_header(head, start)
    except Exception:  # Pillow lets errors of any kind through, such as struct's.
        raise _damage_error(path) from None
    if 0 in size:
        raise _damage_error(path)
    file.seek(0)
    return size


def holds_colors(path: Path) -> bool:
    """Return whether a label image is a PNG of colours, whose pixels are not ids.

    Raises:
        InputError: the file is missing or cannot be read.
    """
    with open_file(path) as file:
        start = file.read(PNG_HEADER.size)
    with suppress(ValueError, struct.error):
        return start.startswith(PNG) and _parse_png(start)[1]
    return False


def write_image(image: Image, path: Path) -> None:
    """Write a PNG as a whole or not at all: to a temporary file next to it, which is then renamed.

    Args:
        image: (H, W) grey, or (H, W, 3) blue, green, red.
        path: File to write; its suffix is .png.

    Raises:
        InputError: the suffix is not .png, or the file cannot be written. An existing file is then untouched.
    """
    import cv2

    if path.suffix.lower() != ".png":
        raise InputError(f"{path}: found suffix {path.suffix!r}, expected .png")
    _, content = cv2.imencode(".png", image)
    write_bytes(content.tobytes(), path)


def _check_pixels(path: Path, size: Size, needed: Size | None) -> None:
    width, height = size
    if needed is not None and size != needed:
        raise InputError(f"{path}: found {width} x {height} pixels, needed {needed[0]} x {needed[1]}")
    if width * height > MAX_PIXELS:
        raise InputError(f"{path}: found {width:,} x {height:,} pixels, needed at most {MAX_PIXELS:,}")


def _damage_error(path: Path) -> InputError:
    return InputError(f"{path}: found a damaged image, expected an intact one")


def _parse_header(head: BinaryIO, start: bytes) -> Size:
    """Parse a header, by Pillow where it is long; `PIL.Image.open` warns of sizes that `MAX_PIXELS` limits here."""
    if start.startswith(PNG):
        return _parse_png(head.read(PNG_HEADER.size))[0]
    from PIL import BmpImagePlugin, JpegImagePlugin  # takes 9 ms

    open_image = JpegImagePlugin.JpegImageFile if start.startswith(JPEG) else BmpImagePlugin.BmpImageFile
    return open_image(head).size


def _parse_png(start: bytes) -> tuple[Size, bool]:
    """Parse the start of a PNG: its size, and whether its pixels are colours."""
    *first, width, height, kind, used_filter = PNG_HEADER.unpack(start)
    if (*first,) != PNG_FIRST or used_filter != PNG_FILTER:
        raise ValueError
    return (width, height), kind in PNG_COLORS
