"""All columns of a binary PLY's vertices, for KITTI-360, whose windows also tell which points the images show.

The core reads the clouds of a drive. This module reads only PLY files as KITTI-360 writes them, with the vertices first
and without lists (Turk, *The PLY Polygon File Format*, 1994).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from semcal_cli.errors import InputError, listed
from semcal_cli.files.reading import read_bytes, read_start

END = re.compile(rb"\nend_header\r?\n")
MAX_HEADER = 65536
MAX_BYTES = 512 << 20
"""Largest size of a file."""
FORMATS = {"binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}


def read_vertices(path: Path) -> npt.NDArray[Any]:
    """Read the vertices as a structured array (N,).

    Raises:
        InputError: the file does not exist, is too short, or does not begin with vertices of plain numbers.
    """
    start = read_start(path, MAX_HEADER)
    end = END.search(start)
    if not start.startswith(b"ply") or not end:
        raise InputError(f"{path}: found no PLY header, needed one")
    count, dtype = _parse_header(path, start[: end.start()].decode("latin-1").splitlines())
    body = memoryview(read_bytes(path, limit=MAX_BYTES))[end.end() :]
    if count * dtype.itemsize > len(body):
        raise InputError(f"{path}: found {len(body):,} bytes after the header, needed {count:,} vertices")
    return np.frombuffer(body, dtype, count)


def vertex_column(path: Path, vertices: npt.NDArray[Any], name: str, dtype: type) -> npt.NDArray[Any]:
    """Read one property of all vertices, (N,).

    Raises:
        InputError: the vertices have no such property.
    """
    names = vertices.dtype.names or ()
    if name not in names:
        raise InputError(f"{path}: found properties {listed(names)}, needed {name}")
    return vertices[name].astype(dtype)


def _parse_header(path: Path, lines: list[str]) -> tuple[int, np.dtype[Any]]:
    """Read the number and the layout of the vertices."""
    words = [line.split() for line in lines[1:]]
    form = next((line[1] for line in words if line[:1] == ["format"] and len(line) == 3), "none")
    if form not in FORMATS:
        raise InputError(f"{path}: found format {form[:40]}, needed one of: {', '.join(FORMATS)}")
    elements = [index for index, line in enumerate(words) if line[:1] == ["element"]]
    first = words[elements[0]] if elements else []
    if len(first) != 3 or first[1] != "vertex" or not first[2].isascii() or not first[2].isdigit():
        raise InputError(
            f"{path}: found first element {' '.join(first[1:])[:40] or 'none'}, needed vertex and its number"
        )
    last = elements[1] if len(elements) > 1 else len(words)
    properties = [line for line in words[elements[0] : last] if line[:1] == ["property"]]
    if not properties or any(len(line) != 3 or line[1] not in TYPES for line in properties):
        raise InputError(f"{path}: found vertices without properties or with lists, needed plain numbers")
    names = [line[2] for line in properties]
    if len(set(names)) < len(names):
        raise InputError(f"{path}: found a property twice in {listed(names)}, needed each once")
    return (
        int(first[2][:18]),
        np.dtype([(n, FORMATS[form] + TYPES[p[1]]) for n, p in zip(names, properties, strict=True)]),
    )
