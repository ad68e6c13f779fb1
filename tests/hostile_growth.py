"""Hostile files that can be made of any size, each a kind of file that once took minutes or gigabytes.

`test_hostile_growth.py` runs them small, and `benchmarks/hostile.py` large, with time and memory.
"""

from __future__ import annotations

import io
import json
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path

import yaml
from hostile_recordings import cdr_fields, empty_indexes, protobuf_fields, shared_index, small_records, sqlite
from PIL import Image

HASH_MODULUS = 2**61 - 1
"""Python's hash of a whole number is its remainder by this."""


@dataclass(frozen=True)
class Growth:
    """A kind of hostile file."""

    make: Callable[[Path, int], object]
    """Makes a file of a size in a folder that holds the small whole drive `drive`."""
    command: tuple[str, ...]
    """Arguments of semcal, which runs in that folder."""
    line: str
    """Pattern of the last line on standard error, at both sizes."""
    small: int
    large: int
    exit_code: int = 1


def keys_of_one_hash(folder: Path, count: int) -> None:
    """Write a drive whose classes have keys that Python compares one by one."""
    keys = "".join(f"    {HASH_MODULUS * (index + 1)}: [1]\n" for index in range(count))
    (folder / "drive/drive.yaml").write_text(f"semcal_drive: 1\nclasses:\n  image:\n{keys}")


def long_key(folder: Path, count: int) -> None:
    """Write a drive with a long key that is unknown."""
    (folder / "drive.json").write_text(f'{{"semcal_drive": 1, "{"ca" * count}": 1}}')


def long_word(content: str, folder: Path, count: int) -> None:
    """Write a publisher of ROS with a long word."""
    (folder / "t.txt").write_text(f"static_transform_publisher {content * count}x a b\n")


def chain_of_joints(folder: Path, count: int) -> None:
    """Write a URDF whose LiDAR and camera are many joints apart."""
    links = ["lidar", *(f"link_{index}" for index in range(count)), "camera_optical"]
    joints = (
        f'<joint type="fixed"><parent link="{parent}"/><child link="{child}"/></joint>'
        for parent, child in pairwise(links)
    )
    (folder / "t.urdf").write_text(f"<robot>{''.join(joints)}</robot>")


def rig_of_cameras(folder: Path, count: int) -> None:
    """Write a rig of many cameras, and a transform of one that it does not have."""
    cameras = "".join(f"  c{index}: drive\n" for index in range(count))
    (folder / "rig.yaml").write_text(f"semcal_rig: 1\ncameras:\n{cameras}T_camera_camera: {{c: {{}}}}\n")


def summary_of_drives(folder: Path, count: int) -> None:
    """Write the summary of a batch of many drives."""
    unit = [[float(row == column) for column in range(6)] for row in range(6)]
    covariance = [[1e-4 * value for value in row] for row in unit]
    fields = {
        "status": "trusted",
        "exit_code": 0,
        "reasons": [],
        "covariance": covariance,
        "camera": "a" * 64,
    }
    rows = [row[:4] for row in unit[:4]]
    (folder / "batch").mkdir()
    with (folder / "batch/summary.jsonl").open("w") as file:
        for index in range(count):
            T = [[*rows[0][:3], 1e-6 * index], *rows[1:]]
            place = {"drive": f"d{index}", "result": f"d{index}/calibration.yaml", "T_camera_lidar": T}
            file.write(f"{json.dumps(fields | place)}\n")


def _size(path: Path) -> tuple[int, int]:
    with Image.open(path) as image:
        return image.size


def _image(folder: Path) -> tuple[Path, Image.Image]:
    """Find the first image of the drive, and make a black one of its size."""
    frame = yaml.safe_load((folder / "drive/drive.yaml").read_text())["frames"][0]
    path = folder / "drive" / frame["image"]
    return path, Image.new("RGB", _size(path))


def scans(folder: Path, count: int) -> None:
    """Repeat the last scan of a progressive JPEG, which then stands in the place of a PNG."""
    path, image = _image(folder)
    content = io.BytesIO()
    image.save(content, "JPEG", progressive=True, quality=5)
    start, end = content.getvalue().rindex(b"\xff\xda"), -2
    jpeg = content.getvalue()
    path.write_bytes(jpeg[:start] + jpeg[start:end] * count + jpeg[end:])


def texts(folder: Path, count: int) -> None:
    """Add compressed texts of eight megabytes to a PNG."""
    path, image = _image(folder)
    content = io.BytesIO()
    image.save(content, "PNG")
    chunk = b"zTXtk\0\0" + zlib.compress(bytes(7_900_000), 9)
    whole = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
    png = content.getvalue()
    path.write_bytes(png[:33] + whole * count + png[33:])


def chunk_beyond_the_end(folder: Path, count: int) -> None:
    """Let the data of a PNG state more bytes than the file has."""
    path, image = _image(folder)
    content = io.BytesIO()
    image.save(content, "PNG")
    png = content.getvalue()
    start = png.index(b"IDAT") - 4
    path.write_bytes(png[:start] + struct.pack(">I", count) + png[start + 4 :])


