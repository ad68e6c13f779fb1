"""Makers of files that are or claim to be too large, and of files whose opening would never end.

Large files are sparse, and images of many pixels are written line by line: no maker fills a disk or the memory.
"""

import json
import math
import os
import struct
import zlib
from collections.abc import Callable
from functools import cache
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import yaml

HUGE = 3 << 30
"""Size of a sparse file that no file of a drive may have."""
NPY = b"\x93NUMPY\x01\x00"
Edit = Callable[[dict[str, Any], Path], object]
"""Changes a drive: its document, or files in its folder."""


def edited(edit: Edit) -> Callable[[Path], None]:
    """A maker of files that changes the drive."""

    def make(folder: Path) -> None:
        path = folder / "drive" / "drive.yaml"
        document = yaml.safe_load(path.read_text())
        edit(document, path.parent)
        path.write_text(json.dumps(document))  # is YAML as well, without anchors

    return make


def named(
    key: str, name: str, content: bytes | Callable[[], bytes] = b"", size: int = 0
) -> Callable[[Path], None]:
    """A maker of a sparse file that a frame of the drive names."""

    def edit(document: dict[str, Any], drive: Path) -> None:
        document["frames"][0][key] = name
        sparse(drive / name, content if isinstance(content, bytes) else content(), size)

    return edited(edit)


def sparse(path: Path, content: bytes = b"", size: int = 0) -> None:
    """Write a file that goes on with zeros, which take no room on the disk."""
    path.write_bytes(content)
    os.truncate(path, max(size, len(content)))


def chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


