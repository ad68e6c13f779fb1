"""Recordings for tests, by rosbags' writers, and MCAP by that of the library `mcap`, too."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from semcal_cli.drive.document import Drive
from semcal_cli.drive.reading import read_clouds
from semcal_cli.files.images import read_image
from semcal_cli.geometry.poses import Pose, quaternion_xyzw

NS = 1_000_000_000
START_NS = 1_581_624_663_000_000_000
KINDS = ("ros1", "sqlite3", "mcap", "mcap library")
SUFFIXES = {"ros1": "bag.bag", "sqlite3": "bag", "mcap": "bag", "mcap library": "bag.mcap"}
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


class BagWriter:
    """Writes messages of the types of one generation of ROS."""

    def __init__(self, folder: Path, kind: str, compression: str = "", **mcap_options: Any) -> None:
        self.kind, self.path = kind, folder / SUFFIXES[kind]
        self.is_ros1 = kind == "ros1"
        self.store = get_typestore(Stores.ROS1_NOETIC if self.is_ros1 else Stores.ROS2_HUMBLE)
        if self.is_ros1:
            text = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))
        for package in ("livox_ros_driver", "livox_ros_driver2"):
            text = LIVOX.replace("livox_ros_driver2", package)
            self.store.register(get_types_from_msg(text, f"{package}/msg/CustomMsg"))
        self._stack = ExitStack()
        self._connections: dict[tuple[str, str], Any] = {}
        self._writer: Any
        if kind == "ros1":
            self._writer = Writer1(self.path)
            self._writer.chunk_threshold = 100_000
            if compression:
                self._writer.set_compression(Writer1.CompressionFormat[compression])
            self._stack.enter_context(self._writer)
        elif kind == "mcap library":
            file = self._stack.enter_context(self.path.open("wb"))
            used = CompressionType[compression] if compression else CompressionType.NONE
            self._writer = McapWriter(file, chunk_size=100_000, compression=used, **mcap_options)
            self._writer.start(profile="ros2", library="test")
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

    def raw(self, message: Any) -> bytes:
        """Serialize a message."""
        if self.is_ros1:
            return bytes(self.store.serialize_ros1(message, message.__msgtype__))
        return bytes(self.store.serialize_cdr(message, message.__msgtype__))

    def write(self, topic: str, message: Any, received_ns: int) -> None:
        """Write a message."""
        self.write_raw(topic, message.__msgtype__, self.raw(message), received_ns)

    def write_raw(self, topic: str, kind: str, raw: bytes, received_ns: int) -> None:
        """Write the bytes of a message."""
        connection = self._connections.get((topic, kind))
        if self.kind == "mcap library":
            if connection is None:
                schema = self._writer.register_schema(name=kind, encoding="ros2msg", data=b"")
                connection = self._writer.register_channel(
                    topic=topic, message_encoding="cdr", schema_id=schema
                )
            self._writer.add_message(connection, log_time=received_ns, data=raw, publish_time=received_ns)
        else:
            if connection is None:
                known = kind in self.store.fielddefs
                text = {} if known else {"msgdef": "uint8 data", "md5sum": "0" * 32}
                if known or self.is_ros1:
                    connection = self._writer.add_connection(
                        topic, kind, **({"typestore": self.store} if known else text)
                    )
                else:
                    connection = self._writer.add_connection(
                        topic, kind, msgdef="uint8 data", rihs01="RIHS01_" + "0" * 64
                    )
            self._writer.write(connection, received_ns, raw)
        self._connections[topic, kind] = connection

    def make(self, kind: str, **fields: Any) -> Any:
        """Make a message of a type of the package before its last slash."""
        return self.store.types[kind](**fields)

    def header(self, stamp_ns: int, frame: str) -> Any:
        """Make a header."""
        stamp = self.make("builtin_interfaces/msg/Time", sec=stamp_ns // NS, nanosec=stamp_ns % NS)
        more = {"seq": 0} if self.is_ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **more)

    def cloud(self, records: np.ndarray, stamp_ns: int, frame: str = "lidar", **changes: Any) -> Any:
        """Make a PointCloud2 of records (N,) or (H, W) of any layout."""
        codes = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
        layout = records.dtype
        rows = np.atleast_2d(records)
        fields = []
        for name in layout.names or ():
            kind, offset = layout.fields[name][:2]
            fields.append(
                self.make(
                    "sensor_msgs/msg/PointField",
                    name=name,
                    offset=offset,
                    datatype=codes[kind.base.str[1:]],
                    count=int(np.prod(kind.shape, dtype=int)),
                )
            )
        is_bigendian = any(layout.fields[name][0].base.str[0] == ">" for name in layout.names or ())
        values: dict[str, Any] = {
            "header": self.header(stamp_ns, frame),
            "height": rows.shape[0],
            "width": rows.shape[1],
            "fields": fields,
            "is_bigendian": is_bigendian,
            "point_step": layout.itemsize,
            "row_step": layout.itemsize * rows.shape[1],
            "data": np.frombuffer(rows.tobytes(), np.uint8),
            "is_dense": False,
        }
        return self.make("sensor_msgs/msg/PointCloud2", **(values | changes))

    def image(
        self, pixels: np.ndarray, encoding: str, stamp_ns: int, frame: str = "optical", **changes: Any
    ) -> Any:
        """Make an Image of stored pixels (H, W) or (H, W, C)."""
        values: dict[str, Any] = {
            "header": self.header(stamp_ns, frame),
            "height": pixels.shape[0],
            "width": pixels.shape[1],
            "encoding": encoding,
            "is_bigendian": int(pixels.dtype.str[0] == ">"),
            "step": pixels[0].nbytes,
            "data": np.frombuffer(pixels.tobytes(), np.uint8),
        }
        return self.make("sensor_msgs/msg/Image", **(values | changes))

    def compressed(self, content: bytes, name: str, stamp_ns: int, frame: str = "optical") -> Any:
        """Make a CompressedImage."""
        return self.make(
            "sensor_msgs/msg/CompressedImage",
            header=self.header(stamp_ns, frame),
            format=name,
            data=np.frombuffer(content, np.uint8),
        )

    def camera_info(self, camera: Any, stamp_ns: int, **changes: Any) -> Any:
        """Make a CameraInfo of a drive's camera."""
        K = np.array(camera.K).ravel()
        P = np.hstack([np.array(camera.K), np.zeros((3, 1))]).ravel()
        roi = self.make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        values: dict[str, Any] = {
            "header": self.header(stamp_ns, "optical"),
            "height": camera.height,
            "width": camera.width,
            "distortion_model": {"fisheye": "equidistant"}.get(camera.model, camera.model),
            "D": np.array(camera.distortion, dtype=float),
            "K": K,
            "R": np.eye(3).ravel(),
            "P": P,
            "binning_x": 0,
            "binning_y": 0,
            "roi": roi,
        } | changes
        if not self.is_ros1:
            values = {key.lower() if key in "DKRP" else key: value for key, value in values.items()}
        return self.make("sensor_msgs/msg/CameraInfo", **values)

    def transforms(self, edges: dict[tuple[str, str], Pose], stamp_ns: int = START_NS) -> Any:
        """Make a TFMessage of T_parent_child by parent and child."""
        stamped = []
        for (parent, child), T in edges.items():
            transform = self.make(
                "geometry_msgs/msg/Transform",
                translation=self._vector("Vector3", T),
                rotation=self._rotation(T),
            )
            stamped.append(
                self.make(
                    "geometry_msgs/msg/TransformStamped",
                    header=self.header(stamp_ns, parent),
                    child_frame_id=child,
                    transform=transform,
                )
            )
        return self.make("tf2_msgs/msg/TFMessage", transforms=stamped)

    def pose(self, T: Pose, stamp_ns: int) -> Any:
        """Make a PoseStamped."""
        return self.make(
            "geometry_msgs/msg/PoseStamped", header=self.header(stamp_ns, "odom"), pose=self._pose(T)
        )

    def odometry(self, T: Pose, stamp_ns: int, child: str) -> Any:
        """Make an Odometry."""
        zero = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        twist = self.make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        covariance = np.zeros(36)
        return self.make(
            "nav_msgs/msg/Odometry",
            header=self.header(stamp_ns, "odom"),
            child_frame_id=child,
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=self._pose(T), covariance=covariance),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=covariance),
        )

    def livox(self, records: np.ndarray, stamp_ns: int, package: str = "livox_ros_driver2") -> Any:
        """Make a CustomMsg of records with the fields of CustomPoint."""
        points = [
            self.make(
                f"{package}/msg/CustomPoint", **{name: each[name].item() for name in records.dtype.names}
            )
            for each in records
        ]
        return self.make(
            f"{package}/msg/CustomMsg",
            header=self.header(stamp_ns, "lidar"),
            timebase=stamp_ns,
            point_num=len(points),
            lidar_id=0,
            rsvd=np.zeros(3, np.uint8),
            points=points,
        )

    def _vector(self, name: str, T: Pose) -> Any:
        x, y, z = (float(each) for each in T[:3, 3])
        return self.make(f"geometry_msgs/msg/{name}", x=x, y=y, z=z)

    def _rotation(self, T: Pose) -> Any:
        turn = np.eye(4)
        turn[:3, :3] = T[:3, :3]  # a position may be no number
        x, y, z, w = (float(each) for each in quaternion_xyzw(turn))
        return self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def _pose(self, T: Pose) -> Any:
        return self.make(
            "geometry_msgs/msg/Pose", position=self._vector("Point", T), orientation=self._rotation(T)
        )


