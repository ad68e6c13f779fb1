"""Compressed bytes, unpacked up to a limit: a recording of some kilobytes can unpack to any size."""

from __future__ import annotations

from bz2 import BZ2Decompressor
from pathlib import Path

from lz4.frame import LZ4FrameDecompressor
from zstandard import CONTENTSIZE_UNKNOWN, ZstdDecompressor, ZstdError, get_frame_parameters

from semcal_cli.config.file_limits import (
    MAX_READ_RATIO,
    MAX_UNPACKED_BYTES,
    MIN_READ_BYTES,
    MIN_READ_RECORDS,
)
from semcal_cli.errors import InputError

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
"""First bytes of data compressed by Zstandard."""


class Meter:
    """Counts what is read of a file of a recording in all, so that a small file cannot be read for ever."""

    def __init__(self, path: Path, num_bytes: int) -> None:
        """Start at nothing, for a file of so many bytes."""
        self._path, self._bytes, self._records = path, 0, 0
        self._max_bytes = max(MAX_READ_RATIO * num_bytes, MIN_READ_BYTES)
        self._max_records = max(num_bytes // 4, MIN_READ_RECORDS)

    def add(self, num_bytes: int, num_records: int = 1) -> None:
        """Count bytes and records that are read.

        Raises:
            InputError: they are too many for the file.
        """
        self._bytes += num_bytes
        self._records += num_records
        if self._bytes > self._max_bytes:
            raise self._error(f"data that unpack to more than {self._max_bytes:,} bytes")
        if self._records > self._max_records:
            raise self._error(f"more than {self._max_records:,} records")

    def _error(self, found: str) -> InputError:
        return InputError(f"{self._path}: found {found}, needed fewer in a recording of this size")


def unpack(compression: str, packed: bytes, max_bytes: int = MAX_UNPACKED_BYTES) -> bytes:
    """Unpack the bytes of a chunk or of a message.

    Args:
        compression: `zstd`, `lz4`, `bz2`, or empty or `none` for bytes that are not compressed.
        packed: The bytes.
        max_bytes: Largest size of the unpacked bytes.

    Raises:
        ValueError: there are more, they are cut off, or the compression is unknown; the libraries raise errors of
            other kinds for damaged bytes.
    """
    match compression:
        case "" | "none":
            return packed
        case "zstd":
            return _unpack_zstd(packed, max_bytes)
        case "lz4" | "bz2":
            decompressor = LZ4FrameDecompressor() if compression == "lz4" else BZ2Decompressor()
            unpacked: bytes = decompressor.decompress(packed, max_bytes + 1)
            if len(unpacked) > max_bytes:
                raise _too_many(max_bytes)
            if not decompressor.eof:
                raise ValueError("found compressed data that are cut off")
            return unpacked
    raise ValueError(f"found the compression {compression[:40]!r}, expected zstd, lz4 or bz2")


def _unpack_zstd(packed: bytes, max_bytes: int) -> bytes:
    stated = get_frame_parameters(packed).content_size
    if stated != CONTENTSIZE_UNKNOWN and stated > max_bytes:
        raise _too_many(max_bytes)
    try:
        return ZstdDecompressor().decompress(packed, max_output_size=max_bytes)
    except ZstdError:
        raise ValueError(
            f"found compressed data that are damaged, cut off, or more than {max_bytes:,} bytes"
        ) from None


def _too_many(max_bytes: int) -> ValueError:
    return ValueError(f"found data that unpack to more than {max_bytes:,} bytes")
