"""Writes a small valid file of each kind for the fuzz targets to start from."""

import io
import struct
from pathlib import Path

import numpy as np

CORPUS = Path(__file__).parent / "corpus"
RECORD = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f8"), ("label", "<u2"), ("t", "<u4"), ("ring", "u1")])
CLOUD = np.array(
    [(1, 2, 3, 4, 5, 6), (0, 0, 0, 0, 0, 0), (np.nan, 1, 1, 1, 1, 1), (7, 8, 9, 1, 2, 3)], RECORD
)
TEXT = b"\n".join(b" ".join(str(value).encode() for value in row.tolist()) for row in CLOUD) + b"\n"
PLY_TYPES = {"f4": "float", "f8": "double", "u2": "ushort", "u4": "uint", "u1": "uchar"}


def save(target: str, name: str, content: bytes) -> None:
    """Keep a file for a target."""
    path = CORPUS / target / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)


def literal(data: bytes) -> bytes:
    """LZF without a repeat."""
    return b"".join(bytes([len(data[i : i + 32]) - 1]) + data[i : i + 32] for i in range(0, len(data), 32))


def pcd(encoding: str, data: bytes) -> bytes:
    """A PCD of CLOUD."""
    kinds = [RECORD[name].kind.upper() for name in RECORD.names]
    sizes = [str(RECORD[name].itemsize) for name in RECORD.names]
    lines = [
        "VERSION 0.7",
        f"FIELDS {' '.join(RECORD.names)}",
        f"SIZE {' '.join(sizes)}",
        f"TYPE {' '.join(kinds)}",
        "COUNT 1 1 1 1 1 1",
        "WIDTH 2\nHEIGHT 2\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4",
        f"DATA {encoding}\n",
    ]
    return "\n".join(lines).encode() + data


def ply(encoding: str, before: bytes, data: bytes) -> bytes:
    """A PLY of CLOUD, with a face before it."""
    properties = [f"property {PLY_TYPES[RECORD[name].str[1:]]} {name}" for name in RECORD.names]
    lines = [
        f"ply\nformat {encoding} 1.0\nelement face 1\nproperty list uchar int indices\nelement vertex 4",
        *properties,
        "end_header\n",
    ]
    return "\n".join(lines).encode() + before + data


def npy(array: np.ndarray) -> bytes:
    """The file of an array."""
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


blocks = b"".join(CLOUD[name].tobytes() for name in RECORD.names)
packed = literal(blocks)
save("pcd", "ascii", pcd("ascii", TEXT))
save("pcd", "binary", pcd("binary", CLOUD.tobytes()))
save("pcd", "compressed", pcd("binary_compressed", struct.pack("<II", len(packed), len(blocks)) + packed))
save("ply", "ascii", ply("ascii", b"2 0 1\n", TEXT))
save("ply", "little", ply("binary_little_endian", struct.pack("<Bii", 2, 0, 1), CLOUD.tobytes()))
big = CLOUD.astype(RECORD.newbyteorder(">"))
save("ply", "big", ply("binary_big_endian", struct.pack(">Bii", 2, 0, 1), big.tobytes()))
save("npy", "records", npy(CLOUD))
save("npy", "columns", npy(np.arange(20, dtype=np.float64).reshape(5, 4)))
save("npy", "fortran", npy(np.asfortranarray(np.arange(20, dtype=np.float32).reshape(5, 4))))
# libFuzzer's reading of (u32, &[u8]): the number first.
save("lzf", "literal", struct.pack("<I", len(blocks)) + packed)
save("lzf", "repeat", struct.pack("<I", 26) + bytes([2, *b"abc", 5 << 5, 2, 7 << 5, 7, 0]))
