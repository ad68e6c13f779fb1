"""COLMAP's rig configuration (JSON): p_camera = cam_from_rig p_rig, w x y z. The rig's frame is the LiDAR's."""

from __future__ import annotations

import json
from typing import Any

from semcal_cli.errors import InputError
from semcal_cli.files.messages import listed
from semcal_cli.formats.format import CAMERA, Format, FormatOptions, Source, from_quaternion, wxyz, xyz
from semcal_cli.formats.values import numbers_in
from semcal_cli.geometry.poses import Pose

ROTATION, TRANSLATION, NAME = "cam_from_rig_rotation", "cam_from_rig_translation", "image_prefix"


def _cameras(document: Any) -> list[dict[Any, Any]]:
    """Cameras of all rigs that have a pose in their rig."""
    rigs = document if isinstance(document, list) else []
    cameras = [rig.get("cameras") for rig in rigs if isinstance(rig, dict)]
    listed_ = [
        camera for each in cameras if isinstance(each, list) for camera in each if isinstance(camera, dict)
    ]
    return [camera for camera in listed_ if ROTATION in camera]


def _camera(where: str, document: Any, options: FormatOptions, prefix: str) -> dict[Any, Any]:
    cameras = _cameras(document)
    found = [camera for camera in cameras if options.camera in (None, camera.get(NAME))]
    if len(found) != 1:
        known = listed(camera.get(NAME) for camera in cameras)
        raise InputError(
            f"{where}: found cameras {known}, needed {prefix}camera with the {NAME} of one of them"
        )
    return found[0]


def _read(source: Source, options: FormatOptions) -> Pose:
    where = str(source.path)
    camera = _camera(where, source.document, options, "--")
    w, x, y, z = numbers_in(where, camera, ROTATION, 4)
    return from_quaternion(
        f"{where}: {ROTATION}", [x, y, z, w], numbers_in(where, camera, TRANSLATION, 3), options
    )


def _put(document: Any, T_camera_lidar: Pose, options: FormatOptions) -> None:
    camera = _camera(str(options.file), document, options, "--to-")
    camera[ROTATION], camera[TRANSLATION] = wxyz(T_camera_lidar), xyz(T_camera_lidar)


def _write(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
    camera = {
        NAME: options.camera or CAMERA,
        ROTATION: wxyz(T_camera_lidar),
        TRANSLATION: xyz(T_camera_lidar),
    }
    return (json.dumps([{"cameras": [camera]}], indent=2) + "\n").encode()


FORMAT = Format(
    "colmap",
    f"p_camera = T p_rig, the rig being the LiDAR: {ROTATION} (w x y z) and {TRANSLATION}",
    lambda source: bool(_cameras(source.records)),
    _read,
    _write,
    _put,
    ("camera",),
)
