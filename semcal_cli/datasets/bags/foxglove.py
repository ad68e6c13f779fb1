"""Messages of Foxglove's schemas (docs.foxglove.dev), in Protobuf or JSON, with the fields of ROS's types."""

from __future__ import annotations

import json
from base64 import b64decode
from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from mcap.records import Schema

from semcal_cli.datasets.bags.messages import (
    CAMERA_INFO,
    CLOUD,
    COMPRESSED,
    PICTURE,
    POSE,
    TRANSFORMS,
    VIDEO,
    MessageError,
)
from semcal_cli.errors import check_installed

POINT_FIELD_TYPES = {1: 2, 2: 1, 3: 4, 4: 3, 5: 6, 6: 5, 7: 7, 8: 8}
"""Datatype of a sensor_msgs/PointField by that of a PackedElementField."""


def _header(message: Any, frame: str = "frame_id") -> SimpleNamespace:
    time = message.timestamp
    is_json = hasattr(time, "nsec")
    stamp = SimpleNamespace(
        sec=int(time.sec if is_json else time.seconds),
        nanosec=int(time.nsec if is_json else time.nanos),
    )
    return SimpleNamespace(stamp=stamp, frame_id=str(getattr(message, frame)))


def _data(message: Any) -> np.ndarray:
    data = message.data
    content = b64decode(data, validate=True) if isinstance(data, str) else bytes(data)
    return np.frombuffer(content, np.uint8)


def _point_cloud(message: Any) -> SimpleNamespace:
    pose = getattr(message, "pose", None)
    if pose is not None:
        place, turn = pose.position, pose.orientation
        if any(map(float, (place.x, place.y, place.z, turn.x, turn.y, turn.z))):
            raise MessageError("found points with a pose of their own, needed points in their frame")
    data, step = _data(message), int(message.point_stride)
    fields = [
        SimpleNamespace(
            name=str(each.name),
            offset=int(each.offset),
            datatype=POINT_FIELD_TYPES.get(int(each.type), 0),
            count=1,
        )
        for each in message.fields
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
        height=int(message.height),
        width=int(message.width),
        encoding=str(message.encoding),
        is_bigendian=0,
        step=int(message.step),
        data=_data(message),
    )


def _compressed(message: Any) -> SimpleNamespace:
    return SimpleNamespace(header=_header(message), format=str(message.format), data=_data(message))


def _camera_calibration(message: Any) -> SimpleNamespace:
    numbers = {name: [float(each) for each in getattr(message, name, ())] for name in "DKRP"}
    region = SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0)
    # R and P that are left out stay zero.
    numbers = {"R": [0.0] * 9, "P": [0.0] * 12} | {name: each for name, each in numbers.items() if each}
    return SimpleNamespace(
        header=_header(message),
        width=int(message.width),
        height=int(message.height),
        distortion_model=str(message.distortion_model),
        binning_x=0,
        binning_y=0,
        roi=region,
        **({"D": [], "K": [0.0] * 9} | numbers),
    )


def _transforms(message: Any) -> SimpleNamespace:
    several = message.transforms if hasattr(message, "transforms") else [message]
    return SimpleNamespace(
        transforms=[
            SimpleNamespace(
                header=_header(each, "parent_frame_id"),
                child_frame_id=str(each.child_frame_id),
                transform=SimpleNamespace(
                    rotation=_numbers(each.rotation, "xyzw"), translation=_numbers(each.translation, "xyz")
                ),
            )
            for each in several
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
    "foxglove.RawImage": (PICTURE, _raw_image),
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
        and None for a schema that is not used.

    Raises:
        InputError: the library for Protobuf is not installed.
    """
    kind, translate = TRANSLATIONS.get(schema.name, ("", None))
    if translate is None:
        return "", None
    if encoding == "json":
        return kind, lambda raw: translate(json.loads(raw, object_hook=lambda each: SimpleNamespace(**each)))
    check_installed(schema.name, "mcap_protobuf", "bag")

    @cache
    def parser() -> Callable[[bytes], Any]:
        from mcap_protobuf.decoder import DecoderFactory

        found = DecoderFactory().decoder_for(encoding, schema)
        assert found is not None
        return found

    return kind, lambda raw: translate(parser()(raw))
