"""FAST-LIVO2's `extrin_calib`: p_camera = Rcl p_lidar + Pcl, also inside ROS 2's `/**: ros__parameters:`."""

from __future__ import annotations

from typing import Any

import numpy as np

from semcal_cli.errors import InputError
from semcal_cli.formats.format import Asked, Format, Source, checked, document_writer
from semcal_cli.formats.values import numbers_in
from semcal_cli.poses import Pose

BLOCK, KEYS = "extrin_calib", {"Rcl", "Pcl"}


def _block(document: Any) -> dict[Any, Any] | None:
    """The block with the two keys, wherever it is nested."""
    if not isinstance(document, dict):
        return None
    if document.keys() >= KEYS:
        return document
    return next(filter(None, (_block(value) for value in document.values())), None)


def _read(source: Source, asked: Asked) -> Pose:
    block = _block(source.document)
    if block is None:
        raise InputError(f"{source.path}: found no {BLOCK} with Rcl and Pcl, needed it")
    where, T = f"{source.path}: {BLOCK}", np.eye(4)
    T[:3, :3] = np.array(numbers_in(where, block, "Rcl", 9)).reshape(3, 3)
    T[:3, 3] = numbers_in(where, block, "Pcl", 3)
    return checked(f"{where}.Rcl", T, asked)


def _put(document: Any, T_camera_lidar: Pose, asked: Asked) -> None:
    block = _block(document)
    if block is None:
        block = document.setdefault(BLOCK, {})
    block["Rcl"], block["Pcl"] = T_camera_lidar[:3, :3].ravel().tolist(), T_camera_lidar[:3, 3].tolist()


FORMAT = Format(
    "fast-livo2",
    "p_camera = Rcl p_lidar + Pcl: extrin_calib",
    lambda source: _block(source.mapping) is not None,
    _read,
    document_writer(_put),
    _put,
)