@cache
def png(width: int, height: int, num_lines: int | None = None) -> bytes:
    """A grey PNG of zeros, or the first lines of it: 400 KB hold 400 million pixels."""
    pack, line = zlib.compressobj(9), bytes(width + 1)
    lines = (pack.compress(line) for _ in range(height if num_lines is None else num_lines))
    packed = b"".join([*lines, pack.flush()])
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    parts = (chunk(b"IHDR", header), chunk(b"IDAT", packed), chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def jpeg(width: int, height: int) -> bytes:
    """The start of a JPEG, with a preview of another size before its own."""
    preview = b"\xff\xd8" + b"\xff\xc0" + struct.pack(">HBHHB", 11, 8, 1, 1, 1) + bytes(3)
    size = struct.pack(">HBHHB", 11, 8, height, width, 1) + b"\1\x11\0"
    return (
        b"\xff\xd8\xff\xe1" + struct.pack(">H", 2 + len(preview)) + preview + b"\xff\xc0" + size + b"\xff\xd9"
    )


def bmp(width: int, height: int) -> bytes:
    return b"BM" + bytes(8) + struct.pack("<IIiiHH", 54, 40, width, -height, 1, 24) + bytes(24)


def npy(dtype: str, *shape: int) -> bytes:
    """The header of an array."""
    header = f"{{'descr': {dtype!r}, 'fortran_order': False, 'shape': {shape}}}\n".encode()
    return NPY + struct.pack("<H", len(header)) + header


def pcd(num_points: int, encoding: str, data: bytes = b"") -> bytes:
    lines = ["VERSION 0.7", "FIELDS x y z", "SIZE 4 4 4", "TYPE F F F", "COUNT 1 1 1"]
    lines += [f"WIDTH {num_points}", "HEIGHT 1", f"POINTS {num_points}", f"DATA {encoding}", ""]
    return "\n".join(lines).encode() + data


def ply(num_points: int) -> bytes:
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {num_points}"]
    return "\n".join([*lines, *(f"property float {axis}" for axis in "xyz"), "end_header", ""]).encode()


def las(num_points: int) -> bytes:
    header = struct.pack("<4s20xBB68xHIIBHI", b"LASF", 1, 2, 227, 227, 0, 0, 20, num_points)
    return header + bytes(227 - len(header))


def bomb(name: str, content: bytes, num_zeros: int) -> bytes:
    """A ZIP of one member that inflates to its content and then zeros, a thousand times its size."""
    pack, zeros = zlib.compressobj(9, zlib.DEFLATED, -15), bytes(1 << 20)
    packed = [pack.compress(content), *(pack.compress(zeros) for _ in range(num_zeros >> 20)), pack.flush()]
    data, crc = b"".join(packed), zlib.crc32(content)
    for _ in range(num_zeros >> 20):
        crc = zlib.crc32(zeros, crc)
    sizes = struct.pack("<HHHIII", 8, 0, 0, crc, len(data), len(content) + (num_zeros >> 20 << 20))
    local = b"PK\3\4" + struct.pack("<HH", 20, 0) + sizes + struct.pack("<HH", len(name), 0) + name.encode()
    entry = b"PK\1\2" + struct.pack("<HHH", 20, 20, 0) + sizes
    entry += struct.pack("<HHHHHII", len(name), 0, 0, 0, 0, 0, 0) + name.encode()
    end = struct.pack("<HHHHIIH", 0, 0, 1, 1, len(entry), len(local) + len(data), 0)
    return local + data + entry + b"PK\5\6" + end


def lzf_bomb(folder: Path) -> None:
    """A PCD of 45 MB that claims to unpack to 3.9 GB."""
    sizes = struct.pack("<II", 45_000_000, 3_900_000_000)
    named("points", "a.pcd", pcd(325_000_000, "binary_compressed", sizes), 45_000_500)(folder)


def of_pixels(width: int, height: int) -> Callable[[Path], None]:
    """A maker of a drive whose camera has as many pixels as its label image."""

    def edit(document: dict[str, Any], drive: Path) -> None:
        document["camera"] |= {"width": width, "height": height}
        document["frames"][0]["image_labels"] = "bomb.png"
        (drive / "bomb.png").write_bytes(png(width, height, num_lines=100))

    return edited(edit)


def text(name: str, unit: str, count: int, *, before: str = "", after: str = "") -> Callable[[Path], object]:
    """A maker of a document of many equal parts."""
    return lambda folder: (folder / name).write_text(before + unit * count + after)


def many_sweeps(last: int, num_frames: int = 40) -> Callable[[Path], None]:
    """A maker of a drive with as many sweeps of ten million points, all at zero, and the size of the last one."""

    def edit(document: dict[str, Any], drive: Path) -> None:
        frame = document["frames"][0]
        document["frames"] = [frame | {"points": f"{index}.bin"} for index in range(num_frames)]
        for index in range(num_frames):
            sparse(drive / f"{index}.bin", size=160_000_000 if index < num_frames - 1 else last)

    return edited(edit)


def repeated(folder: Path, num_frames: int = 2000) -> None:
    """A calibration of a drive, which then names its frame many times, also by other names of its files."""
    drive = folder / "drive"
    frame = yaml.safe_load((drive / "drive.yaml").read_text())["frames"][0]
    frames = list(islice(cycle([frame, frame | {"points": "./" + frame["points"]}]), num_frames))
    write_calibration(folder)
    calibration = yaml.safe_load((folder / "c.yaml").read_text())
    calibration["input"]["frames"] = [
        {key: each[key] for key in ("points", "point_labels", "image_labels")} for each in frames
    ]
    (folder / "c.yaml").write_text(json.dumps(calibration))
    edited(lambda document, _: document.update(frames=frames))(folder)


def write_calibration(folder: Path) -> None:
    """Write the calibration of the drive, c.yaml."""
    from commands import invoke

    invoke("initialize", folder / "drive", "-o", folder / "c.yaml", "-q")


def pipe(name: str) -> Callable[[Path], None]:
    """A maker of a pipe, whose opening waits for ever."""

    def make(folder: Path) -> None:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        os.mkfifo(folder / name)

    return make


def pipe_of_frame(key: str, name: str) -> Callable[[Path], None]:
    """A maker of a pipe that a frame of the drive names."""

    def edit(document: dict[str, Any], drive: Path) -> None:
        document["frames"][0][key] = name
        os.mkfifo(drive / name)

    return edited(edit)


def with_features(document: dict[str, Any], drive: Path) -> None:
    """Give the frame features, all zero."""
    for side, *shape in (("point_features", 12_027, 2), ("image_features", 180, 320, 2)):
        document["frames"][0][side] = f"{side}.npy"
        header = npy("<f4", *shape)
        sparse(drive / f"{side}.npy", header, len(header) + 4 * math.prod(shape))


def with_poses(document: dict[str, Any], drive: Path) -> None:
    document["motion"] = {"poses": "poses.txt"}


def all_of(*makers: Callable[[Path], object]) -> Callable[[Path], None]:
    """A maker that does one thing after the other."""

    def make(folder: Path) -> None:
        for each in makers:
            each(folder)

    return make


def zeros(name: str, content: bytes = b"", size: int = HUGE) -> Callable[[Path], None]:
    """A maker of a sparse file."""
    return lambda folder: sparse(folder / name, content, size)


def instead(name: str) -> Callable[[Path], None]:
    """A maker of a pipe that takes a file's place."""
    return all_of(lambda folder: (folder / name).unlink(), pipe(name))


def absent(*names: str) -> Callable[[Path], None]:
    """A check that nothing was written under these names."""

    def check(folder: Path) -> None:
        assert not [name for name in names if (folder / name).exists()]

    return check
