"""Autoware's sensor_kit_calibration.yaml: p_base = T p_sensor, as x y z (metres) roll pitch yaw (radians).

Poses are relative to the kit, so the LiDAR's own entry is needed. `camera0/camera_link` is a camera's body frame,
`camera0/camera_optical_link` its optical one (Autoware documentation, "Creating a sensor model"). The kit holds the
LiDAR's base link; if a description puts the frame of its clouds elsewhere (a VLP-16's lies 3.77 cm above it), another
joint states that offset, which no kit holds.
"""

from __future__ import annotations

from typing import Any

from semcal_cli.errors import InputError
from semcal_cli.formats.format import (
    FRAMES,
    T_BODY_OPTICAL,
    Format,
    FormatOptions,
    Source,
    from_rpy,
    no_new_file,
    optical_axes,
    xyz,
)
from semcal_cli.formats.names import cameras_among, check_two, choose, lidars_among
from semcal_cli.formats.values import mapping_at, numbers_at
from semcal_cli.geometry.poses import Pose, inverse, rpy

KEYS = ("x", "y", "z", "roll", "pitch", "yaw")


def _entries(where: str, document: Any) -> dict[str, Any]:
    """The sensors of the kit, by name."""
    kits = [value for value in mapping_at(where, document).values() if _is_kit(value)]
    if len(kits) != 1:
        needed = "needed one: a base frame with sensors of x y z roll pitch yaw"
        raise InputError(f"{where}: found {len(kits)} kits, {needed}")
    kit: dict[str, Any] = kits[0]
    return kit


def _is_kit(value: object) -> bool:
    if not isinstance(value, dict) or not value:
        return False
    return all(isinstance(name, str) and _is_sensor(entry) for name, entry in value.items())


def _is_sensor(entry: object) -> bool:
    return isinstance(entry, dict) and entry.keys() >= set(KEYS)


def _names(where: str, entries: dict[str, Any], options: FormatOptions, prefix: str) -> tuple[str, str]:
    cameras, lidars = cameras_among(entries, options.lidar), lidars_among(entries, options.camera)
    camera = choose(where, "sensors", entries, cameras, options.camera, f"{prefix}camera")
    lidar = choose(where, "sensors", entries, lidars, options.lidar, f"{prefix}lidar")
    check_two(where, camera, lidar, "two sensors")
    return camera, lidar


def _pose(where: str, entries: dict[str, Any], name: str) -> Pose:
    values = numbers_at(where, entries, name, KEYS)
    return from_rpy(f"{where}: {name}", values[3:], values[:3])


def _axes(where: str, camera: str, options: FormatOptions, prefix: str) -> Pose:
    """T_frame_optical of the camera's frame; `camera_link` is a body frame here."""
    if options.frame is None and camera.endswith("camera_link"):
        return T_BODY_OPTICAL
    return optical_axes(where, camera, options, prefix)


def _read(source: Source, options: FormatOptions) -> Pose:
    where = str(source.path)
    entries = _entries(where, source.document)
    camera, lidar = _names(where, entries, options, "--")
    T_base_optical = _pose(where, entries, camera) @ _axes(where, camera, options, "--")
    return inverse(T_base_optical) @ _pose(where, entries, lidar)


def _put(document: Any, T_camera_lidar: Pose, options: FormatOptions) -> None:
    where = str(options.file)
    entries = _entries(where, document)
    camera, lidar = _names(where, entries, options, "--to-")
    T_base_optical = _pose(where, entries, lidar) @ inverse(T_camera_lidar)
    T = T_base_optical @ inverse(_axes(where, camera, options, "--to-"))
    entries[camera].update(zip(KEYS, [*xyz(T), *rpy(T)], strict=True))


FORMAT = Format(
    "autoware",
    "p_base = T p_sensor: sensor_kit_calibration.yaml, x y z roll pitch yaw of each base link",
    lambda source: len([kit for kit in source.mapping.values() if _is_kit(kit)]) == 1,
    _read,
    no_new_file("autoware", "sensor kit", "sensor_kit_calibration.yaml"),
    _put,
    FRAMES,
)
