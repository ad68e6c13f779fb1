"""Hostile files that can be made of any size, each a kind of file that once took minutes or gigabytes.

`test_hostile_growth.py` runs them small, and `benchmarks/hostile.py` large, with time and memory.
"""

from __future__ import annotations

import io
import json
import sqlite3
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path

import yaml
from mcap.writer import CompressionType, IndexType, Writer
from PIL import Image

NS = 1_000_000_000
HASH_MODULUS = 2**61 - 1
"""Python's hash of a whole number is its remainder by this."""
SENSORS = ("sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo")


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


def sqlite(column: str, value: str, folder: Path, size: int) -> None:
    """Write a recording of SQLite whose data are made by SQLite itself."""
    (folder / "a.db3").unlink(missing_ok=True)
    database = sqlite3.connect(folder / "a.db3")
    database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT)")
    database.execute(
        f"CREATE TABLE messages(topic_id INTEGER, timestamp INTEGER, {column.format(size=size)})"
    )
    for key, name in enumerate(SENSORS):
        database.execute("INSERT INTO topics VALUES(?, ?, ?)", (key, f"/{key}", name))
        if value:
            row = f"INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, {value.format(size=size)})"
        else:
            row = "INSERT INTO messages(topic_id, timestamp) VALUES(?, ?)"
        database.execute(row, (key, NS + key))
    database.commit()
    database.close()


def _mcap(path: Path, messages: list[tuple[str, str, bytes, bytes]], *, has_index: bool = True) -> None:
    """Write an MCAP of messages: the encoding, the type, its schema and the bytes of each."""
    document = {"image_width": 8, "image_height": 8, "distortion_model": "plumb_bob"}
    document["camera_matrix"] = {"rows": 3, "cols": 3, "data": [8.0, 0.0, 4.0, 0.0, 8.0, 4.0, 0.0, 0.0, 1.0]}
    document["distortion_coefficients"] = {"rows": 1, "cols": 5, "data": [0.0] * 5}
    path.with_name("k.yaml").write_text(yaml.safe_dump(document))
    index = {} if has_index else {"index_types": IndexType.NONE, "use_statistics": False}
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1 << 26, compression=CompressionType.ZSTD, **index)
        writer.start()
        channels: dict[str, int] = {}
        for number, (encoding, kind, schema, raw) in enumerate(messages):
            if kind not in channels:
                key = writer.register_schema(
                    kind, "protobuf" if encoding == "protobuf" else "ros2msg", schema
                )
                channels[kind] = writer.register_channel(f"/{kind}", encoding, key)
            writer.add_message(channels[kind], NS + number, raw, NS + number)
        writer.finish()


def _ros1_record(kind: int, data: bytes | int, **fields: bytes) -> bytes:
    """Write a record of ROS 1: the kind, its data or their size, and the fields of its header."""
    named = {"op": bytes([kind]), **fields}
    parts = [f"{name}=".encode() + value for name, value in named.items()]
    header = b"".join(struct.pack("<I", len(part)) + part for part in parts)
    size = data if isinstance(data, int) else len(data)
    content = b"" if isinstance(data, int) else data
    return struct.pack("<I", len(header)) + header + struct.pack("<I", size) + content


def _u4(number: int) -> bytes:
    return struct.pack("<I", number)


def _ros1(
    path: Path,
    body: Callable[[int], bytes],
    chunks: Callable[[int], list[int]],
    num_indexes: int = len(SENSORS),
) -> None:
    """Write a recording of ROS 1: chunks with their indexes, by their first bytes, and the places of chunks."""
    connections = []
    for key, kind in enumerate(SENSORS):
        texts = {"type": kind.replace("/msg", "").encode(), "md5sum": b"*", "message_definition": b""}
        parts = [f"{name}=".encode() + value for name, value in texts.items()]
        data = b"".join(_u4(len(part)) + part for part in parts)
        connections.append(_ros1_record(7, data, conn=_u4(key), topic=f"/{key}".encode()))

    def bag(index: int, num_chunks: int) -> bytes:
        fields = {
            "index_pos": struct.pack("<Q", index),
            "conn_count": _u4(len(SENSORS)),
            "chunk_count": _u4(num_chunks),
        }
        return b"#ROSBAG V2.0\n" + _ros1_record(3, b"", **fields)

    start = len(bag(0, 0))
    middle, places = body(start), chunks(start)
    infos = [
        _ros1_record(
            6,
            bytes(8 * len(SENSORS)),
            ver=_u4(1),
            chunk_pos=struct.pack("<Q", place),
            start_time=bytes(8),
            end_time=bytes(8),
            count=_u4(num_indexes),
        )
        for place in places
    ]
    content = bag(start + len(middle), len(places)) + middle + b"".join([*connections, *infos])
    path.write_bytes(content)


def _ros1_index(count: int) -> list[bytes]:
    """Write the index of a chunk in which all messages of all topics are at one place."""
    return [
        _ros1_record(4, bytes(12 * count), ver=_u4(1), conn=_u4(key), count=_u4(count))
        for key in range(len(SENSORS))
    ]


def shared_index(folder: Path, count: int) -> None:
    """Write many chunks of ROS 1 that all lead to one index of many messages."""
    length = len(_ros1_record(5, 0, compression=b"none", size=_u4(0)))

    def body(start: int) -> bytes:
        heads = [
            _ros1_record(5, length * (count - number - 1), compression=b"none", size=_u4(0))
            for number in range(count)
        ]
        return b"".join([*heads, *_ros1_index(100 * count)])

    _ros1(folder / "a.bag", body, lambda start: [start + length * number for number in range(count)])


def empty_indexes(folder: Path, count: int) -> None:
    """Write many chunks of ROS 1 that all lead to the same many indexes without messages."""
    indexes = _ros1_index(0)[0] * count
    body = _ros1_record(5, b"", compression=b"none", size=_u4(0)) + indexes
    _ros1(folder / "a.bag", lambda start: body, lambda start: [start] * count, count)


def protobuf_fields(folder: Path, count: int) -> None:
    """Write Foxglove messages of many empty parts, two bytes each."""
    from foxglove_schemas_protobuf import CameraCalibration_pb2, PointCloud_pb2, RawImage_pb2
    from mcap_protobuf.schema import build_file_descriptor_set

    classes = (PointCloud_pb2.PointCloud, RawImage_pb2.RawImage, CameraCalibration_pb2.CameraCalibration)
    bodies = (b"\x2a\0" * count, b"", b"\x4d" + b"\0\0\0\0")
    _mcap(
        folder / "a.mcap",
        [
            ("protobuf", f"foxglove.{cls.__name__}", build_file_descriptor_set(cls).SerializeToString(), raw)
            for cls, raw in zip(classes, bodies, strict=True)
        ],
    )


def cdr_fields(folder: Path, count: int) -> None:
    """Write a cloud that states many fields, and has the bytes of them."""
    header = b"\0\1\0\0" + struct.pack("<iII", 1, 0, 2) + b"a\0\0\0"
    cloud = header + struct.pack("<III", 1, 1, count) + bytes(20 * count)
    raws = zip(SENSORS, (cloud, header, header), strict=True)
    _mcap(folder / "a.mcap", [("cdr", kind, b"", raw) for kind, raw in raws])


def small_records(folder: Path, count: int) -> None:
    """Write many empty messages without an index."""
    header = b"\0\1\0\0" + bytes(16)
    empty = [("cdr", "std_msgs/msg/Empty", b"", b"")] * count
    _mcap(folder / "a.mcap", [*(("cdr", kind, b"", header) for kind in SENSORS), *empty], has_index=False)


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
