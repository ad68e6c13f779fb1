"""Recordings for tests in Foxglove's own schemas, by its published classes, and videos by PyAV."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from datetime import datetime, timezone
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import Any

import av
import numpy as np
from bags import NS, BagWriter, position, rotation
from google.protobuf.json_format import ParseDict
from mcap.writer import Writer as McapWriter
from mcap_protobuf.writer import Writer as ProtobufWriter

from semcal_cli.geometry.arrays import Pose

TYPES = {"u1": 1, "i1": 2, "u2": 3, "i2": 4, "u4": 5, "i4": 6, "f4": 7, "f8": 8}
"""Datatypes of a PackedElementField."""
ENCODERS = {"h264": "libx264", "h265": "libx265", "av1": "libsvtav1"}


class FoxgloveWriter:
    """Writes messages of Foxglove's schemas, in Protobuf or JSON; images also as a video."""

    def __init__(self, folder: Path, encoding: str) -> None:
        self.path, self._encoding = folder / "bag.mcap", encoding
        self._stack, self._channels = ExitStack(), dict[str, int]()
        file = self._stack.enter_context(self.path.open("wb"))
        self._writer: Any = McapWriter(file) if encoding == "json" else ProtobufWriter(file)
        if encoding == "json":
            self._writer.start(profile="", library="test")
        self._stack.callback(self._writer.finish)

    def __enter__(self) -> FoxgloveWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def write(self, topic: str, message: tuple[str, dict[str, Any]], received_ns: int) -> None:
        """Write a message: the name of its schema, and its fields as in JSON."""
        name, fields = message
        if self._encoding == "json":
            if topic not in self._channels:
                schema = self._writer.register_schema(f"foxglove.{name}", "jsonschema", b"{}")
                self._channels[topic] = self._writer.register_channel(topic, "json", schema)
            self._writer.add_message(
                self._channels[topic], received_ns, json.dumps(fields).encode(), publish_time=received_ns
            )
            return
        kind = getattr(import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name)
        self._writer.write_message(topic, ParseDict(_as_protobuf(fields), kind()), received_ns, received_ns)

    def cloud(self, records: np.ndarray, stamp_ns: int, frame: str = "lidar", **changes: Any) -> Any:
        layout = records.dtype
        fields = [
            {"name": name, "offset": layout.fields[name][1], "type": TYPES[layout[name].str[1:]]}
            for name in layout.names or ()
        ]  # fmt: skip
        values = {"point_stride": layout.itemsize, "fields": fields, "data": _base64(records.tobytes())}
        return "PointCloud", header(stamp_ns, frame) | values | changes

    def image(self, pixels: np.ndarray, encoding: str, stamp_ns: int, **changes: Any) -> Any:
        height, width = pixels.shape[:2]
        values = {"width": width, "height": height, "encoding": encoding, "step": pixels[0].nbytes}
        return "RawImage", header(stamp_ns) | values | {"data": _base64(pixels.tobytes())} | changes

    def compressed(self, content: bytes, name: str, stamp_ns: int) -> Any:
        return "CompressedImage", header(stamp_ns) | {"format": name, "data": _base64(content)}

    def video(self, content: bytes, name: str, stamp_ns: int) -> Any:
        return "CompressedVideo", header(stamp_ns) | {"format": name, "data": _base64(content)}

    def camera_info(self, camera: Any, stamp_ns: int, **changes: Any) -> Any:
        values = {"width": camera.width, "height": camera.height, "distortion_model": camera.model}
        numbers = {"D": list(camera.distortion), "K": np.ravel(camera.K).tolist()}
        return "CameraCalibration", header(stamp_ns) | values | numbers | changes

    def transforms(self, edges: dict[tuple[str, str], Pose], stamp_ns: int = 0) -> Any:
        stated = [
            {"timestamp": time(stamp_ns), "parent_frame_id": parent, "child_frame_id": child,
             "translation": position(T), "rotation": rotation(T)}
            for (parent, child), T in edges.items()
        ]  # fmt: skip
        return "FrameTransforms", {"transforms": stated}


