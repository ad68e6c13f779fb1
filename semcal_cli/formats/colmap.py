"""COLMAP's rig configuration (JSON): p_camera = cam_from_rig p_rig, w x y z. The rig's frame is the LiDAR's."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

from semcal_cli.errors import InputError, listed
from semcal_cli.formats.documents import entry_format
from semcal_cli.formats.format import FormatOptions
from semcal_cli.formats.frames import CAMERA
from semcal_cli.formats.node import Node
from semcal_cli.formats.pose import PLACE, WXYZ, Numbers
from semcal_cli.geometry.poses import Pose

ROTATION, TRANSLATION, NAME = "cam_from_rig_rotation", "cam_from_rig_translation", "image_prefix"
POSE = Numbers({ROTATION: WXYZ, TRANSLATION: PLACE})


def _cameras(rigs: Node) -> list[Node]:
    """Cameras of all rigs that have a pose in their rig."""
    found = []
    for index, rig in enumerate(rigs.value if isinstance(rigs.value, list) else []):
        cameras = rig.get("cameras") if isinstance(rig, dict) else None
        for number, camera in enumerate(cameras if isinstance(cameras, list) else []):
            if isinstance(camera, dict) and ROTATION in camera:
                found.append(rigs.child(index, rig).child("cameras", cameras).child(number, camera))
    return found


def _find(document: Node, options: FormatOptions) -> Node:
    cameras = _cameras(document)
    found = [camera for camera in cameras if options.camera in (None, camera.value.get(NAME))]
    if len(found) != 1:
        known = listed(camera.value.get(NAME) for camera in cameras)
        needed = f"needed {options.prefix}camera with the {NAME} of one of them"
        raise InputError(f"{document.where}: found cameras {known}, {needed}")
    return found[0]


def _make(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
    camera: dict[str, Any] = {NAME: options.camera or CAMERA}
    POSE.put(camera, T_camera_lidar)
    return (json.dumps([{"cameras": [camera]}], indent=2) + "\n").encode()


FORMAT = replace(
    entry_format(
        "colmap",
        f"p_camera = T p_rig, the rig being the LiDAR: {ROTATION} (w x y z) and {TRANSLATION}",
        lambda source: bool(_cameras(Node("", source.records))),
        _find,
        POSE,
        asks=("camera",),
    ),
    make=_make,
)