def write_drive_as_bag(
    drive: Drive, folder: Path, kind: str, *, compression: str = "", T_camera_lidar: Pose | None = None
) -> Path:
    """Record a drive with pictures: a sweep and a raw picture every tenth of a second."""
    with BagWriter(folder, kind, compression) as bag:
        if T_camera_lidar is not None:
            bag.write("/tf_static", bag.transforms({("optical", "lidar"): T_camera_lidar}), START_NS)
        for index, (frame, cloud) in enumerate(zip(drive.frames, read_clouds(drive), strict=True)):
            stamp_ns = START_NS + index * NS // 10
            records = np.zeros(
                len(cloud.points), [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")]
            )
            for axis, name in enumerate("xyz"):
                records[name] = cloud.points[:, axis]
            if cloud.intensity is not None:
                records["intensity"] = cloud.intensity
            bag.write("/camera/camera_info", bag.camera_info(drive.camera, stamp_ns), stamp_ns)
            pixels = read_image(drive.resolve(frame.image or ""))
            bag.write(
                "/camera/image_raw", bag.image(pixels, "bgr8", stamp_ns + NS // 100), stamp_ns + NS // 50
            )
            bag.write("/points", bag.cloud(records, stamp_ns), stamp_ns + NS // 30)
    return bag.path


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
