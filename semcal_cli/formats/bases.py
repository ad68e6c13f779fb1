"""Formats with the poses of several sensors on one base: Autoware's sensor kits, and nuScenes' table of sensors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from semcal_cli.drive.frame_ids import FrameIds
from semcal_cli.errors import InputError, listed
from semcal_cli.files.documents import read_list
from semcal_cli.files.output_files import STANDARD_INPUT
from semcal_cli.formats.document_formats import SensorPair, base_format
from semcal_cli.formats.format import FRAMES, FormatOptions
from semcal_cli.formats.frame_names import (
    LIDAR,
    T_BODY_OPTICAL,
    camera_and_lidar,
    name_frames,
    optical_axes,
)
from semcal_cli.formats.node import Node
from semcal_cli.formats.pose import RPY, WXYZ, XYZ, NumbersNotation
from semcal_cli.geometry.arrays import Pose

KIT_KEYS = (*XYZ, *RPY)
KIT_POSE = NumbersNotation({"": KIT_KEYS}, are_named=True)


def kits_of(document: Node) -> list[Node]:
    """List the mappings of sensors that each have x y z (metres) and roll pitch yaw (radians)."""

    def is_sensor(name: object, entry: object) -> bool:
        return isinstance(name, str) and isinstance(entry, dict) and entry.keys() >= set(KIT_KEYS)

    return [
        document.child(key, value)
        for key, value in document.mapping.items()
        if isinstance(value, dict) and value and all(is_sensor(*item) for item in value.items())
    ]


def _find_in_kit(document: Node, options: FormatOptions) -> SensorPair:
    """Find the two sensors of the only kit.

    `camera0/camera_link` is a camera's body frame, `camera0/camera_optical_link` its optical frame (Autoware
    documentation, "Creating a sensor model"). The kit holds the LiDAR's base link. The frame of its point clouds may
    differ (a VLP-16's is 3.77 cm above it); a joint of the robot description states that offset, and no kit holds it.
    """
    kits = kits_of(document)
    if len(kits) != 1:
        needed = "expected one: a base frame with sensors of x y z roll pitch yaw"
        raise InputError(f"{document.where}: found {len(kits)} kits, {needed}")
    camera, lidar = camera_and_lidar(document.where, "sensors", kits[0].mapping, options)
    is_body = options.frame is None and camera.endswith("camera_link")
    axes = T_BODY_OPTICAL if is_body else optical_axes(document.where, camera, options)
    return SensorPair(kits[0].at(camera), kits[0].at(lidar), axes)


def _make_kit(T_camera_lidar: Pose, options: FormatOptions) -> dict[str, Any]:
    """Make the entries of camera and LiDAR on the base: a block of sensors_calibration.yaml or of a kit's file."""
    if options.frame is None and (options.camera or "").endswith("camera_link"):
        options = replace(options, frame="body")
    T_base_camera, base, camera = name_frames(T_camera_lidar, options)
    assert options.base is not None
    lidar = options.lidar or (options.frame_ids or FrameIds()).lidar or LIDAR
    entries: dict[str, dict[str, float]] = {}
    for name, T_base_sensor in ((camera, T_base_camera), (lidar, options.base.T_base_lidar)):
        KIT_POSE.put(entries.setdefault(name, {}), T_base_sensor)
    if len({base, camera, lidar}) < 3:
        camera_option, lidar_option = options.option("camera"), options.option("lidar")
        needed = f"three names: add {camera_option}, {lidar_option} or {options.option('base_frame')}"
        raise InputError(
            f"{options.option('to')} autoware: found {listed((base, camera, lidar))}, expected {needed}"
        )
    return {base: entries}


AUTOWARE = base_format(
    "autoware",
    "p_base = T p_sensor: sensor_kit_calibration.yaml, x y z roll pitch yaw of each base link",
    lambda source: len(kits_of(Node("", source.mapping))) == 1,
    _find_in_kit,
    KIT_POSE.read,
    base="sensor kit",
    asks=FRAMES,
    is_set=True,
    make_on_base=_make_kit,
)

TABLE, SENSORS = "calibrated_sensor.json", "sensor.json"
"""nuScenes' table of poses, and the table next to it that names the sensors' channels."""


def _channels(table: Path) -> dict[Any, Any]:
    """Read the names of sensors by token, if their table is next to the table of poses."""
    path = table.with_name(SENSORS)
    if table == STANDARD_INPUT or not path.is_file():
        return {}
    return {
        record["token"]: record.get("channel")
        for record in read_list(path)
        if isinstance(record.get("token"), str)
    }


def _record(
    table: Node, channels: dict[Any, Any], kind: Literal["camera", "lidar"], options: FormatOptions
) -> Node:
    """Find the entry of the camera or the LiDAR by its token or, where a channel has one entry, by its channel."""
    name = options.camera if kind == "camera" else options.lidar
    names = [(row.get("token"), channels.get(str(row.get("sensor_token")))) for row in table.value]
    indices = [index for index, both in enumerate(names) if name is not None and name in both]
    if len(indices) != 1:
        choices = listed(channel or token for token, channel in names)
        problem = f"no {name!r}" if name and not indices else f"{len(indices) or len(names)} sensors"
        # The channels are in another file, and standard input has none next to it.
        key = "token" if Path(table.file) == STANDARD_INPUT else "token or channel"
        raise InputError(
            f"{table.where}: found {problem}; add {options.option(kind)} with the {key} of one of: {choices}"
            f"{options.hint(kind)}"
        )
    return table.child(indices[0], table.value[indices[0]])


def _find_in_table(table: Node, options: FormatOptions) -> SensorPair:
    if not isinstance(table.value, list) or not all(isinstance(row, dict) for row in table.value):
        raise table.mismatch("a list of mappings")
    channels = _channels(Path(table.file))
    camera = _record(table, channels, "camera", options)
    lidar = _record(table, channels, "lidar", options)
    sensors = {str(sensor.value.get("sensor_token")) for sensor in (camera, lidar)}
    if camera.value is lidar.value or (len(sensors) == 1 and sensors <= channels.keys()):
        names = f"{options.camera!r} and {options.lidar!r}"
        raise InputError(
            f"{table.where}: found one sensor as camera and LiDAR, {names}, expected two sensors"
        )
    return SensorPair(camera, lidar)


NUSCENES_KEYS = {"token", "sensor_token", "translation", "rotation"}
NUSCENES = base_format(
    "nuscenes",
    "p_ego = T p_sensor: calibrated_sensor.json, --camera and --lidar name two entries",
    lambda source: bool(source.records) and all(record.keys() >= NUSCENES_KEYS for record in source.records),
    _find_in_table,
    NumbersNotation({"rotation": WXYZ, "translation": XYZ}).read,
    base="vehicle",
    asks=("camera", "lidar"),
)
