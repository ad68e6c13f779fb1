"""Recordings for tests, by rosbags' writers, and MCAP by that of the library `mcap`, too."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import numpy as np
from mcap.writer import CompressionType, Writer as McapWriter
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer as Writer2
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from semcal_cli.drive.camera import Camera
from semcal_cli.drive.document import Drive
from semcal_cli.files.image_files import read_image
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import quaternion_xyzw
from semcal_cli.observations.reading import read_clouds

NS = 1_000_000_000
START_NS = 1_581_624_663_000_000_000
KINDS = ("ros1", "sqlite3", "mcap", "mcap library")
ROS1_MCAP = "mcap library, ROS 1"
CODES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
"""Datatypes of a PointField."""
SUFFIXES = {
    "ros1": "bag.bag",
    "sqlite3": "bag",
    "mcap": "bag",
    "mcap library": "bag.mcap",
    ROS1_MCAP: "bag.mcap",
}
LIVOX = """std_msgs/Header header
uint64 timebase
uint32 point_num
uint8 lidar_id
uint8[3] rsvd
livox_ros_driver2/CustomPoint[] points
================================================================================
MSG: livox_ros_driver2/CustomPoint
uint32 offset_time
float32 x
float32 y
float32 z
uint8 reflectivity
uint8 tag
uint8 line
"""

OTHERS = {
    "ffmpeg_image_transport_msgs/msg/FFMPEGPacket": "std_msgs/Header header\nint32 width\nint32 height\n"
    "string encoding\nuint64 pts\nuint8 flags\nbool is_bigendian\nuint8[] data",
    "velodyne_msgs/msg/VelodynePacket": "builtin_interfaces/Time stamp\nuint8[1206] data",
    "velodyne_msgs/msg/VelodyneScan": "std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets",
    "ouster_ros/msg/PacketMsg": "uint8[] buf",
}
"""Definitions of other types."""


class Messages:
    """Makes messages of the types of one generation of ROS."""

    def __init__(self, kind: str) -> None:
        self.is_ros1 = kind in ("ros1", ROS1_MCAP)
        self.store = get_typestore(Stores.ROS1_NOETIC if self.is_ros1 else Stores.ROS2_HUMBLE)
        if self.is_ros1:
            text = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))
        for kind_of, text in OTHERS.items():
            plain = text.replace("builtin_interfaces/Time", "time") if self.is_ros1 else text
            self.store.register(get_types_from_msg(plain, kind_of))
        for package in ("livox_ros_driver", "livox_ros_driver2"):
            text = LIVOX.replace("livox_ros_driver2", package)
            self.store.register(get_types_from_msg(text, f"{package}/msg/CustomMsg"))

    def raw(self, message: Any) -> bytes:
        """Serialize a message."""
        serialize = self.store.serialize_ros1 if self.is_ros1 else self.store.serialize_cdr
        return bytes(serialize(message, message.__msgtype__))

    def make(self, kind: str, **values: Any) -> Any:
        """Make a message of a type; inner messages are mappings, and what is not given is zero or empty."""
        fields = self.store.fielddefs[kind][1]
        return self.store.types[kind](**{name: self._value(*of, values.get(name)) for name, of in fields})

    def _value(self, node: Nodetype, of: Any, value: Any) -> Any:
        if node == Nodetype.NAME:
            return self.make(of, **(value or {}))
        if node == Nodetype.BASE:
            default = "" if of[0] == "string" else np.zeros((), of[0]).item()
            return default if value is None else value
        (node, inner), count = of
        if node == Nodetype.NAME:
            return [self.make(inner, **each) for each in value or []]
        return np.zeros(count, inner[0]) if value is None else np.asarray(value, inner[0])

    def cloud(self, records: np.ndarray, stamp_ns: int, frame: str = "lidar", **changes: Any) -> Any:
        """Make a PointCloud2 of records (N,) or (H, W) of any layout."""
        layout, rows = records.dtype, np.atleast_2d(records)
        fields = [
            {"name": name, "offset": layout.fields[name][1], "datatype": CODES[layout[name].base.str[1:]],
             "count": int(np.prod(layout[name].shape, dtype=int))}
            for name in layout.names or ()
        ]  # fmt: skip
        values = {
            "header": header(stamp_ns, frame),
            "height": rows.shape[0],
            "width": rows.shape[1],
            "fields": fields,
            "is_bigendian": any(layout[name].base.str[0] == ">" for name in layout.names or ()),
            "point_step": layout.itemsize,
            "row_step": layout.itemsize * rows.shape[1],
            "data": np.frombuffer(rows.tobytes(), np.uint8),
        }
        return self.make("sensor_msgs/msg/PointCloud2", **(values | changes))

    def image(
        self, pixels: np.ndarray, encoding: str, stamp_ns: int, frame: str = "optical", **changes: Any
    ) -> Any:
        """Make an Image of stored pixels (H, W) or (H, W, C)."""
        values = {
            "header": header(stamp_ns, frame),
            "height": pixels.shape[0],
            "width": pixels.shape[1],
            "encoding": encoding,
            "is_bigendian": int(pixels.dtype.str[0] == ">"),
            "step": pixels[0].nbytes,
            "data": np.frombuffer(pixels.tobytes(), np.uint8),
        }
        return self.make("sensor_msgs/msg/Image", **(values | changes))

    def compressed(self, content: bytes, name: str, stamp_ns: int) -> Any:
        """Make a CompressedImage."""
        data = np.frombuffer(content, np.uint8)
        return self.make(
            "sensor_msgs/msg/CompressedImage", header=header(stamp_ns, "optical"), format=name, data=data
        )

    def packet(self, content: bytes, codec: str, stamp_ns: int) -> Any:
        """Make an FFMPEGPacket; its flag of key frames is not set, as that of old recorders."""
        data = np.frombuffer(content, np.uint8)
        return self.make(
            "ffmpeg_image_transport_msgs/msg/FFMPEGPacket",
            header=header(stamp_ns, "optical"),
            encoding=codec,
            data=data,
        )

    def camera_info(self, camera: Any, stamp_ns: int, **changes: Any) -> Any:
        """Make a CameraInfo of a drive's camera."""
        values: dict[str, Any] = {
            "header": header(stamp_ns, "optical"),
            "height": camera.height,
            "width": camera.width,
            "distortion_model": {"fisheye": "equidistant"}.get(camera.model, camera.model),
            "D": camera.distortion,
            "K": np.ravel(camera.K),
            "R": np.eye(3).ravel(),
            "P": np.hstack([np.array(camera.K), np.zeros((3, 1))]).ravel(),
        } | changes
        if not self.is_ros1:
            values = {key.lower() if key in "DKRP" else key: value for key, value in values.items()}
        return self.make("sensor_msgs/msg/CameraInfo", **values)

    def transforms(self, edges: dict[tuple[str, str], Pose], stamp_ns: int = START_NS) -> Any:
        """Make a TFMessage of T_parent_child by parent and child."""
        stamped = [
            {"header": header(stamp_ns, parent), "child_frame_id": child,
             "transform": {"translation": position(T), "rotation": rotation(T)}}
            for (parent, child), T in edges.items()
        ]  # fmt: skip
        return self.make("tf2_msgs/msg/TFMessage", transforms=stamped)

    def pose(self, T: Pose, stamp_ns: int) -> Any:
        """Make a PoseStamped."""
        pose = {"position": position(T), "orientation": rotation(T)}
        return self.make("geometry_msgs/msg/PoseStamped", header=header(stamp_ns, "odom"), pose=pose)

    def odometry(self, T: Pose, stamp_ns: int, child: str) -> Any:
        """Make an Odometry."""
        pose = {"pose": {"position": position(T), "orientation": rotation(T)}}
        return self.make(
            "nav_msgs/msg/Odometry", header=header(stamp_ns, "odom"), child_frame_id=child, pose=pose
        )

    def livox(
        self, records: np.ndarray, stamp_ns: int, package: str = "livox_ros_driver2", frame: str = "lidar"
    ) -> Any:
        """Make a CustomMsg of records with the fields of CustomPoint."""
        points = [{name: each[name].item() for name in records.dtype.names} for each in records]
        return self.make(
            f"{package}/msg/CustomMsg",
            header=header(stamp_ns, frame),
            timebase=stamp_ns,
            point_num=len(points),
            points=points,
        )


