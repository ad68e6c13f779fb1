"""Messages of Foxglove's schemas (docs.foxglove.dev), in Protobuf or JSON, converted to the fields of ROS types."""

from __future__ import annotations

import json
from base64 import b64decode
from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from mcap.records import Schema

from semcal_cli.config.file_limits import MAX_FIELDS, MAX_MESSAGE_TRANSFORMS
from semcal_cli.errors import check_installed, counted, describe, reason
from semcal_cli.importing.bags.messages import (
    CAMERA_INFO,
    CLOUD,
    COMPRESSED,
    IMAGE,
    MAX_FRAME_ID,
    POSE,
    TRANSFORMS,
    VIDEO,
    MessageError,
)
from semcal_cli.importing.bags.protobuf_values import check_values

POINT_FIELD_TYPES = {1: 2, 2: 1, 3: 4, 4: 3, 5: 6, 6: 5, 7: 7, 8: 8}
"""Datatype of a sensor_msgs/PointField by that of a PackedElementField."""
CAMERA_NUMBERS = {"D": range(33), "K": (0, 9), "R": (0, 9), "P": (0, 12)}
"""How many numbers the arrays of a camera may have."""
MAX_WHOLE, MAX_SECONDS = (1 << 32) - 1, 1 << 33
"""Largest whole number in ROS messages, and largest time before or after 1970, in seconds."""
MAX_UNCHECKED_BYTES = 1 << 16
"""Largest Protobuf message whose values are not counted before it is parsed."""
MAX_JSON_BYTES, MAX_JSON_VALUES = 1 << 28, 1 << 20
"""Largest message in JSON, and largest number of values in it: in memory, a value takes a hundred times its bytes."""


def _header(message: Any, frame: str = "frame_id") -> SimpleNamespace:
    time = message.timestamp
    is_json = hasattr(time, "nsec")
    seconds = int(time.sec if is_json else time.seconds)
    if abs(seconds) > MAX_SECONDS:
        raise MessageError(
            f"found a stamp of {describe(seconds)} s, expected one within {MAX_SECONDS:,} s of 1970"
        )
    stamp = SimpleNamespace(sec=seconds, nanosec=_whole(time, "nsec" if is_json else "nanos"))
    return SimpleNamespace(stamp=stamp, frame_id=_text(message, frame))


def _whole(message: Any, name: str) -> int:
    """Read a number that is unsigned in ROS; JSON can hold any number."""
    number = int(getattr(message, name))
    if not 0 <= number <= MAX_WHOLE:
        raise MessageError(
            f"found {name} {describe(number)}, expected a whole number from 0 to {MAX_WHOLE:,}"
        )
    return number


def _text(message: Any, name: str) -> str:
    text = getattr(message, name)
    if not isinstance(text, str) or len(text) > MAX_FRAME_ID:
        raise MessageError(
            f"found {name} {describe(text)}, expected a string of up to {MAX_FRAME_ID:,} characters"
        )
    return text.encode("utf-8", "replace").decode()


def _data(message: Any) -> np.ndarray:
    data = message.data
    if not isinstance(data, (str, bytes, list)):
        raise MessageError(f"found data {describe(data)}, expected bytes")
    content = b64decode(data, validate=True) if isinstance(data, str) else bytes(data)
    return np.frombuffer(content, np.uint8)


def _point_cloud(message: Any) -> SimpleNamespace:
    pose = getattr(message, "pose", None)
    if pose is not None:
        position, orientation = pose.position, pose.orientation
        if any(map(float, (position.x, position.y, position.z, orientation.x, orientation.y, orientation.z))):
            raise MessageError("found points with their own pose, expected points in their frame")
    if len(message.fields) > MAX_FIELDS:
        raise MessageError(f"found {len(message.fields):,} fields, needed at most {MAX_FIELDS}")
    data, step = _data(message), _whole(message, "point_stride")
    fields = [
        SimpleNamespace(
            name=_text(field, "name"),
            offset=_whole(field, "offset"),
            datatype=POINT_FIELD_TYPES.get(int(field.type), 0),
            count=1,
        )
        for field in message.fields
    ]
    width = len(data) // step if step > 0 else 1
    return SimpleNamespace(
        header=_header(message),
        height=1,
        width=width,
        fields=fields,
        is_bigendian=False,
        point_step=step,
        row_step=width * step,
        data=data,
    )


def _raw_image(message: Any) -> SimpleNamespace:
    return SimpleNamespace(
        header=_header(message),
        height=_whole(message, "height"),
        width=_whole(message, "width"),
        encoding=_text(message, "encoding"),
        is_bigendian=0,
        step=_whole(message, "step"),
        data=_data(message),
    )


def _compressed(message: Any) -> SimpleNamespace:
    return SimpleNamespace(header=_header(message), format=_text(message, "format"), data=_data(message))


