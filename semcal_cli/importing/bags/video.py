"""Images of a video stream, decoded by PyAV from the key frame before them."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

import cv2
import numpy as np

from semcal_cli.config.file_limits import MAX_PIXELS_A_BYTE, MAX_VIDEO_PIXELS, MIN_VIDEO_PIXELS
from semcal_cli.config.nanoseconds import NS
from semcal_cli.errors import InputError
from semcal_cli.geometry.arrays import Image
from semcal_cli.importing.bags.bag import Bag
from semcal_cli.importing.bags.image_messages import PNG_SPEED
from semcal_cli.importing.bags.messages import COMPRESSED, FFMPEG, Message, MessageError, Topic

if TYPE_CHECKING:
    from av import VideoFrame

CODECS = {"264": "h264", "265": "hevc", "hevc": "hevc", "av1": "libdav1d"}
"""Decoders, by a part of the name of the encoding or of the encoder, which may be `libx264` or `hevc_nvenc`."""
NAL_UNIT = re.compile(rb"\x00\x00\x01(.)", re.DOTALL)
H264_KEY, HEVC_KEYS = 5, range(16, 22)
"""Types of the NAL units of key frames (ITU-T H.264, table 7-1; H.265, table 7-1)."""
AV1_SEQUENCE = 1
"""Type of the unit with which a key frame of AV1 begins, after a temporal delimiter."""
FFMPEG_KEY = 1
"""Flag of a key frame in an FFMPEGPacket."""
MAX_GROUP_BYTES = 1 << 28
"""Largest size of a key frame together with the frames up to the next one."""


class PictureGroup:
    """A key frame, and the frames that follow until the next one."""

    def __init__(self, codec: str) -> None:
        self.codec = codec
        self.frames: list[bytes] = []
        """Frames as they are stored, the key frame first."""
        self.num_bytes = 0


class _Frame(NamedTuple):
    """A frame as it is stored."""

    codec: str
    """Its decoder."""
    data: bytes
    """Its bytes."""
    is_marked: bool
    """Whether its packet says that it is a key frame."""

    @property
    def is_key(self) -> bool:
        """Whether it is a key frame."""
        if self.is_marked:
            return True
        match self.codec:
            case "h264":
                return H264_KEY in _nal_units(self.data, 0, 0x1F)
            case "hevc":
                return any(kind in HEVC_KEYS for kind in _nal_units(self.data, 1, 0x3F))
        return AV1_SEQUENCE in _av1_units(self.data)


@dataclass(frozen=True)
class Packet(Message):
    """A frame of a video, with the group that it belongs to."""

    group: PictureGroup | None = field(default=None, compare=False, repr=False)
    """Its group; None before the first key frame."""
    index: int = 0
    """Its place in the group."""


@dataclass(frozen=True)
class Still(Message):
    """A decoded frame of a video, whose bytes are those of a PNG."""

    def is_a(self, *types: str) -> bool:
        """Return whether `types` include CompressedImage, whose content it has."""
        return COMPRESSED in types

    @property
    def content(self) -> Any:
        """The image with the fields of a CompressedImage."""
        return SimpleNamespace(format="png", data=np.frombuffer(self.raw, np.uint8))


class Video:
    """The frames of a video topic, each with the group that it is decoded from."""

    def __init__(self, bag: Bag, topic: Topic) -> None:
        """Read the packets of a topic."""
        self._bag, self._topic = bag, topic
        self._group: PictureGroup | None = None
        self._read_ns = bag.start_ns
        self._decoder: _Decoder | None = None
        self._num_bytes = self._num_pixels = 0

    def seek(self, start_ns: int) -> None:
        """Advance to the time from which packets are taken next, and find the group that contains it."""
        back_ns = NS
        while self._read_ns < start_ns:
            first_ns = max(start_ns - back_ns, self._read_ns)
            packets = self._bag.messages([self._topic], first_ns, start_ns)
            last = packets if first_ns == self._read_ns else _last_group(packets)
            if last is not None:
                for packet in last:
                    self.take(packet)
                self._read_ns = start_ns
            back_ns *= 2

    def take(self, message: Message) -> Packet:
        """Take the next packet of the topic."""
        self._read_ns = message.received_ns + 1
        try:
            frame = _frame(message)
        except MessageError:
            return Packet(message.topic, message.received_ns, message.raw)
        data = frame.data
        if frame.is_key:
            self._group = PictureGroup(frame.codec)
        group = self._group
        if group is not None and group.num_bytes + len(data) > MAX_GROUP_BYTES:
            group = self._group = None
        if group is not None:
            group.frames.append(data)
            group.num_bytes += len(data)
        index = 0 if group is None else len(group.frames) - 1
        return Packet(message.topic, message.received_ns, message.raw, group, index)

    def still(self, packet: Packet) -> Still:
        """Decode a frame.

        Raises:
            MessageError: it is damaged, its encoding is not supported, or no key frame precedes it.
        """
        codec = _frame(packet).codec
        if packet.group is None or packet.group.codec != codec:
            raise MessageError(
                f"found a video frame without a key frame in the {MAX_GROUP_BYTES >> 20} MiB before it"
            )
        if self._decoder is None or not self._decoder.is_before(packet.group, packet.index):
            self._decoder = _Decoder(packet.group, self._count)
        pixels = self._decoder.frame(packet.index)
        _, content = cv2.imencode(".png", pixels, PNG_SPEED)
        return Still(packet.topic, packet.received_ns, content.tobytes())

    def _count(self, num_bytes: int, frames: Iterable[VideoFrame]) -> None:
        """Count what is decoded in all.

        Raises:
            InputError: it is too much for the size of the video.
        """
        self._num_bytes += num_bytes
        self._num_pixels += sum(frame.width * frame.height for frame in frames)
        if self._num_pixels > max(MAX_PIXELS_A_BYTE * self._num_bytes, MIN_VIDEO_PIXELS):
            found = f"a video of {self._num_pixels:,} pixels in {self._num_bytes:,} bytes"
            needed = f"needed at most {MAX_PIXELS_A_BYTE:,} a byte"
            raise InputError(f"{self._bag.paths[0]}: {self._topic.name}: found {found}, {needed}")


class _Decoder:
    """Decodes the frames of a group in their order."""

    def __init__(self, group: PictureGroup, count: Callable[[int, Iterable[VideoFrame]], None]) -> None:
        import av

        self._group, self._next, self._count = group, 0, count
        self._ready: deque[VideoFrame] = deque()
        self._is_flushed = False
        context = av.CodecContext.create(group.codec, "r")
        assert isinstance(context, av.VideoCodecContext)
        # Threads that decode one frame each would delay frames, and a multithreaded decoder of AV1 never ends if a
        # frame is cut off.
        context.thread_count = 1
        context.options = {"max_pixels": str(MAX_VIDEO_PIXELS)}
        self._context = context

    def is_before(self, group: PictureGroup, index: int) -> bool:
        """Return whether the decoder can still return a frame."""
        first = min([frame.pts for frame in self._ready if frame.pts is not None], default=self._next)
        return group is self._group and index >= first and not (self._is_flushed and index >= self._next)

    def frame(self, index: int) -> Image:
        """Decode the frames up to one, and return that one (H, W, 3): blue, green, red.

        Raises:
            MessageError: it is damaged, or the decoder does not return it.
        """
        import av

        try:
            while not self._is_flushed or self._ready:
                while self._ready:
                    frame = self._ready.popleft()
                    if frame.pts == index:
                        if frame.is_corrupt:
                            raise MessageError("found a damaged video frame")
                        return np.asarray(frame.to_ndarray(format="bgr24"), np.uint8)
                packet = None
                if self._next < len(self._group.frames):
                    packet = av.Packet(self._group.frames[self._next])
                    packet.pts, self._next = self._next, self._next + 1
                self._is_flushed = packet is None
                frames = self._context.decode(packet)
                self._count(0 if packet is None else packet.size, frames)
                self._ready.extend(frames)
        except av.FFmpegError as error:
            self._is_flushed = True
            raise MessageError(f"found a damaged video frame: {error.strerror}") from None
        raise MessageError("found a video frame that its decoder does not return")


def _last_group(packets: Iterable[Message]) -> list[Message] | None:
    """Find the last key frame and the frames after it; none of a group that is too large, None without a key frame."""
    group: list[Message] | None = None
    num_bytes = 0
    for packet in packets:
        with suppress(MessageError):
            if _frame(packet).is_key:
                group, num_bytes = [], 0
        if group is not None:
            num_bytes += len(packet.raw)
            if num_bytes <= MAX_GROUP_BYTES:
                group.append(packet)
            else:
                group.clear()
    return group


def _frame(message: Message) -> _Frame:
    """Read the frame of a packet.

    Raises:
        MessageError: the message is damaged, or its encoding is not supported.
    """
    content = message.content
    name = content.encoding if message.is_a(FFMPEG) else content.format
    # Later versions of ffmpeg_image_transport add pixel formats after semicolons.
    encoding = name.split(";")[0].lower()
    codec = next((codec for part, codec in CODECS.items() if part in encoding), None)
    if codec is None:
        raise MessageError(f"found a video in {name[:40]!r}, expected H.264, H.265 or AV1")
    return _Frame(codec, content.data.tobytes(), bool(message.is_a(FFMPEG) and content.flags & FFMPEG_KEY))


def _nal_units(data: bytes, shift: int, mask: int) -> Iterator[int]:
    return (match[1][0] >> shift & mask for match in NAL_UNIT.finditer(data))


def _av1_units(data: bytes) -> Iterator[int]:
    """Yield the types of the open bitstream units of a packet, whose sizes are stated (AV1 specification, 5.3)."""
    offset = 0
    while offset < len(data):
        header, size, shift = data[offset], 0, 0
        yield header >> 3 & 0xF
        offset += 2 if header & 4 else 1
        if not header & 2:
            break
        while offset < len(data):
            byte = data[offset]
            size |= (byte & 0x7F) << shift
            offset, shift = offset + 1, shift + 7
            if not byte & 0x80 or shift > 28:
                break
        offset += size
