"""Autoware's sensor_kit_calibration.yaml: p_base = T p_sensor, as x y z (metres) roll pitch yaw (radians).

Poses are relative to the kit, so the LiDAR's own entry is needed. `camera0/camera_link` is a camera's body frame,
`camera0/camera_optical_link` its optical one (Autoware documentation, "Creating a sensor model"). The kit holds the
LiDAR's base link; if a description puts the frame of its clouds elsewhere (a VLP-16's lies 3.77 cm above it), another
joint states that offset, which no kit holds.
"""

from __future__ import annotations

from semcal_cli.errors import InputError
from semcal_cli.formats.documents import Pair, base_format
from semcal_cli.formats.format import FRAMES, FormatOptions
from semcal_cli.formats.frames import T_BODY_OPTICAL, camera_and_lidar, optical_axes
from semcal_cli.formats.node import Node
from semcal_cli.formats.pose import ANGLES, PLACE, Numbers

KEYS = (*PLACE, *ANGLES)


def _kits(document: Node) -> list[Node]:
    return [document.child(key, value) for key, value in document.mapping.items() if _is_kit(value)]


def _is_kit(value: object) -> bool:
    if not isinstance(value, dict) or not value:
        return False
    return all(isinstance(name, str) and _is_sensor(entry) for name, entry in value.items())


def _is_sensor(entry: object) -> bool:
    return isinstance(entry, dict) and entry.keys() >= set(KEYS)


def _find(document: Node, options: FormatOptions) -> Pair:
    kits = _kits(document)
    if len(kits) != 1:
        needed = "needed one: a base frame with sensors of x y z roll pitch yaw"
        raise InputError(f"{document.where}: found {len(kits)} kits, {needed}")
    camera, lidar = camera_and_lidar(document.where, "sensors", kits[0].mapping, options)
    is_body = options.frame is None and camera.endswith("camera_link")
    axes = T_BODY_OPTICAL if is_body else optical_axes(document.where, camera, options)
    return Pair(kits[0].at(camera), kits[0].at(lidar), axes)


FORMAT = base_format(
    "autoware",
    "p_base = T p_sensor: sensor_kit_calibration.yaml, x y z roll pitch yaw of each base link",
    lambda source: len(_kits(Node("", source.mapping))) == 1,
    _find,
    Numbers({"": KEYS}, are_named=True),
    base="sensor kit",
    file="sensor_kit_calibration.yaml",
    asks=FRAMES,
)