def unfitting_sweeps(folder: Path, count: int) -> None:
    """Let the drive have eight sweeps of points that do not fit one another."""
    import numpy as np

    document = yaml.safe_load((folder / "drive/drive.yaml").read_text())
    rng, frame = np.random.default_rng(0), document["frames"][0]
    frames = []
    for number in range(8):
        points = (rng.uniform(-1.0, 1.0, (count, 4)) * [60.0, 60.0, 3.0, 0.0] + [0.0, 0.0, 0.0, 0.5]).astype(
            "<f4"
        )
        (folder / f"drive/points/{number}.bin").write_bytes(points.tobytes())
        stamp = {"points_stamp": number / 10, "image_stamp": number / 10}
        frames.append({"points": f"points/{number}.bin", "image": frame["image"], **stamp})
    document |= {"frames": frames}
    document.pop("motion", None)
    (folder / "drive/drive.yaml").write_text(yaml.safe_dump(document))


INSPECT, OVERLAY = ("inspect", "drive"), ("overlay", "drive", "drive", "-o", "out")
CONVERT = ("convert", "--to", "npy", "--to-direction", "lidar-to-camera", "-o", "T.npy")
IMPORT = ("import", "bag", "-o", "out")
KINDS: dict[str, Growth] = {
    "YAML keys of one hash": Growth(
        keys_of_one_hash,
        INSPECT,
        "found key 2305843009213693951, expected text or at most 4,294,967,295$",
        2,
        40_000,
    ),
    "a long unknown key": Growth(long_key, ("inspect", "drive.json"), "unknown key 'caca", 50, 4_000_000),
    "a long number": Growth(
        partial(long_word, "1"),
        (*CONVERT, "t.txt"),
        "found a command of [0-9,]+ characters, needed at most",
        5000,
        900_000,
    ),
    "a long word": Growth(
        partial(long_word, "a"),
        (*CONVERT, "t.txt"),
        "found a command of [0-9,]+ characters, needed at most",
        5000,
        900_000,
    ),
    "a chain of joints": Growth(
        chain_of_joints, (*CONVERT, "t.urdf"), r"^T\.npy$|^$", 3, 50_000, exit_code=0
    ),
    "a rig of many cameras": Growth(
        rig_of_cameras, ("calibrate", "rig.yaml", "-o", "out"), "at most 100", 101, 400_000
    ),
    "a fleet of many drives": Growth(
        summary_of_drives,
        ("fleet", "batch"),
        "batch: found more than 10,000 drives, needed at most so many in a fleet$",
        10_001,
        60_000,
    ),
    "scans of a JPEG": Growth(
        scans,
        OVERLAY,
        "found a JPEG of 33 or more scans, needed at most 32$",
        30,
        100_000,
    ),
    "texts of a PNG": Growth(texts, OVERLAY, "png$", 1, 900, exit_code=0),
    "a PNG beyond its end": Growth(
        chunk_beyond_the_end,
        OVERLAY,
        "png: found a damaged image, expected an intact one$",
        4_294_967_295,
        4_294_967_295,
    ),
    "blobs of SQLite": Growth(
        partial(sqlite, "data BLOB", "zeroblob({size})"),
        (*IMPORT, "a.db3"),
        "found a recording without messages",
        268_435_457,
        900_000_000,
    ),
    "generated columns of SQLite": Growth(
        partial(sqlite, "data BLOB GENERATED ALWAYS AS (zeroblob({size}))", ""),
        (*IMPORT, "a.db3"),
        "found no stored column 'data' in the table 'messages'",
        1000,
        900_000_000,
    ),
    "parts of Protobuf": Growth(
        protobuf_fields,
        (*IMPORT, "a.mcap", "--intrinsics", "k.yaml"),
        "found no",
        100_001,
        100_000_000,
    ),
    "fields of a cloud": Growth(
        cdr_fields, (*IMPORT, "a.mcap", "--intrinsics", "k.yaml"), "found no", 129, 10_000_000
    ),
    "records without an index": Growth(
        small_records, (*IMPORT, "a.mcap", "--intrinsics", "k.yaml"), "found no", 10, 5_000_000
    ),
    "a shared index of ROS 1": Growth(
        shared_index,
        (*IMPORT, "a.bag"),
        "found an index that is used several times, expected one a chunk$",
        3,
        10_000,
    ),
    "empty indexes of ROS 1": Growth(
        empty_indexes,
        (*IMPORT, "a.bag"),
        "found an index that is used several times, expected one a chunk$",
        20,
        10_000,
    ),
    "sweeps that do not fit": Growth(
        unfitting_sweeps,
        ("odometry", "drive", "-o", "poses.txt"),
        "found 8 sweeps, 0.1 s apart, expected consecutive",
        200,
        20_000,
    ),
}
