"""nuScenes' calibrated_sensor.json: p_ego = T p_sensor, rotation w x y z. The LiDAR's own entry is needed.

Sensors are named by their token or, where sensor.json lies beside the table and a channel has one entry, by channel.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from semcal_cli.errors import InputError
from semcal_cli.files.documents import read_list
from semcal_cli.files.messages import listed
from semcal_cli.files.streams import STANDARD_INPUT
from semcal_cli.formats.format import Format, FormatOptions, Source, from_quaternion, no_new_file, wxyz, xyz
from semcal_cli.formats.values import numbers_in
from semcal_cli.geometry.poses import Pose, inverse

KEYS = {"token", "sensor_token", "translation", "rotation"}


def _channels(table: Path) -> dict[Any, Any]:
    """Names of sensors by token, if their table lies beside the table of poses."""
    path = table.with_name("sensor.json")
    if table == STANDARD_INPUT or not path.is_file():
        return {}
    records = [record for record in read_list(path) if isinstance(record.get("token"), str)]
    return {record["token"]: record.get("channel") for record in records}


def _record(
    where: str, records: list[dict[Any, Any]], channels: dict[Any, Any], wanted: str | None, option: str
) -> dict[Any, Any]:
    def names(record: dict[Any, Any]) -> tuple[Any, Any]:
        return record.get("token"), channels.get(str(record.get("sensor_token")))

    found = [record for record in records if wanted is not None and wanted in names(record)]
    if len(found) != 1:
        known = listed(channel or token for token, channel in map(names, records))
        problem = "nothing of that name" if wanted and not found else f"{len(found) or len(records)} sensors"
        # Channels are told by another table beside this one.
        key = "token" if Path(where) == STANDARD_INPUT else "token or channel"
        raise InputError(f"{where}: found {problem}, needed {option} with the {key} of one of: {known}")
    return found[0]


def _two(
    where: str, records: list[dict[Any, Any]], options: FormatOptions, prefix: str
) -> tuple[dict[Any, Any], dict[Any, Any]]:
    """Entries of the camera and the LiDAR."""
    channels = _channels(Path(where))
    camera = _record(where, records, channels, options.camera, f"{prefix}camera")
    lidar = _record(where, records, channels, options.lidar, f"{prefix}lidar")
    sensors = {str(record.get("sensor_token")) for record in (camera, lidar)}
    if camera is lidar or (len(sensors) == 1 and sensors <= channels.keys()):
        found = f"{options.camera!r} and {options.lidar!r}"
        raise InputError(f"{where}: found one sensor for both camera and LiDAR, {found}, needed two sensors")
    return camera, lidar


def _pose(where: str, record: dict[Any, Any], options: FormatOptions) -> Pose:
    w, x, y, z = numbers_in(where, record, "rotation", 4)
    return from_quaternion(where, [x, y, z, w], numbers_in(where, record, "translation", 3), options)


def _read(source: Source, options: FormatOptions) -> Pose:
    where = str(source.path)
    camera, lidar = (_pose(where, record, options) for record in _two(where, source.records, options, "--"))
    return inverse(camera) @ lidar


def _put(document: Any, T_camera_lidar: Pose, options: FormatOptions) -> None:
    where = str(options.file)
    camera, lidar = _two(where, document, options, "--to-")
    T = _pose(where, lidar, options) @ inverse(T_camera_lidar)
    camera["translation"], camera["rotation"] = xyz(T), wxyz(T)


FORMAT = Format(
    "nuscenes",
    "p_ego = T p_sensor: calibrated_sensor.json, --camera and --lidar name two entries",
    lambda source: bool(source.records) and all(record.keys() >= KEYS for record in source.records),
    _read,
    no_new_file("nuscenes", "vehicle", "calibrated_sensor.json"),
    _put,
    ("camera", "lidar"),
)