class BagWriter(Messages):
    """Writes messages of the types of one generation of ROS."""

    def __init__(self, folder: Path, kind: str, compression: str = "", **mcap_options: Any) -> None:
        self.kind, self.path = kind, folder / SUFFIXES[kind]
        super().__init__(kind)
        self._stack = ExitStack()
        self._connections: dict[tuple[str, str], Any] = {}
        self._writer: Any
        if kind == "ros1":
            self._writer = Writer1(self.path)
            self._writer.chunk_threshold = 100_000
            if compression:
                self._writer.set_compression(Writer1.CompressionFormat[compression])
            self._stack.enter_context(self._writer)
        elif kind in ("mcap library", ROS1_MCAP):
            file = self._stack.enter_context(self.path.open("wb"))
            used = CompressionType[compression] if compression else CompressionType.NONE
            self._writer = McapWriter(file, chunk_size=100_000, compression=used, **mcap_options)
            self._writer.start(profile="ros1" if self.is_ros1 else "ros2", library="test")
            self._stack.callback(self._writer.finish)
        else:
            plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
            self._writer = Writer2(self.path, version=9, storage_plugin=plugin)
            if compression:
                self._writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
            self._stack.enter_context(self._writer)

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def write(self, topic: str, message: Any, received_ns: int) -> None:
        """Write a message."""
        self.write_raw(topic, message.__msgtype__, self.raw(message), received_ns)

    def write_raw(self, topic: str, kind: str, raw: bytes, received_ns: int) -> None:
        """Write the bytes of a message."""
        if (topic, kind) not in self._connections:
            self._connections[topic, kind] = self._connection(topic, kind)
        connection = self._connections[topic, kind]
        if isinstance(self._writer, McapWriter):
            self._writer.add_message(connection, log_time=received_ns, data=raw, publish_time=received_ns)
        else:
            self._writer.write(connection, received_ns, raw)

    def _connection(self, topic: str, kind: str) -> Any:
        if isinstance(self._writer, McapWriter):
            name, schema, encoding = kind, "ros2msg", "cdr"
            if self.is_ros1:
                name, schema, encoding = kind.replace("/msg/", "/"), "ros1msg", "ros1"
            key = self._writer.register_schema(name=name, encoding=schema, data=b"")
            return self._writer.register_channel(topic=topic, message_encoding=encoding, schema_id=key)
        if kind in self.store.fielddefs:
            return self._writer.add_connection(topic, kind, typestore=self.store)
        digest = {"md5sum": "0" * 32} if self.is_ros1 else {"rihs01": "RIHS01_" + "0" * 64}
        return self._writer.add_connection(topic, kind, msgdef="uint8 data", **digest)


