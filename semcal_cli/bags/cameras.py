"""The camera of a recording, from its `CameraInfo` messages."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from semcal_cli.bags.messages import Message
from semcal_cli.errors import InputError
from semcal_cli.formats.intrinsics import ros_camera

RECTIFIED = "image_rect"
"""Start of the name of a topic with rectified pictures (image_proc)."""


class CameraInfo(NamedTuple):
    """What a CameraInfo states."""

    model: str
    width: int
    height: int
    K: tuple[float, ...]
    """(9,) by rows."""
    D: tuple[float, ...]
    R: tuple[float, ...]
    """(9,) by rows: rectified = R * raw."""
    P: tuple[float, ...]
    """(12,) by rows."""
    binning: tuple[int, int]
    roi: tuple[int, int, int, int]
    """x_offset, y_offset, width and height."""

    def difference(self, other: CameraInfo) -> str | None:
        """Name the first field that differs, with both values; None if all are the same."""
        for name in self._fields:
            mine, theirs = getattr(self, name), getattr(other, name)
            if repr(mine) != repr(theirs):  # NaN is the same as NaN.
                return f"{name} {_short(mine)}, before {_short(theirs)}"
        return None


def read_camera_info(message: Message) -> CameraInfo:
    """Read a CameraInfo of ROS 1 (`K`) or ROS 2 (`k`).

    Raises:
        MessageError: the bytes are none.
    """
    info = message.content
    K, D, R, P = (
        tuple(map(float, getattr(info, name if hasattr(info, name) else name.lower()))) for name in "KDRP"
    )
    roi = info.roi.x_offset, info.roi.y_offset, info.roi.width, info.roi.height
    binning = info.binning_x, info.binning_y
    return CameraInfo(info.distortion_model, info.width, info.height, K, D, R, P, binning, roi)


def is_rectified(topic: str) -> bool:
    """Whether the pictures of a topic are rectified, by its name."""
    return any(part.startswith(RECTIFIED) for part in topic.split("/"))


def camera_block(info: CameraInfo, topic: str, *, rectified: bool) -> dict[str, Any]:
    """Make the `camera:` block of a drive.

    Args:
        info: What the topic states.
        topic: Its name, for messages.
        rectified: Whether the pictures are rectified: P counts then, and neither K nor the coefficients.

    Raises:
        InputError: the camera is not calibrated, or its lens is not known, or a value cannot be right.
    """
    if not any(info.P if rectified else info.K):
        name = "P" if rectified else "K"
        raise InputError(
            f"{topic}: {name}: found zeros only, needed a calibrated camera; or give --intrinsics FILE"
        )
    document: dict[Any, Any] = {
        "width": info.width,
        "height": info.height,
        "distortion_model": info.model or ("plumb_bob" if not info.D else ""),
        "K": list(info.K),
        "D": list(info.D),
        "binning_x": info.binning[0],
        "binning_y": info.binning[1],
        "roi": dict(zip(("x_offset", "y_offset", "width", "height"), info.roi, strict=True)),
    }
    if rectified:
        projection = np.reshape(info.P, (3, 4))[:, :3]
        document |= {"distortion_model": "plumb_bob", "K": projection.ravel().tolist(), "D": []}
    return ros_camera(topic, document)


def _short(value: object) -> str:
    text = ", ".join(f"{each:g}" for each in value) if isinstance(value, tuple) else str(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
