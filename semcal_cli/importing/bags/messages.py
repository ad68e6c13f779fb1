"""Messages of recordings: headers are read from the first bytes, contents by ROS's own definitions."""

from __future__ import annotations

import struct
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from typing import Any, NamedTuple

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from semcal_cli.config.file_limits import MAX_FIELDS, MAX_MESSAGE_TRANSFORMS
from semcal_cli.config.nanoseconds import NS
from semcal_cli.errors import counted

CLOUD = "sensor_msgs/msg/PointCloud2"
LIVOX = ("livox_ros_driver/msg/CustomMsg", "livox_ros_driver2/msg/CustomMsg")
VELODYNE = "velodyne_msgs/msg/VelodyneScan"
OUSTER = ("ouster_ros/msg/PacketMsg", "ouster_msgs/msg/PacketMsg", "ouster_sensor_msgs/msg/PacketMsg")
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
VIDEO, FFMPEG = "foxglove_msgs/msg/CompressedVideo", "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
ODOMETRY, POSE = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped"
VIDEOS = (VIDEO, FFMPEG)
CLOUDS, IMAGES = (CLOUD, *LIVOX, VELODYNE), (IMAGE, COMPRESSED, *VIDEOS)
DEFINITIONS = {
    VIDEO: "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format",
    FFMPEG: "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\nuint64 pts\nuint8 flags\n"
    "bool is_bigendian\nuint8[] data",
    "velodyne_msgs/msg/VelodynePacket": "builtin_interfaces/Time stamp\nuint8[1206] data",
    VELODYNE: "std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets",
    **dict.fromkeys(TRANSFORMS, "geometry_msgs/TransformStamped[] transforms"),
}
"""Definitions of types that ROS itself lacks, or has in only one of its generations."""

HEADER_BYTES = 16
"""Bytes before the characters of `frame_id`: ROS 1's sequence or ROS 2's encapsulation, stamp and length."""
MAX_FRAME_ID = 4096


class MessageError(ValueError):
    """A message cannot be used; the text says what was found and what was needed."""


class Span(NamedTuple):
    """The messages of a topic."""

    num_messages: int = 0
    """Number of messages."""
    first_ns: int = 0
    """Time at which the first was received."""
    last_ns: int = 0
    """Time at which the last was received."""

    def join(self, other: Span) -> Span:
        """Join the messages of two parts."""
        if not (self.num_messages and other.num_messages):
            return self if self.num_messages else other
        count = self.num_messages + other.num_messages
        return Span(count, min(self.first_ns, other.first_ns), max(self.last_ns, other.last_ns))


@dataclass(frozen=True)
class Topic:
    """A topic of a recording; messages of another type under the same name are another topic."""

    name: str
    """Name of the topic."""
    type: str
    """Name of the type of its messages, such as sensor_msgs/msg/Image."""
    span: Span = field(default=Span(), compare=False)
    """Number and times of its messages."""
    is_ros1: bool = False
    """Whether its messages are serialized as in ROS 1 rather than in CDR."""
    kind: str = ""
    """ROS type with the same content as a Foxglove type; empty if `type` is a ROS type."""
    decode: Callable[[bytes], Any] | None = field(default=None, compare=False)
    """Reads a Foxglove message into the fields of the ROS type; None for ROS's own serializations."""

    def is_a(self, types: Collection[str]) -> bool:
        """Return whether its messages have the content of one of these ROS types."""
        return (self.kind or self.type) in types

    @property
    def rate_hz(self) -> float:
        """Messages per second; 0 if it has fewer than two."""
        duration_ns = self.span.last_ns - self.span.first_ns
        return (self.span.num_messages - 1) * NS / duration_ns if duration_ns > 0 else 0.0