def _camera_calibration(message: Any) -> SimpleNamespace:
    numbers = {}
    for name, counts in CAMERA_NUMBERS.items():
        values = getattr(message, name, ())
        if len(values) not in counts:
            raise MessageError(f"found {counted(len(values), 'number')} in {name}, needed {max(counts)}")
        numbers[name] = [float(value) for value in values]
    region = SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0)
    # R and P stay zero if they are left out.
    numbers = {"R": [0.0] * 9, "P": [0.0] * 12} | {name: values for name, values in numbers.items() if values}
    return SimpleNamespace(
        header=_header(message),
        width=_whole(message, "width"),
        height=_whole(message, "height"),
        distortion_model=_text(message, "distortion_model"),
        binning_x=0,
        binning_y=0,
        roi=region,
        **({"D": [], "K": [0.0] * 9} | numbers),
    )


def _transforms(message: Any) -> SimpleNamespace:
    transforms = message.transforms if hasattr(message, "transforms") else [message]
    if len(transforms) > MAX_MESSAGE_TRANSFORMS:
        raise MessageError(f"found {len(transforms):,} transforms, needed at most {MAX_MESSAGE_TRANSFORMS:,}")
    return SimpleNamespace(
        transforms=[
            SimpleNamespace(
                header=_header(transform, "parent_frame_id"),
                child_frame_id=_text(transform, "child_frame_id"),
                transform=SimpleNamespace(
                    rotation=_numbers(transform.rotation, "xyzw"),
                    translation=_numbers(transform.translation, "xyz"),
                ),
            )
            for transform in transforms
        ]
    )


def _pose_in_frame(message: Any) -> SimpleNamespace:
    pose = SimpleNamespace(
        orientation=_numbers(message.pose.orientation, "xyzw"),
        position=_numbers(message.pose.position, "xyz"),
    )
    return SimpleNamespace(header=_header(message), pose=pose)


def _numbers(value: Any, names: str) -> SimpleNamespace:
    return SimpleNamespace(**{name: float(getattr(value, name)) for name in names})


TRANSLATIONS: dict[str, tuple[str, Callable[[Any], SimpleNamespace]]] = {
    "foxglove.PointCloud": (CLOUD, _point_cloud),
    "foxglove.RawImage": (IMAGE, _raw_image),
    "foxglove.CompressedImage": (COMPRESSED, _compressed),
    "foxglove.CompressedVideo": (VIDEO, _compressed),
    "foxglove.CameraCalibration": (CAMERA_INFO, _camera_calibration),
    "foxglove.FrameTransform": (TRANSFORMS[0], _transforms),
    "foxglove.FrameTransforms": (TRANSFORMS[0], _transforms),
    "foxglove.PoseInFrame": (POSE, _pose_in_frame),
}
"""ROS type with the same content, and the function that translates a message, by the name of Foxglove's schema."""


def reader(encoding: str, schema: Schema) -> tuple[str, Callable[[bytes], Any] | None]:
    """Find the function that reads the messages of a channel.

    Args:
        encoding: `protobuf` or `json`.
        schema: The channel's schema.

    Returns:
        The ROS type with the same content, and the function that reads a message into the fields of that type; empty
        and None for an unused schema.

    Raises:
        InputError: the library for Protobuf is not installed.
    """
    kind, translate = TRANSLATIONS.get(schema.name, ("", None))
    if translate is None:
        return "", None
    if encoding == "json":
        return kind, lambda raw: translate(_parse_json(raw))
    check_installed(schema.name, "mcap_protobuf", "bag")

    @cache
    def parser() -> Callable[[bytes], Any] | MessageError:
        from mcap_protobuf.decoder import DecoderFactory

        try:
            decoder = DecoderFactory().decoder_for(encoding, schema)
        except Exception as error:  # Hostile descriptors raise errors of any kind in the libraries.
            return MessageError(f"found a schema {schema.name} that cannot be read: {reason(error)[:120]}")
        return decoder or MessageError(f"found a schema in {describe(schema.encoding)}, expected 'protobuf'")

    @cache
    def descriptor() -> Any:
        return parser()(b"").DESCRIPTOR  # type: ignore[operator]

    def read(raw: bytes) -> Any:
        if isinstance(parse := parser(), MessageError):
            raise MessageError(*parse.args)
        if len(raw) > MAX_UNCHECKED_BYTES:
            check_values(raw, descriptor())
        return translate(parse(raw))

    return kind, read


def _parse_json(raw: bytes) -> Any:
    num_values = sum(map(raw.count, (b",", b"[", b"{")))
    if len(raw) > MAX_JSON_BYTES or num_values > MAX_JSON_VALUES:
        description = f"{len(raw):,} bytes of JSON with {num_values:,} values or more"
        raise MessageError(f"found {description}, needed at most {MAX_JSON_BYTES:,} and {MAX_JSON_VALUES:,}")
    return json.loads(raw, object_hook=lambda fields: SimpleNamespace(**fields))
