"""E57 files for tests, whole and hostile ones."""

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

PAGE_BYTES, CONTENT_BYTES = 1024, 1020
CASTAGNOLI = 0x82F63B78
"""Polynomial of the checksum of a page, CRC-32C, with its bits reversed."""

Node = Callable[[Any], Any]
"""Makes the node of a field in an image file of libE57."""


def write_e57(cloud: np.ndarray, path: Path) -> Path:
    """Write a scan with a pose, colours and the rows of a grid; no returns have coordinates, too."""
    pye57 = pytest.importorskip("pye57")
    is_no_return = ~np.stack([cloud[axis] != 0 for axis in "xyz"]).any(axis=0)
    columns = {f"cartesian{axis.upper()}": np.where(is_no_return, 7, cloud[axis]) for axis in "xyz"}
    columns |= {"intensity": cloud["intensity"], "cartesianInvalidState": is_no_return.astype(int)}
    columns |= {f"color{name}": np.arange(len(cloud)) for name in ("Red", "Green", "Blue")}
    columns |= {"rowIndex": np.arange(len(cloud)) % 4, "columnIndex": np.arange(len(cloud)) // 4}
    with pye57.E57(str(path.with_suffix(".e57")), "w") as file:
        file.write_scan_raw(columns, rotation=np.array([0, 0, 0, 1.0]), translation=np.array([5, 6, 7.0]))
    return path.with_suffix(".e57")


def write_scans(path: Path, *scans: dict[str, tuple[Node, np.ndarray]]) -> Path:
    """Write scans by the nodes of their fields in the prototype, and the values."""
    pye57, libe57 = pytest.importorskip("pye57"), pytest.importorskip("pye57.libe57")
    with pye57.E57(str(path), "w") as file:
        image = file.image_file
        for fields in scans:
            prototype, buffers = libe57.StructureNode(image), libe57.VectorSourceDestBuffer()
            for name, (node, values) in fields.items():
                prototype.set(name, node(image))
                buffers.append(libe57.SourceDestBuffer(image, name, values, len(values), True, True))
            points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
            scan = libe57.StructureNode(image)
            scan.set("points", points)
            file.data3d.append(scan)
            writer = points.writer(buffers)
            writer.write(len(values))
            writer.close()
    return path


def content_of(whole: bytes) -> bytes:
    """Return the content of a file without checksums."""
    return b"".join(whole[i : i + CONTENT_BYTES] for i in range(0, len(whole), PAGE_BYTES))


def paged(content: bytes) -> bytes:
    """Fill up the last page of a content, and add the checksums."""
    content = bytes(content) + bytes(-len(content) % CONTENT_BYTES)
    pages = [content[i : i + CONTENT_BYTES] for i in range(0, len(content), CONTENT_BYTES)]
    return b"".join(page + struct.pack(">I", _checksum(page)) for page in pages)


def edit_xml(path: Path, edit: Callable[[bytes], bytes]) -> None:
    """Replace the XML of a file, which is at its end."""
    content = bytearray(content_of(path.read_bytes()))
    place, length = struct.unpack_from("<QQ", content, 24)
    start = place // PAGE_BYTES * CONTENT_BYTES + place % PAGE_BYTES
    xml = edit(bytes(content[start : start + length]))
    content[start:] = xml
    size = -(-len(content) // CONTENT_BYTES) * PAGE_BYTES
    struct.pack_into("<QQQ", content, 16, size, place, len(xml))
    path.write_bytes(paged(content))


def _checksum(page: bytes) -> int:
    remainder = 0xFFFFFFFF
    for byte in page:
        remainder = remainder >> 8 ^ TABLE[(remainder ^ byte) & 255]
    return remainder ^ 0xFFFFFFFF


def _entry(remainder: int) -> int:
    for _ in range(8):
        remainder = remainder >> 1 ^ CASTAGNOLI * (remainder & 1)
    return remainder


TABLE = [_entry(byte) for byte in range(256)]
