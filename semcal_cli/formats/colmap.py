"""Rigs of COLMAP from 3.12 on: rig_config.json, colmap.github.io/rigs.html.

A rig of COLMAP consists of cameras alone, one of which is its frame. Where semcal writes a whole rig, each entry thus
has `T_camera_lidar`, too, which COLMAP ignores and semcal reads.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from semcal_cli.drive.camera import Camera, CameraModel
from semcal_cli.errors import InputError, listed
from semcal_cli.formats.format import Format, FormatOptions, Source
from semcal_cli.formats.frame_names import CAMERA
from semcal_cli.formats.lenses import UnnamedLensError, check_lens, coefficients_of, pixels_from_corner
from semcal_cli.formats.node import Node
from semcal_cli.formats.pose import WXYZ, XYZ, MatrixNotation, NumbersNotation, PoseNotation
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse

ROTATION, TRANSLATION, NAME = "cam_from_rig_rotation", "cam_from_rig_translation", "image_prefix"
REFERENCE = "ref_sensor"
FROM_LIDAR = "T_camera_lidar"
IN_RIG: PoseNotation = NumbersNotation({ROTATION: WXYZ, TRANSLATION: XYZ})
IN_LIDAR: PoseNotation = MatrixNotation(FROM_LIDAR)
LENSES: dict[CameraModel, str] = {
    "plumb_bob": "OPENCV",
    "rational_polynomial": "FULL_OPENCV",
    "fisheye": "OPENCV_FISHEYE",
    "fov": "FOV",
}
"""COLMAP's camera model of each lens. `plumb_bob` is PINHOLE without distortion, and FULL_OPENCV with k3."""
NUM_OPENCV, NUM_FULL_OPENCV = 4, 8
"""Numbers of coefficients of these models."""


class RigCamera(NamedTuple):
    """A camera of a rig."""

    T_camera_lidar: Pose
    """(4, 4), metres."""
    camera: Camera
    """Its intrinsics."""


def rig_config(
    cameras: Mapping[str, RigCamera], reference: str, on_note: Callable[[str], None] = lambda line: None
) -> bytes:
    """Make the content of a rig_config.json; the images of each camera are in a folder of its name.

    Args:
        cameras: The cameras by name.
        reference: Camera that is the frame of the rig.
        on_note: Called with a line about each camera that is written without its intrinsics, which COLMAP cannot hold.
    """
    T_lidar_rig = inverse(cameras[reference].T_camera_lidar)
    entries = list[dict[str, Any]]()
    for name, (T_camera_lidar, camera) in cameras.items():
        entry: dict[str, Any] = {NAME: f"{name}/"}
        if name == reference:
            entry[REFERENCE] = True
        else:
            IN_RIG.put(entry, T_camera_lidar @ T_lidar_rig)
        try:
            entry |= _lens(name, camera)
        except UnnamedLensError as error:
            on_note(f"{error}: the camera is written without intrinsics")
        IN_LIDAR.put(entry, T_camera_lidar)
        entries.append(entry)
    entries.sort(key=lambda entry: REFERENCE not in entry)
    return (json.dumps([{"cameras": entries}], indent=2) + "\n").encode()


def _lens(name: str, camera: Camera) -> dict[str, Any]:
    """Make the keys of the intrinsics.

    Raises:
        UnnamedLensError: COLMAP has no name for the lens, or K has a skew.
    """
    check_lens(name, camera, LENSES)
    model, coefficients = LENSES[camera.model], coefficients_of(camera)
    if model == "OPENCV":
        model = "PINHOLE" if not any(coefficients) else "FULL_OPENCV" if any(coefficients[4:]) else model
        num = {"PINHOLE": 0, "OPENCV": NUM_OPENCV, "FULL_OPENCV": NUM_FULL_OPENCV}[model]
        coefficients = [*coefficients, *(num * [0.0])][:num]
    return {"camera_model_name": model, "camera_params": [*pixels_from_corner(name, camera), *coefficients]}


def _rig_cameras(rigs: Node) -> list[tuple[Node, bool]]:
    """List the cameras of all rigs that have a pose, and whether the frame of their rig is a camera's."""
    entries = []
    for index, rig in enumerate(rigs.value if isinstance(rigs.value, list) else []):
        value = rig.get("cameras") if isinstance(rig, dict) else None
        cameras = value if isinstance(value, list) else []
        is_of_camera = any(isinstance(camera, dict) and camera.get(REFERENCE) is True for camera in cameras)
        for number, camera in enumerate(cameras):
            if isinstance(camera, dict) and camera.keys() & {ROTATION, FROM_LIDAR}:
                node = rigs.child(index, rig).child("cameras", cameras).child(number, camera)
                entries.append((node, is_of_camera))
    return entries


def _find_rig_camera(document: Node, options: FormatOptions) -> Node:
    cameras = _rig_cameras(document)
    matches = [each for each in cameras if options.camera in (None, each[0].value.get(NAME))]
    if len(matches) != 1:
        names = listed(camera.value.get(NAME) for camera, _ in cameras)
        option, hint = options.option("camera"), options.hint("camera")
        needed = f"add {option} with the {NAME} of one of them{hint}"
        raise InputError(f"{document.where}: found cameras {names}; {needed}")
    ((camera, is_of_camera),) = matches
    if is_of_camera and FROM_LIDAR not in camera.value:
        raise InputError(
            f"{camera.where}: found a rig whose frame is a camera, not the LiDAR; expected {FROM_LIDAR}, too"
        )
    return camera


def _read_rig(source: Source, options: FormatOptions) -> Pose:
    """Read the pose in a rig whose frame is the LiDAR's or, where semcal wrote both, that in the LiDAR's frame."""
    camera = _find_rig_camera(source.node, options)
    return (IN_LIDAR if FROM_LIDAR in camera.mapping else IN_RIG).read(camera, options)


def _make_rig(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
    camera: dict[str, Any] = {NAME: options.camera or CAMERA}
    IN_RIG.put(camera, T_camera_lidar)
    options.note(
        "the rig's frame is the LiDAR's, but COLMAP itself needs a camera: `semcal export colmap` writes such a rig"
    )
    return (json.dumps([{"cameras": [camera]}], indent=2) + "\n").encode()


FORMAT = Format(
    "colmap",
    f"p_camera = T p_rig, where the rig is the LiDAR: {ROTATION} (w x y z) and {TRANSLATION}; or {FROM_LIDAR}",
    lambda source: bool(_rig_cameras(Node("", source.records))),
    _read_rig,
    _make_rig,
    asks=("camera",),
)
