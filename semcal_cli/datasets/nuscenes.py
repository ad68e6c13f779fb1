"""nuScenes: keyframes of a scene, from the tables in ROOT/v1.0-mini.

Quaternions have w first. Sensor poses map the sensor to the vehicle, vehicle poses map the vehicle to the world at the
time of each sensor:
T_camera_lidar = inv(T_ego_camera) inv(T_world_ego at the image) (T_world_ego at the sweep) T_ego_lidar.
Predictions are named after the token of the sweep, as <token>_lidarseg.bin (nuscenes-devkit, eval/lidarseg/README.md).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from semcal_cli.datasets.files import folders, inside, need_file
from semcal_cli.datasets.nuscenes_tables import (
    CalibratedSensor,
    EgoPose,
    Lidarseg,
    Sample,
    SampleData,
    Scene,
    Sensor,
    Tables,
)
from semcal_cli.datasets.ontologies import read_ontology
from semcal_cli.datasets.recording import Recording, Request, SourceFrame
from semcal_cli.datasets.trajectory import speeds_mps
from semcal_cli.errors import InputError
from semcal_cli.files.messages import describe
from semcal_cli.files.validation import MAX_TRANSLATION_M
from semcal_cli.formats.values import camera_block, image_side, pick, rigid
from semcal_cli.geometry.poses import Pose, inverse

LIDAR_CHANNEL = "LIDAR_TOP"
USUAL_CAMERA = "CAM_FRONT"
LIDAR = {"channels": 32, "columns": 1084, "fov_up_deg": 10.67, "fov_down_deg": -30.67}
"""Scan pattern of the Velodyne HDL-32E at 20 turns a second."""
MICROSECONDS = 1e-6


def read(request: Request) -> Recording:
    """Find the keyframes of a scene, each with its own T_camera_lidar through the poses of the vehicle.

    Raises:
        InputError: the scene, the camera, a row or a file is missing or wrong, or no keyframe is complete.
    """
    versions = [name for name in folders(request.root) if name.startswith("v1.0")]
    tables = Tables(request.root / pick("version", request.version, versions, request.root))
    sensors = tables.rows("calibrated_sensor", CalibratedSensor)
    keyframes = _keyframes(tables, sensors, request)
    T_world_sensor = _sensor_poses(tables, [row for pair in keyframes for row in pair])
    point_labels = _lidarseg(tables, request.root)
    frames = [
        SourceFrame(
            name=sweep.token,
            points=_file(tables, request.root, sweep),
            point_labels=need_file(point_labels[sweep.token]) if sweep.token in point_labels else None,
            image=_file(tables, request.root, image),
            points_stamp=sweep.timestamp * MICROSECONDS,
            image_stamp=image.timestamp * MICROSECONDS,
            speed_mps=speed,
            T_camera_lidar=rigid(
                f"{tables.path('ego_pose')}: rows {describe(sweep.ego_pose_token)} and "
                f"{describe(image.ego_pose_token)}: T_camera_lidar",
                inverse(T_world_sensor[image.token]) @ T_world_sensor[sweep.token],
                MAX_TRANSLATION_M,
            ),
            label_names=(f"{sweep.token}_lidarseg",),
        )
        for (sweep, image), speed in zip(keyframes, _speeds(keyframes, T_world_sensor), strict=True)
    ]
    return Recording(
        camera=_camera(tables, keyframes[0][1], sensors),
        lidar=LIDAR,
        frames=frames,
        point_classes=read_ontology("nuscenes-lidarseg") if point_labels else None,
    )


def _keyframes(
    tables: Tables, sensors: list[CalibratedSensor], request: Request
) -> list[tuple[SampleData, SampleData]]:
    """Find the sweep and the image of each sample of the scene that has both, in order of time."""
    samples = _samples(tables, request)
    names = {row.token: row.channel for row in tables.rows("sensor", Sensor)}
    channels = {row.token: names.get(row.sensor_token, "") for row in sensors}
    cameras = sorted({channel for channel in channels.values() if channel.startswith("CAM_")})
    camera = pick("camera", request.camera, cameras, request.root, usual=USUAL_CAMERA)
    found: dict[str, dict[str, SampleData]] = {LIDAR_CHANNEL: {}, camera: {}}
    for row in tables.rows("sample_data", SampleData):
        channel = channels.get(row.calibrated_sensor_token, "")
        if row.is_key_frame and row.sample_token in samples and channel in found:
            found[channel][row.sample_token] = row
    sweeps, images = found[LIDAR_CHANNEL], found[camera]
    both = [(sweeps[sample], images[sample]) for sample in sweeps if sample in images]
    if not both:
        raise InputError(
            f"{tables.path('sample_data')}: found no keyframe of both {LIDAR_CHANNEL} and {camera}"
        )
    return sorted(both, key=lambda pair: pair[0].timestamp)


def _samples(tables: Tables, request: Request) -> set[str]:
    scenes = {row.name: row.token for row in tables.rows("scene", Scene)}
    scene = scenes[pick("sequence", request.sequence, sorted(scenes), request.root)]
    return {row.token for row in tables.rows("sample", Sample) if row.scene_token == scene}


def _sensor_poses(tables: Tables, rows: list[SampleData]) -> dict[str, Pose]:
    """Compute T_world_sensor (4, 4) at the time of each file, by the token of its row."""
    T_ego_sensor = tables.poses(
        "calibrated_sensor", CalibratedSensor, {row.calibrated_sensor_token for row in rows}
    )
    T_world_ego = tables.poses("ego_pose", EgoPose, {row.ego_pose_token for row in rows})
    return {
        row.token: T_world_ego[row.ego_pose_token] @ T_ego_sensor[row.calibrated_sensor_token] for row in rows
    }


def _speeds(keyframes: list[tuple[SampleData, SampleData]], T_world_sensor: dict[str, Pose]) -> list[float]:
    positions = np.array([T_world_sensor[sweep.token][:3, 3] for sweep, _ in keyframes])
    stamps_s = np.array([sweep.timestamp * MICROSECONDS for sweep, _ in keyframes])
    return [float(speed) for speed in speeds_mps(positions, np.diff(stamps_s))]


def _camera(tables: Tables, image: SampleData, sensors: list[CalibratedSensor]) -> dict[str, Any]:
    """Make the camera block; images of nuScenes have no distortion."""
    sensor = next(row for row in sensors if row.token == image.calibrated_sensor_token)
    K = [list(values) for values in sensor.camera_intrinsic]
    row = f"{tables.path('sample_data')}: row {describe(image.token)}"
    width, height = (
        image_side(f"{row}: {key}", side) for key, side in (("width", image.width), ("height", image.height))
    )
    block = {"model": "plumb_bob", "width": width, "height": height, "K": K}
    key = f"row {describe(sensor.token)}: camera_intrinsic"
    return camera_block(tables.path("calibrated_sensor"), block, {"K": key})


def _lidarseg(tables: Tables, root: Path) -> dict[str, Path]:
    """Find the label files by the token of the sweep; none without nuScenes-lidarseg."""
    if not tables.path("lidarseg").exists():
        return {}
    return {
        row.sample_data_token: inside(root, row.filename, _filename(tables, "lidarseg", row.token))
        for row in tables.rows("lidarseg", Lidarseg)
    }


def _file(tables: Tables, root: Path, row: SampleData) -> Path:
    return need_file(inside(root, row.filename, _filename(tables, "sample_data", row.token)))


def _filename(tables: Tables, table: str, token: str) -> str:
    return f"{tables.path(table)}: row {describe(token)}: filename"