class VideoWriter:
    """Passes messages on, but images as the packets of a video."""

    def __init__(self, writer: Any, codec: str, key_every: int = 5) -> None:
        self.writer, self.path, self._codec, self._key_every = writer, writer.path, codec, key_every
        self._images: list[tuple[np.ndarray, str, int, int]] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self.writer, name)

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(self, *error: Any) -> None:
        pixels = [each for each, *_ in self._images]
        with self.writer:
            for (_, topic, stamp, received), data in zip(
                self._images, encoded(pixels, self._codec, self._key_every), strict=True
            ):
                self.writer.write(topic, self._packet(data, stamp), received)

    def image(self, pixels: np.ndarray, encoding: str, stamp_ns: int, **changes: Any) -> Any:
        return pixels, stamp_ns

    def write(self, topic: str, message: Any, received_ns: int) -> None:
        if isinstance(message, tuple) and isinstance(message[0], np.ndarray):
            self._images.append((message[0], topic, message[1], received_ns))
        else:
            self.writer.write(topic, message, received_ns)

    def _packet(self, data: bytes, stamp_ns: int) -> Any:
        if isinstance(self.writer, FoxgloveWriter):
            return self.writer.video(data, self._codec, stamp_ns)
        assert isinstance(self.writer, BagWriter)
        return self.writer.packet(data, self._codec, stamp_ns)


def encoded(images: list[np.ndarray], codec: str, key_every: int) -> list[bytes]:
    """Encode images (H, W, 3) blue, green, red, of which every so many is a key frame; a packet each."""
    # SVT-AV1 gives the thread that calls it, if root's, real-time priority for good: beside it, nothing else would run.
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(lambda: list(_packets(images, codec, key_every))).result()


def _packets(images: list[np.ndarray], codec: str, key_every: int) -> Iterator[bytes]:
    context = av.CodecContext.create(ENCODERS[codec], "w")
    assert isinstance(context, av.VideoCodecContext)
    context.height, context.width = images[0].shape[:2]
    context.pix_fmt, context.framerate, context.gop_size, context.max_b_frames = "yuv420p", 10, key_every, 0
    # No frame waits for a later one, as in streams of robots.
    context.options = {
        "h264": {"preset": "veryfast"},
        "h265": {"preset": "veryfast", "x265-params": "log-level=none"},
        "av1": {"preset": "8", "svtav1-params": "pred-struct=1"},
    }[codec] | {"crf": "8"}
    for pts, pixels in enumerate(images):
        frame = av.VideoFrame.from_ndarray(pixels, format="bgr24").reformat(format="yuv420p")
        frame.pts = pts
        yield from map(bytes, context.encode(frame))
    yield from map(bytes, context.encode(None))


def header(stamp_ns: int, frame: str = "optical") -> dict[str, Any]:
    """Fields in front of all messages."""
    return {"timestamp": time(stamp_ns), "frame_id": frame}


def time(stamp_ns: int) -> dict[str, int]:
    """Fields of a time in JSON."""
    return {"sec": stamp_ns // NS, "nsec": stamp_ns % NS}


def _base64(content: bytes) -> str:
    return b64encode(content).decode()


def _as_protobuf(fields: Any) -> Any:
    """Write times as Protobuf's JSON does."""
    if isinstance(fields, list):
        return [_as_protobuf(each) for each in fields]
    if not isinstance(fields, dict):
        return fields
    if fields.keys() == {"sec", "nsec"}:
        moment = datetime.fromtimestamp(fields["sec"], timezone.utc)
        return f"{moment:%Y-%m-%dT%H:%M:%S}.{fields['nsec']:09d}Z"
    return {key: _as_protobuf(each) for key, each in fields.items()}
