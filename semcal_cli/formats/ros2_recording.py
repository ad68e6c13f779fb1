"""A drive and its transform as a recording of ROS 2 in MCAP, which Foxglove shows and `semcal import bag` reads.

Messages are in CDR, with their definitions: mcap.dev/spec/registry. Their types are those of sensor_msgs and tf2_msgs.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.writer import Writer
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from semcal_cli.config.file_limits import MAX_TABLE_BYTES
from semcal_cli.config.nanoseconds import NS
from semcal_cli.drive.camera import Camera
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frames import Frame
from semcal_cli.errors import InputError
from semcal_cli.files.image_files import check_image, read_image
from semcal_cli.files.input_files import read_bytes
from semcal_cli.files.output_files import write_bytes
from semcal_cli.formats.camera_info import LENS, LENS_NAMES, camera_info_of
from semcal_cli.formats.frame_names import CAMERA, LIDAR
from semcal_cli.formats.lenses import check_lens
from semcal_cli.formats.pose import XYZ, XYZW, numbers_of
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse
from semcal_cli.observations.reading import read_clouds

TF_STATIC, POINTS = "/tf_static", "/points"
IMAGE, INTRINSICS = "/camera/image_raw/compressed", "/camera/camera_info"
IMAGE_FORMATS = {".png": "png", ".jpg": "jpeg", ".jpeg": "jpeg"}
"""Formats of images whose bytes are kept; others become PNG."""
FLOAT32, FLOAT64 = 7, 8
"""Datatypes of a PointField."""
MAX_STAMP_S = 1 << 31
"""Times in ROS 2 are before this, in seconds."""


class _Stamps(NamedTuple):
    """Times of a frame, in nanoseconds."""

    points_ns: int
    image_ns: int

    @property
    def received_ns(self) -> int:
        """Time at which both are there, so that a viewer shows them together."""
        return max(self)


def has_stamps(drive: Drive) -> bool:
    """Return whether all sweeps and images have times that ROS 2 can state."""
    stamps = [stamp for frame in drive.frames for stamp in (frame.points_stamp, frame.image_stamp)]
    return any(stamps) and all(stamp is not None and 0.0 <= stamp < MAX_STAMP_S for stamp in stamps)


def write_recording(drive: Drive, T_camera_lidar: Pose, path: Path) -> None:
    """Write a `.mcap`, as a whole or not at all.

    Points are written as they were recorded, not deskewed. Without times of all sweeps and images, frames are a second
    apart.

    Args:
        drive: The drive, whose frames are all written.
        T_camera_lidar: (4, 4), metres, written in /tf_static.
        path: File to write; its suffix is .mcap.

    Raises:
        InputError: the suffix is another one, a frame has no image, ROS has no name for the lens, a file of the drive
            is missing or wrong, or nothing can be written.
    """
    if path.suffix.lower() != ".mcap":
        raise InputError(f"{path}: found suffix {path.suffix!r}, expected .mcap")
    info, stamps = _camera_info(drive.camera), _stamps(drive)
    buffer = io.BytesIO()
    writer = _Ros2Writer(buffer)
    writer.write(
        TF_STATIC, "tf2_msgs/msg/TFMessage", _transform(T_camera_lidar, stamps[0]), stamps[0].points_ns
    )
    frames = zip(stamps, drive.frames, read_clouds(drive), strict=True)
    for times, frame, cloud in sorted(frames, key=lambda item: item[0].received_ns):
        header = _header(times.image_ns, CAMERA)
        records = _records(cloud.points, intensity=cloud.intensity, time=cloud.time)
        for topic, kind, content in (
            (INTRINSICS, "CameraInfo", {"header": header} | info),
            (IMAGE, "CompressedImage", {"header": header} | _image(drive, frame)),
            (POINTS, "PointCloud2", {"header": _header(times.points_ns, LIDAR)} | _cloud(records)),
        ):
            writer.write(topic, f"sensor_msgs/msg/{kind}", content, times.received_ns)
    writer.finish()
    write_bytes(buffer.getvalue(), path)


class _Ros2Writer:
    """Writes messages of ROS 2, with the definitions of their types."""

    def __init__(self, buffer: io.BytesIO) -> None:
        self._store: Any = get_typestore(Stores.ROS2_HUMBLE)
        self._writer: Any = Writer(buffer)
        self._writer.start(profile="ros2", library="semcal")
        self._channels: dict[str, int] = {}

    def write(self, topic: str, kind: str, content: dict[str, Any], received_ns: int) -> None:
        """Write a message of the fields in `content`; those that are left out are zero or empty."""
        if topic not in self._channels:
            definition, _ = self._store.generate_msgdef(kind, ros_version=2)
            schema = self._writer.register_schema(kind, "ros2msg", definition.encode())
            self._channels[topic] = self._writer.register_channel(topic, "cdr", schema)
        data = bytes(self._store.serialize_cdr(self._made(kind, content), kind))
        self._writer.add_message(self._channels[topic], received_ns, data, received_ns)

    def finish(self) -> None:
        """Write the index."""
        self._writer.finish()

    def _made(self, kind: str, content: dict[str, Any]) -> Any:
        fields = {
            name: self._value(node, of, content.get(name))
            for name, (node, of) in self._store.fielddefs[kind][1]
        }
        return self._store.types[kind](**fields)

    def _value(self, node: Any, of: Any, value: Any) -> Any:
        if node == Nodetype.NAME:
            return self._made(of, value or {})
        if node == Nodetype.BASE:
            return ("" if of[0] == "string" else 0) if value is None else value
        (inner_node, inner), count = of
        if inner_node == Nodetype.NAME:
            return [self._made(inner, item) for item in value or []]
        return np.zeros(count, inner[0]) if value is None else np.asarray(value, inner[0])


def _stamps(drive: Drive) -> list[_Stamps]:
    if not has_stamps(drive):
        # ROS takes a stamp of zero as none.
        return [_Stamps(index * NS, index * NS) for index in range(1, len(drive.frames) + 1)]
    return [_Stamps(*map(_stamp_ns, (frame.points_stamp, frame.image_stamp))) for frame in drive.frames]


def _stamp_ns(stamp_s: float | None) -> int:
    """Convert a stamp to nanoseconds, at least one, since ROS takes a stamp of zero as none."""
    return max(round(NS * (stamp_s or 0.0)), 1)


def _header(stamp_ns: int, frame: str) -> dict[str, Any]:
    return {"stamp": {"sec": stamp_ns // NS, "nanosec": stamp_ns % NS}, "frame_id": frame}


def _transform(T_camera_lidar: Pose, first: _Stamps) -> dict[str, Any]:
    """Make the fields of a TFMessage, T_parent_child of the camera in the LiDAR's frame."""
    values = numbers_of(inverse(T_camera_lidar))
    transform = {
        "translation": {name: values[name] for name in XYZ},
        "rotation": {name.removeprefix("q"): values[name] for name in XYZW},
    }
    header = _header(min(first), LIDAR)
    return {"transforms": [{"header": header, "child_frame_id": CAMERA, "transform": transform}]}