@dataclass(frozen=True)
class Message:
    """A message as the recording holds it."""

    topic: Topic
    """Its topic."""
    received_ns: int
    """Time at which it was received."""
    raw: bytes
    """Its bytes."""

    def is_a(self, *types: str) -> bool:
        """Return whether it has the content of one of these ROS types."""
        return self.topic.is_a(types)

    @property
    def byte_order(self) -> str:
        """The character of the byte order in `struct`."""
        return "<" if self.topic.is_ros1 or self.raw[1:2] in (b"\1", b"\3") else ">"

    @property
    def header_ns(self) -> int:
        """The stamp of the header.

        Raises:
            MessageError: the message is too short for a header.
        """
        seconds, nanoseconds, _ = self._header
        return seconds * NS + nanoseconds

    @property
    def frame_id(self) -> str:
        """The coordinate frame of the header, without the leading slash that ROS 1 allows.

        Raises:
            MessageError: the message is too short for a header.
        """
        return plain_frame(self._header[2])

    @property
    def content(self) -> Any:
        """The message with the fields of ROS's type.

        Raises:
            MessageError: the bytes are not a message of this type.
        """
        if (read := self.topic.decode) is None:
            store = _types(self.topic.is_ros1)
            deserialize = store.deserialize_ros1 if self.topic.is_ros1 else store.deserialize_cdr
            read = partial(deserialize, typename=self.topic.type)
        try:
            if self.topic.decode is None:
                self._check_sequence()
            return read(self.raw)
        except MessageError:
            raise
        except Exception as error:  # Hostile bytes raise errors of any kind in the libraries.
            raise MessageError(
                f"found {counted(len(self.raw), 'byte')} of something else, expected a {self.topic.type}"
            ) from error

    def _check_sequence(self) -> None:
        """Check the length of the sequence of messages in this one, before the library reads each of its items.

        Raises:
            MessageError: it is too long.
            struct.error: the message is too short for a header.
        """
        start, name, limit = 0 if self.topic.is_ros1 else 4, "transforms", MAX_MESSAGE_TRANSFORMS
        if self.is_a(CLOUD):
            (length,) = struct.unpack_from(f"{self.byte_order}I", self.raw, HEADER_BYTES - 4)
            # The fields of the points follow the header, the height and the width, which CDR aligns.
            end = HEADER_BYTES + length
            start, name, limit = 8 + (end if self.topic.is_ros1 else -(-end // 4) * 4), "fields", MAX_FIELDS
        elif not self.is_a(*TRANSFORMS):
            return
        if start + 4 <= len(self.raw):
            (count,) = struct.unpack_from(f"{self.byte_order}I", self.raw, start)
            if count > limit:
                raise MessageError(f"found {count:,} {name}, needed at most {limit:,}")

    @cached_property
    def _header(self) -> tuple[int, int, str]:
        """Seconds and nanoseconds of the stamp, and the frame; ROS messages are not read beyond their header."""
        if self.topic.decode is not None:
            header = self.content.header
            return header.stamp.sec, header.stamp.nanosec, header.frame_id
        if len(self.raw) < HEADER_BYTES:
            raise MessageError(
                f"found {counted(len(self.raw), 'byte')}, expected a header of {HEADER_BYTES} or more"
            )
        is_ros1 = self.topic.is_ros1
        # A CompressedVideo of ROS 1 does not begin with a sequence number.
        start = 0 if is_ros1 and self.is_a(VIDEO) else 4
        seconds, nanoseconds, length = struct.unpack_from(
            f"{self.byte_order}{'I' if is_ros1 else 'i'}II", self.raw, start
        )
        name = self.raw[start + 12 :][:length] if length <= MAX_FRAME_ID else b""
        if len(name) < length:
            raise MessageError(f"found a frame_id of {length:,} characters in {len(self.raw):,} bytes")
        return seconds, nanoseconds, name.decode("utf-8", "replace")


def plain_frame(name: str) -> str:
    """Remove leading slashes and trailing zero bytes from the name of a coordinate frame."""
    return name.rstrip("\0").lstrip("/")


@cache
def _types(is_ros1: bool) -> Any:
    """Load ROS's own definitions; those in a recording are not needed for the usual messages and may be broken."""
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        if name not in store.fielddefs:
            plain = text.replace("builtin_interfaces/Time", "time") if is_ros1 else text
            store.register(get_types_from_msg(plain, name))
    return store


def frame_of(message: Message) -> str | None:
    """Read the frame of a message; None if it is damaged."""
    try:
        return message.frame_id
    except MessageError:
        return None
