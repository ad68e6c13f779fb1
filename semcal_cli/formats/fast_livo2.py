"""FAST-LIVO2's `extrin_calib`: p_camera = Rcl p_lidar + Pcl, also inside ROS 2's `/**: ros__parameters:`."""

from __future__ import annotations

from typing import Any

import numpy as np

from semcal_cli.errors import InputError
from semcal_cli.formats.format import Format, FormatOptions, Source, checked, document_writer
from semcal_cli.formats.values import numbers_in
from semcal_cli.geometry.poses import Pose

BLOCK, KEYS = "extrin_calib", {"Rcl", "Pcl"}


def _blocks(document: Any) -> list[dict[Any, Any]]:
    """All blocks with the two keys, at any depth."""
    if not isinstance(document, dict):
        return []
    inner = [block for value in document.values() for block in _blocks(value)]
    return [document, *inner] if document.keys() >= KEYS else inner


def _one(where: str, document: Any) -> dict[Any, Any]:
    blocks = _blocks(document)
    if len(blocks) != 1:
        raise InputError(f"{where}: found {len(blocks)} blocks with Rcl and Pcl, needed one")
    return blocks[0]


def _read(source: Source, options: FormatOptions) -> Pose:
    block = _one(str(source.path), source.document)
    where, T = f"{source.path}: {BLOCK}", np.eye(4)
    T[:3, :3] = np.array(numbers_in(where, block, "Rcl", 9)).reshape(3, 3)
    T[:3, 3] = numbers_in(where, block, "Pcl", 3)
    return checked(f"{where}.Rcl", T, options)


def _put(document: Any, T_camera_lidar: Pose, options: FormatOptions) -> None:
    block = _one(str(options.file), document) if document else document.setdefault(BLOCK, {})
    block["Rcl"], block["Pcl"] = T_camera_lidar[:3, :3].ravel().tolist(), T_camera_lidar[:3, 3].tolist()


FORMAT = Format(
    "fast-livo2",
    "p_camera = Rcl p_lidar + Pcl: extrin_calib",
    lambda source: bool(_blocks(source.mapping)),
    _read,
    document_writer(_put),
    _put,
)
