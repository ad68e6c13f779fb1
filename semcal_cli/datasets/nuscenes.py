"""nuScenes: the keyframes of a scene, from the tables in ROOT/v1.0-mini.

Quaternions are w first. Sensor poses are sensor to vehicle, vehicle poses vehicle to world, at the time of each sensor:
T_camera_lidar = inv(T_ego_camera) inv(T_world_ego at the picture) (T_world_ego at the sweep) T_ego_lidar.
The tables are described in docs/schema_nuscenes.md of nutonomy/nuscenes-devkit.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from semcal_cli.datasets.files import folders, need, pick
from semcal_cli.datasets.ontologies import read_ontology
from semcal_cli.datasets.recording import Recording, Request, SourceFrame
from semcal_cli.datasets.trajectory import speeds_mps
from semcal_cli.documents import describe, read_text
from semcal_cli.errors import InputError
from semcal_cli.poses import Pose, inverse, pose_from_quaternion

LIDAR_CHANNEL = "LIDAR_TOP"
USUAL_CAMERA = "CAM_FRONT"
LIDAR = {"channels": 32, "columns": 1084, "fov_up_deg": 10.67, "fov_down_deg": -30.67}
"""Velodyne HDL-32E, 20 turns a second."""
MICROSECONDS = 1e-6

Row = dict[str, Any]


class Tables:
    """The rows of a version's tables, looked up by their tokens; complaints name the table and the key."""

    def __init__(self, folder: Path):
        self.folder = folder

    def rows(self, table: str) -> list[Row]:
        """All rows of a table."""
        path = self.path(table)
        try:
            rows = json.loads(read_text(path))
        except (ValueError, RecursionError) as error:
            raise InputError(f"{path}: {error}") from None
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise InputError(f"{path}: found {describe(rows)}, needed a list of mappings")
        return rows

    def by_token(self, table: str, tokens: Iterable[str]) -> dict[str, Row]:
        """The rows with these tokens."""
        wanted = set(tokens)
        found = {row.get("token", ""): row for row in self.rows(table) if row.get("token") in wanted}
        for token in sorted(wanted - found.keys()):
            raise InputError(f"{self.path(table)}: found no row with token {token!r}, needed one")
        return found

    def get(self, table: str, row: Row, key: str) -> Any:
        """A value of a row."""
        if key not in row:
            raise InputError(
                f"{self.path(table)}: row {row.get('token')!r}: {key}: found nothing, needed a value"
            )
        return row[key]

    def pose(self, table: str, row: Row) -> Pose:
        """The transform of a row: `rotation`, w x y z, and `translation`."""
        rotation, translation = (self.get(table, row, key) for key in ("rotation", "translation"))
        try:
            w, x, y, z = (float(value) for value in rotation)
            return pose_from_quaternion((x, y, z, w), np.array(translation, dtype=float).reshape(3).tolist())
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.path(table)}: row {row.get('token')!r}: {error}") from None

    def path(self, table: str) -> Path:
        """The file of a table."""
        return self.folder / f"{table}.json"