def _camera_info(camera: Camera) -> dict[str, Any]:
    """Make the fields of a CameraInfo, without its header."""
    check_lens("semcal export mcap", camera, LENS_NAMES)
    document = camera_info_of(camera, CAMERA)
    matrices = {
        "d": "distortion_coefficients",
        "k": "camera_matrix",
        "r": "rectification_matrix",
        "p": "projection_matrix",
    }
    sides = {"width": camera.width, "height": camera.height}
    numbers = {name: document[key]["data"] for name, key in matrices.items()}
    return sides | {"distortion_model": document[LENS]} | numbers


def _image(drive: Drive, frame: Frame) -> dict[str, Any]:
    """Make the fields of a CompressedImage: the bytes of a JPEG or PNG file, or a PNG of another one."""
    if frame.image is None:
        raise InputError(f"{drive.path}: {frame.key('image')}: found nothing, expected an image")
    path = drive.resolve(frame.image)
    if (name := IMAGE_FORMATS.get(path.suffix.lower())) is not None:
        check_image(path, drive.camera.size)
        content = read_bytes(path, limit=MAX_TABLE_BYTES)
    else:
        import cv2

        name = "png"
        content = cv2.imencode(".png", read_image(path, drive.camera.size))[1].tobytes()
    return {"format": name, "data": np.frombuffer(content, np.uint8)}


def _records(points: np.ndarray, **others: np.ndarray | None) -> np.ndarray:
    """Join points (N, 3), metres, with their other numbers (N,) that are known."""
    columns = dict(zip("xyz", points.T, strict=True))
    columns |= {name: values for name, values in others.items() if values is not None}
    layout = np.dtype([(name, values.dtype) for name, values in columns.items()])
    records = np.empty(len(points), layout)
    for name, values in columns.items():
        records[name] = values
    return records


def _cloud(records: np.ndarray) -> dict[str, Any]:
    """Make the fields of a PointCloud2, without its header."""
    layout = records.dtype
    fields = [
        {
            "name": name,
            "offset": layout.fields[name][1],
            "datatype": FLOAT64 if layout[name].itemsize == 8 else FLOAT32,
            "count": 1,
        }
        for name in layout.names or ()
        if layout.fields is not None
    ]
    return {
        "height": 1,
        "width": len(records),
        "fields": fields,
        "point_step": layout.itemsize,
        "row_step": layout.itemsize * len(records),
        "data": np.frombuffer(records.tobytes(), np.uint8),
        "is_dense": True,
    }
