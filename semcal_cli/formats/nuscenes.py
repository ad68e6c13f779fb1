"""nuScenes' calibrated_sensor.json: p_ego = T p_sensor, rotation w x y z. The LiDAR's own entry is needed.

Sensors are named by their token or, where sensor.json lies beside the table and a channel has one entry, by channel.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from semcal_cli.errors import InputError, listed
from semcal_cli.files.documents import read_list
from semcal_cli.files.writing import STANDARD_INPUT
from semcal_cli.formats.documents import Pair, base_format
from semcal_cli.formats.format import FormatOptions
from semcal_cli.formats.node import Node
from semcal_cli.formats.pose import PLACE, WXYZ, Numbers

KEYS = {"token", "sensor_token", "translation", "rotation"}

TABLE, SENSORS = "calibrated_sensor.json", "sensor.json"
"""The table, and the one beside it that names the sensors' channels."""


def _channels(table: Path) -> dict[Any, Any]:
    """Names of sensors by token, if their table lies beside the table of poses."""
    path = table.with_name(SENSORS)
    if table == STANDARD_INPUT or not path.is_file():
        return {}
    records = [record for record in read_list(path) if isinstance(record.get("token"), str)]
    return {record["token"]: record.get("channel") for record in records}


def _record(table: Node, channels: dict[Any, Any], wanted: str | None, option: str) -> Node:
    """Find the entry with a token or a channel."""
    names = [(row.get("token"), channels.get(str(row.get("sensor_token")))) for row in table.value]
    found = [index for index, both in enumerate(names) if wanted is not None and wanted in both]
    if len(found) != 1:
        known = listed(channel or token for token, channel in names)
        problem = "nothing of that name" if wanted and not found else f"{len(found) or len(names)} sensors"
        # Channels are told by another table beside this one.
        key = "token" if Path(table.file) == STANDARD_INPUT else "token or channel"
        raise InputError(f"{table.where}: found {problem}, needed {option} with the {key} of one of: {known}")
    return table.child(found[0], table.value[found[0]])


def _find(table: Node, options: FormatOptions) -> Pair:
    if not isinstance(table.value, list) or not all(isinstance(row, dict) for row in table.value):
        raise table.mismatch("a list of mappings")
    channels = _channels(Path(table.file))
    camera = _record(table, channels, options.camera, f"{options.prefix}camera")
    lidar = _record(table, channels, options.lidar, f"{options.prefix}lidar")
    sensors = {str(each.value.get("sensor_token")) for each in (camera, lidar)}
    if camera.value is lidar.value or (len(sensors) == 1 and sensors <= channels.keys()):
        found = f"{options.camera!r} and {options.lidar!r}"
        raise InputError(
            f"{table.where}: found one sensor for both camera and LiDAR, {found}, needed two sensors"
        )
    return Pair(camera, lidar)


FORMAT = base_format(
    "nuscenes",
    "p_ego = T p_sensor: calibrated_sensor.json, --camera and --lidar name two entries",
    lambda source: bool(source.records) and all(record.keys() >= KEYS for record in source.records),
    _find,
    Numbers({"rotation": WXYZ, "translation": PLACE}),
    base="vehicle",
    file=TABLE,
    asks=("camera", "lidar"),
)