def read(request: Request) -> Recording:
    """Find the keyframes of a scene, each with its own transform by way of the vehicle's poses."""
    versions = [name for name in folders(request.root) if name.startswith("v1.0")]
    tables = Tables(request.root / pick("version", request.version, versions, request.root))
    sweeps, pictures = _keyframes(tables, request)
    calibrations = tables.by_token(
        "calibrated_sensor", (row["calibrated_sensor_token"] for row in [*sweeps, *pictures])
    )
    egos = tables.by_token("ego_pose", (row["ego_pose_token"] for row in [*sweeps, *pictures]))

    def T_world_sensor(row: Row) -> Pose:
        T_world_ego = tables.pose("ego_pose", egos[row["ego_pose_token"]])
        return T_world_ego @ tables.pose("calibrated_sensor", calibrations[row["calibrated_sensor_token"]])

    positions = np.array([T_world_sensor(row)[:3, 3] for row in sweeps])
    stamps = np.array([row["timestamp"] * MICROSECONDS for row in sweeps])
    point_labels = _lidarseg(tables, request.root)
    frames = [
        SourceFrame(
            name=sweep["token"],
            points=need(request.root / sweep["filename"]),
            point_labels=point_labels.get(sweep["token"]),
            image=need(request.root / picture["filename"]),
            points_stamp=sweep["timestamp"] * MICROSECONDS,
            image_stamp=picture["timestamp"] * MICROSECONDS,
            speed_mps=speed,
            T_camera_lidar=inverse(T_world_sensor(picture)) @ T_world_sensor(sweep),
        )
        for sweep, picture, speed in zip(
            sweeps, pictures, speeds_mps(positions, np.diff(stamps)), strict=True
        )
    ]
    return Recording(
        camera=_camera(tables, pictures[0], calibrations[pictures[0]["calibrated_sensor_token"]]),
        lidar=LIDAR,
        frames=frames,
        point_classes=read_ontology("nuscenes-lidarseg") if point_labels else None,
    )


def _keyframes(tables: Tables, request: Request) -> tuple[list[Row], list[Row]]:
    """Rows of sample_data of the sweeps and of the pictures, in order of time."""
    samples = _samples(tables, request)
    channels = _channels(tables)
    cameras = sorted({channel for channel in channels.values() if channel.startswith("CAM_")})
    camera = pick("camera", request.camera or USUAL_CAMERA, cameras, request.root)
    found: dict[str, dict[str, Row]] = {LIDAR_CHANNEL: {}, camera: {}}
    for row in tables.rows("sample_data"):
        channel = channels.get(row.get("calibrated_sensor_token", ""))
        if row.get("is_key_frame") and row.get("sample_token") in samples and channel in found:
            for key in ("token", "filename", "timestamp", "ego_pose_token"):
                tables.get("sample_data", row, key)
            found[channel][row["sample_token"]] = row
    both = sorted(
        found[LIDAR_CHANNEL].keys() & found[camera].keys(), key=lambda s: found[camera][s]["timestamp"]
    )
    if not both:
        raise InputError(f"{tables.path('sample_data')}: found no keyframe of {LIDAR_CHANNEL} and {camera}")
    return [found[LIDAR_CHANNEL][sample] for sample in both], [found[camera][sample] for sample in both]


def _samples(tables: Tables, request: Request) -> set[str]:
    scenes = {str(tables.get("scene", row, "name")): row for row in tables.rows("scene")}
    scene = scenes[pick("sequence", request.sequence, sorted(scenes), request.root)]
    token = tables.get("scene", scene, "token")
    return {
        tables.get("sample", row, "token") for row in tables.rows("sample") if row.get("scene_token") == token
    }


def _channels(tables: Tables) -> dict[str, str]:
    """The channel of each row of calibrated_sensor."""
    sensors = {
        tables.get("sensor", row, "token"): str(tables.get("sensor", row, "channel"))
        for row in tables.rows("sensor")
    }
    rows = tables.rows("calibrated_sensor")
    return {row.get("token", ""): sensors.get(row.get("sensor_token", ""), "") for row in rows}


def _camera(tables: Tables, picture: Row, calibration: Row) -> dict[str, Any]:
    """Pictures of nuScenes come without distortion."""
    return {
        "model": "plumb_bob",
        "width": tables.get("sample_data", picture, "width"),
        "height": tables.get("sample_data", picture, "height"),
        "K": tables.get("calibrated_sensor", calibration, "camera_intrinsic"),
    }


def _lidarseg(tables: Tables, root: Path) -> dict[str, Path]:
    """Label files by the token of the sweep; none if nuScenes-lidarseg is not there."""
    if not tables.path("lidarseg").exists():
        return {}
    rows = tables.rows("lidarseg")
    return {
        tables.get("lidarseg", row, "sample_data_token"): root / tables.get("lidarseg", row, "filename")
        for row in rows
    }
