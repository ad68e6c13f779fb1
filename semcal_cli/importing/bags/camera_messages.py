"""The camera of a recording, from its `CameraInfo` messages."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from semcal_cli.config.nanoseconds import NS
from semcal_cli.errors import InputError
from semcal_cli.formats.camera_block import ros_camera
from semcal_cli.importing.bags.messages import Message, MessageError

CameraInfo: TypeAlias = dict[str, Any]
"""Fields of a CameraInfo without its header: K, R and P by rows, where rectified = R * raw; `roi` is a mapping."""


def read_camera_info(message: Message) -> CameraInfo:
    """Read a CameraInfo of ROS 1 (`K`) or ROS 2 (`k`).

    Raises:
        MessageError: the bytes are not a CameraInfo.
    """
    info = message.content
    matrices = {name: getattr(info, name if hasattr(info, name) else name.lower()) for name in "KDRP"}
    return {
        "distortion_model": info.distortion_model,
        "width": info.width,
        "height": info.height,
        **{name: list(map(float, values)) for name, values in matrices.items()},
        "binning_x": info.binning_x,
        "binning_y": info.binning_y,
        "roi": {name: getattr(info.roi, name) for name in ("x_offset", "y_offset", "width", "height")},
    }


def difference(info: CameraInfo, before: CameraInfo) -> str | None:
    """Name the first field that differs, with both values; None if all are the same."""
    for name, value in info.items():
        if repr(value) != repr(before[name]):  # NaN is the same as NaN.
            return f"{name} {_short(value)}, before {_short(before[name])}"
    return None


def camera_block(info: CameraInfo, topic: str, *, rectified: bool) -> dict[str, Any]:
    """Make the `camera:` block of a drive.

    Args:
        info: The content of a CameraInfo.
        topic: Its name, for messages.
        rectified: Whether the images are rectified. If so, P is used instead of K and the distortion.

    Raises:
        InputError: the camera is not calibrated, its lens model is unknown, or a value cannot be right.
    """
    name = "P" if rectified else "K"
    if not any(info[name]):
        raise InputError(
            f"{topic}: {name}: found zeros only, expected a calibrated camera, or --intrinsics FILE"
        )
    document: dict[Any, Any] = {key: value for key, value in info.items() if key not in ("R", "P")}
    if rectified:
        projection = np.reshape(info["P"], (3, 4))[:, :3]
        document |= {"distortion_model": "plumb_bob", "K": projection.ravel().tolist(), "D": []}
    elif not info["distortion_model"] and not info["D"]:
        document["distortion_model"] = "plumb_bob"
    return ros_camera(topic, document)


def _short(value: object) -> str:
    text = ", ".join(f"{number:g}" for number in value) if isinstance(value, list) else str(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def check_same(message: Message, info: CameraInfo | None, start_ns: int) -> None:
    """Check that a message has the intrinsics of the first one; a damaged one, or one without a first, says nothing.

    Raises:
        InputError: it has others; the message says when, after the start of the recording.
    """
    try:
        change = None if info is None else difference(read_camera_info(message), info)
    except MessageError:
        return
    if change is not None:
        seconds = (message.received_ns - start_ns) / NS
        problem = f"found other intrinsics {seconds:.3f} s after the start: {change}"
        raise InputError(f"{message.topic.name}: {problem}; expected the same throughout")
