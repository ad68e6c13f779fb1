"""Messages of recordings: their header from their first bytes, and their content by ROS's own definitions."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any, NamedTuple

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

CLOUD = "sensor_msgs/msg/PointCloud2"
LIVOX = ("livox_ros_driver/msg/CustomMsg", "livox_ros_driver2/msg/CustomMsg")
PICTURE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
ODOMETRY, POSE = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped"
CLOUDS, PICTURES = (CLOUD, *LIVOX), (PICTURE, COMPRESSED)

HEADER_BYTES = 16
"""Bytes before the characters of `frame_id`: ROS 1's sequence or ROS 2's encapsulation, stamp and length."""
MAX_FRAME_ID = 4096
NS = 1_000_000_000


class MessageError(ValueError):
    """A message cannot be used; the text says what was found and what was needed."""


class Span(NamedTuple):
    """The messages of a topic."""

    num_messages: int = 0
    """Number of messages."""
    first_ns: int = 0
    """Time of the first, as it was received."""
    last_ns: int = 0
    """Time of the last."""

    def joined(self, other: Span) -> Span:
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
    """Name of the type of its messages, as sensor_msgs/msg/Image."""
    span: Span = field(default=Span(), compare=False)
    """Number and times of its messages."""

    @property
    def rate_hz(self) -> float:
        """Messages a second; 0 if it has fewer than two."""
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
    is_ros1: bool
    """Whether the bytes are those of ROS 1, and not CDR."""

    @property
    def type(self) -> str:
        """Name of its type."""
        return self.topic.type

    @property
    def byte_order(self) -> str:
        """The sign of the byte order in `struct`."""
        return "<" if self.is_ros1 or self.raw[1:2] in (b"\1", b"\3") else ">"

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
        """The coordinate frame of the header, without the slash in front that ROS 1 allows.

        Raises:
            MessageError: the message is too short for a header.
        """
        _, _, length = self._header
        if length > min(MAX_FRAME_ID, len(self.raw) - HEADER_BYTES):
            raise MessageError(f"found a frame_id of {length:,} characters in {len(self.raw):,} bytes")
        name = self.raw[HEADER_BYTES : HEADER_BYTES + length]
        return plain_frame(name.decode("utf-8", "replace"))

    @property
    def content(self) -> Any:
        """The message with its fields.

        Raises:
            MessageError: the bytes are no message of this type.
        """
        store = _types(self.is_ros1)
        read = store.deserialize_ros1 if self.is_ros1 else store.deserialize_cdr
        try:
            return read(self.raw, self.type)
        except Exception as error:  # Hostile bytes raise errors of any kind in the library.
            raise MessageError(f"found {len(self.raw):,} bytes that are no {self.type}") from error

    @cached_property
    def _header(self) -> tuple[int, int, int]:
        """Seconds and nanoseconds of the stamp, and the length of the frame's name."""
        if len(self.raw) < HEADER_BYTES:
            raise MessageError(f"found {len(self.raw)} bytes, needed a header of {HEADER_BYTES} or more")
        seconds, nanoseconds, length = struct.unpack_from(
            f"{self.byte_order}{'I' if self.is_ros1 else 'i'}II", self.raw, 4
        )
        return seconds, nanoseconds, length


def plain_frame(name: str) -> str:
    """Remove what does not count in the name of a coordinate frame."""
    return name.rstrip("\0").lstrip("/")


@cache
def _types(is_ros1: bool) -> Any:
    """Load ROS's own definitions; those in a recording are not needed for its usual messages, and can be broken."""
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    for name in set(TRANSFORMS) - store.fielddefs.keys():
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", name))
    return store
