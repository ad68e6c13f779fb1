"""Rigs of sensors of other makers: extrinsics.yaml of Calibration Anywhere, and rig.json of NVIDIA's DriveWorks.

Calibration Anywhere (Main Street Autonomy, "Calibration output") writes p_parent = T p_child of each sensor as x y z
and qx qy qz qw. DriveWorks writes `nominalSensor2Rig_FLU`, p_rig = T p_sensor, with angles in degrees,
R = Rz(yaw) Ry(pitch) Rx(roll); cameras look along x there, too. `correction_sensor_R_FLU` turns the sensor before
that, and `correction_rig_T` shifts it after that.
"""

from __future__ import annotations

import numpy as np

from semcal_cli.errors import InputError
from semcal_cli.formats.document_formats import SensorPair, base_format
from semcal_cli.formats.format import FRAMES, FormatOptions, Source
from semcal_cli.formats.frame_names import T_BODY_OPTICAL, camera_and_lidar, optical_axes
from semcal_cli.formats.node import Node
from semcal_cli.formats.pose import RPY, XYZ, XYZW, NumbersNotation, pose_of
from semcal_cli.geometry.arrays import Pose

ANYWHERE_KEYS = {"parent", "child", "value"}
RIG_POSE, RIG_TURN, RIG_SHIFT = "nominalSensor2Rig_FLU", "correction_sensor_R_FLU", "correction_rig_T"


def _is_of_anywhere(source: Source) -> bool:
    entries = source.mapping
    return bool(entries) and all(
        isinstance(name, str) and isinstance(entry, dict) and entry.keys() >= ANYWHERE_KEYS
        for name, entry in entries.items()
    )


def _find_in_anywhere(document: Node, options: FormatOptions) -> SensorPair:
    names = [name for name in document.mapping if isinstance(name, str)]
    camera, lidar = camera_and_lidar(document.where, "sensors", names, options)
    pair = document.at(camera), document.at(lidar)
    parents = [sensor.at("parent").text() for sensor in pair]
    if parents[0] != parents[1]:
        raise InputError(
            f"{document.where}: found parents {parents[0]!r} and {parents[1]!r}, expected one parent"
        )
    return SensorPair(*pair, optical_axes(document.where, camera, options))


def _sensors(document: Node) -> dict[str, Node]:
    """List the sensors of a DriveWorks rig that have a pose, by their names."""
    rig = document.value.get("rig") if isinstance(document.value, dict) else None
    sensors = rig.get("sensors") if isinstance(rig, dict) else None
    if not isinstance(sensors, list):
        return {}
    node = document.child("rig", rig).child("sensors", sensors)
    return {
        str(sensor.get("name")): node.child(index, sensor)
        for index, sensor in enumerate(sensors)
        if isinstance(sensor, dict) and RIG_POSE in sensor
    }


def _find_in_rig(document: Node, options: FormatOptions) -> SensorPair:
    sensors = _sensors(document)
    camera, lidar = camera_and_lidar(document.where, "sensors", sensors, options)
    return SensorPair(sensors[camera], sensors[lidar], T_BODY_OPTICAL)


def _read_rig_pose(node: Node, options: FormatOptions) -> Pose:
    """Read a pose as DriveWorks states it, with its corrections."""
    nominal = node.at(RIG_POSE)
    T = _pose(nominal, nominal.at("t").numbers(3), options)
    if RIG_TURN in node.mapping:
        T = T @ _pose(node.at(RIG_TURN), [0.0] * 3, options)
    if RIG_SHIFT in node.mapping:
        T[:3, 3] += node.at(RIG_SHIFT).numbers(3)
    return T


def _pose(node: Node, translation: list[float], options: FormatOptions) -> Pose:
    angles = np.radians(node.at("roll-pitch-yaw").numbers(3)).tolist()
    return pose_of(node.where, dict(zip((*XYZ, *RPY), [*translation, *angles], strict=True)), options)


ANYWHERE = base_format(
    "calibration-anywhere",
    "p_parent = T p_child: extrinsics.yaml, value of each sensor, x y z qx qy qz qw",
    _is_of_anywhere,
    _find_in_anywhere,
    NumbersNotation({"value": (*XYZ, *XYZW)}).read,
    base="parent",
    asks=FRAMES,
)
DRIVEWORKS = base_format(
    "driveworks",
    f"p_rig = T p_sensor: rig.json, {RIG_POSE} of each sensor with its corrections, degrees",
    lambda source: bool(_sensors(Node("", source.mapping))),
    _find_in_rig,
    _read_rig_pose,
    base="rig",
    asks=FRAMES[1:],
)
