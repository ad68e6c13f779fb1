"""Hostile recordings that can be made of any size."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path

import yaml
from mcap.writer import CompressionType, IndexType, Writer

NS = 1_000_000_000


SENSORS = ("sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo")


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