def header(stamp_ns: int, frame: str) -> dict[str, Any]:
    """Fields of a Header."""
    return {"stamp": {"sec": stamp_ns // NS, "nanosec": stamp_ns % NS}, "frame_id": frame}


def position(T: Pose) -> dict[str, float]:
    """Fields of a Point or a Vector3."""
    return dict(zip("xyz", T[:3, 3].tolist(), strict=True))


def rotation(T: Pose) -> dict[str, float]:
    """Fields of a Quaternion."""
    turn = np.eye(4)
    turn[:3, :3] = T[:3, :3]  # a position may be no number
    return dict(zip("xyzw", np.asarray(quaternion_xyzw(turn)).tolist(), strict=True))


def write_drive_as_bag(
    drive: Drive, folder: Path, kind: str, *, compression: str = "", T_camera_lidar: Pose | None = None
) -> Path:
    """Record a drive with images: a sweep and a raw image every tenth of a second."""
    return write_drive(drive, BagWriter(folder, kind, compression), T_camera_lidar)


def write_drive(drive: Drive, writer: Any, T_camera_lidar: Pose | None = None) -> Path:
    """Record a drive by a writer with the methods of `BagWriter`."""
    with writer as bag:
        if T_camera_lidar is not None:
            bag.write("/tf_static", bag.transforms({("optical", "lidar"): T_camera_lidar}), START_NS)
        for index, (frame, cloud) in enumerate(zip(drive.frames, read_clouds(drive), strict=True)):
            pixels = read_image(drive.resolve(frame.image or ""))
            write_pair(bag, drive.camera, cloud.points, cloud.intensity, pixels, START_NS + index * NS // 10)
    path: Path = writer.path
    return path


def write_pair(
    bag: Any,
    camera: Camera,
    points: np.ndarray,
    intensity: np.ndarray | None,
    pixels: np.ndarray,
    stamp_ns: int,
) -> None:
    """Record a sweep of points (N, 3), and an image that is taken 10 ms later, with its intrinsics."""
    records = np.zeros(len(points), [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")])
    for axis, name in enumerate("xyz"):
        records[name] = points[:, axis]
    if intensity is not None:
        records["intensity"] = intensity
    bag.write("/camera/camera_info", bag.camera_info(camera, stamp_ns), stamp_ns)
    bag.write("/camera/image_raw", bag.image(pixels, "bgr8", stamp_ns + NS // 100), stamp_ns + NS // 50)
    bag.write("/points", bag.cloud(records, stamp_ns), stamp_ns + NS // 30)


def png(pixels: np.ndarray) -> bytes:
    """Encode pixels as a PNG."""
    return bytes(cv2.imencode(".png", pixels)[1])


def jpeg(pixels: np.ndarray) -> bytes:
    """Encode pixels as a JPEG."""
    return bytes(cv2.imencode(".jpg", pixels)[1])


def cut(path: Path, share: float, out: Path) -> Path:
    """Copy the first part of a file."""
    content = path.read_bytes()
    out.write_bytes(content[: round(share * len(content))])
    return out
