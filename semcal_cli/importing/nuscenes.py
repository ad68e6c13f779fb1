"""nuScenes: keyframes of a scene, from the tables in ROOT/v1.0-mini (schema_nuscenes.md of nutonomy/nuscenes-devkit).

Quaternions have w first. Sensor poses map the sensor to the vehicle, vehicle poses map the vehicle to the world at the
time of each sensor:
T_camera_lidar = inv(T_ego_camera) inv(T_world_ego at the image) (T_world_ego at the sweep) T_ego_lidar.
Predictions are named after the token of the sweep, as <token>_lidarseg.bin (nuscenes-devkit, eval/lidarseg/README.md).
Other data sets have the same tables, with several LiDARs: `find_scene` reads them for plugins, too.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from semcal_cli.drive.frame_ids import FrameIds
from semcal_cli.errors import InputError, describe
from semcal_cli.files.rows import read_rows
from semcal_cli.files.validation import MAX_TRANSLATION_M
from semcal_cli.formats.node import MAX_STAMP_S, MAX_WORLD_M, Node, checked_camera_block, number, pick, rigid
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse, pose_from_quaternion
from semcal_cli.importing.dataset_tree import folders, inside, need_file, speeds_mps
from semcal_cli.importing.ontologies import read_ontology
from semcal_cli.importing.recording import Recording, Request, SourceFrame

LIDAR_CHANNEL = "LIDAR_TOP"
DEFAULT_CAMERA = "CAM_FRONT"
LIDAR = {"channels": 32, "columns": 1084, "fov_up_deg": 10.67, "fov_down_deg": -30.67}
"""Scan pattern of the Velodyne HDL-32E at 20 turns per second."""
MICROSECONDS = 1e-6


@dataclass(frozen=True)
class Tables:
    """The tables of one version of the data set: lists of rows with tokens."""

    root: Path
    """Folder of the data set."""
    folder: Path

    def path(self, table: str) -> Path:
        """Locate the file of a table."""
        return self.folder / f"{table}.json"

    def rows(self, table: str) -> Iterator[tuple[str, Node]]:
        """Read the rows of a table with their tokens.

        Raises:
            InputError: the table does not exist, or a row is not a mapping with a token.
        """
        path = self.path(table)
        for index, row in enumerate(read_rows(path)):
            node = Node(str(path), row, f"[{index}]")
            yield text(node, "token"), node

    def rows_with(self, table: str, tokens: Collection[str]) -> dict[str, Node]:
        """Read the rows with these tokens.

        Raises:
            InputError: a row is missing.
        """
        rows = {token: row for token, row in self.rows(table) if token in tokens}
        if missing := sorted(set(tokens) - rows.keys()):
            raise InputError(f"{self.path(table)}: found no row with token {describe(missing[0])}")
        return rows

    def file(self, row: Node) -> Path:
        """Locate the file that a row names.

        Raises:
            InputError: the name does not lead to a file inside the data set, or the file does not exist.
        """
        filename = row.at("filename")
        return need_file(inside(self.root, filename.value, filename.where))


@dataclass(frozen=True)
class ViewedScene:
    """A scene as one LiDAR and one camera see it."""

    tables: Tables
    lidar: str
    """Channel of the LiDAR."""
    camera: str
    """Channel of the camera."""
    sensors: dict[str, Node]
    """Rows of calibrated_sensor by their tokens."""
    rows: list[Node]
    """Rows of sample_data of the LiDAR and the camera."""
    keyframes: list[tuple[Node, Node]]
    """Those of the sweep and the image of each sample that has both, in order of time."""

    def sensor(self, row: Node) -> Node:
        """Look up the row of calibrated_sensor of a row of sample_data."""
        return self.sensors[text(row, "calibrated_sensor_token")]

    def ego_poses(self, rows: list[Node]) -> dict[str, Node]:
        """Read the rows of ego_pose of rows of sample_data, by their tokens.

        Raises:
            InputError: a row is missing.
        """
        return self.tables.rows_with("ego_pose", {text(row, "ego_pose_token") for row in rows})

    def camera_block(self) -> dict[str, Any]:
        """Make the camera block; the images are undistorted.

        Raises:
            InputError: the intrinsics or the size of the image are wrong.
        """
        _, image = self.keyframes[0]
        K = self.sensor(image).at("camera_intrinsic")
        width, height = (image.at(key).side() for key in ("width", "height"))
        block = {"model": "plumb_bob", "width": width, "height": height, "K": K.rows(3)}
        return checked_camera_block(K.file, block, {"K": K.key})


def read(request: Request) -> Recording:
    """Find the keyframes of a scene, each with its own T_camera_lidar through the poses of the vehicle.

    Raises:
        InputError: the scene, the camera, a row or a file is missing or wrong, or no keyframe is complete.
    """
    scene = find_scene(request, LIDAR_CHANNEL, DEFAULT_CAMERA)
    has_labels = scene.tables.path("lidarseg").exists()
    labels = (
        {text(row, "sample_data_token"): row for _, row in scene.tables.rows("lidarseg")}
        if has_labels
        else {}
    )
    named, remarks = FrameIds.of_recording(scene.lidar, scene.camera)
    return Recording(
        camera=scene.camera_block(),
        lidar=LIDAR,
        frame_ids=None if named is None else named.model_dump(exclude_none=True),
        frames=_frames(scene, labels),
        point_classes=read_ontology("nuscenes-lidarseg") if labels else None,
        # A camera is exposed when the LiDAR sweeps across the centre of its view (nuscenes.org, data collection).
        synchronization="hardware",
        remarks=tuple(remarks),
    )


def text(row: Node, key: str) -> str:
    """Read a string of a row, such as the token of another row."""
    return row.at(key).text()


def find_scene(request: Request, lidar: str, camera: str) -> ViewedScene:
    """Choose the tables, the scene, the LiDAR and the camera.

    Args:
        request: What the user asks for.
        lidar: Channel of the LiDAR if the user names none.
        camera: Channel of the camera if the user names none.

    Raises:
        InputError: one of them, or a row, is missing or wrong, or no sample has a sweep and an image.
    """
    versions = [name for name in folders(request.root) if name.startswith("v1.")]
    version = pick(
        "version",
        request.version,
        versions,
        request.root,
        expected="folders such as v1.0-mini and samples in ROOT",
    )
    tables = Tables(request.root, request.root / version)
    sensors = dict(tables.rows("calibrated_sensor"))
    scenes = {text(row, "name"): token for token, row in tables.rows("scene")}
    scene = scenes[pick("sequence", request.sequence, sorted(scenes), request.root)]
    samples = {token for token, row in tables.rows("sample") if text(row, "scene_token") == scene}
    names = {token: text(row, "channel") for token, row in tables.rows("sensor")}
    channels = {token: names.get(text(row, "sensor_token"), "") for token, row in sensors.items()}
    lidars, cameras = (
        sorted({name for name in channels.values() if name.startswith(kind)}) for kind in ("LIDAR_", "CAM")
    )
    if request.lidar is not None:
        lidar = pick("lidar", request.lidar, lidars, request.root)
    camera = pick("camera", request.camera, cameras, request.root, default=camera)
    rows: dict[str, list[Node]] = {lidar: [], camera: []}
    for _, row in tables.rows("sample_data"):
        channel = channels.get(text(row, "calibrated_sensor_token"), "")
        if channel in rows and text(row, "sample_token") in samples:
            rows[channel].append(row)
    sweeps, images = (
        {text(row, "sample_token"): row for row in channel_rows if row.at("is_key_frame").value is True}
        for channel_rows in rows.values()
    )
    both = [(sweeps[sample], images[sample]) for sample in sweeps if sample in images]
    if not both:
        raise InputError(f"{tables.path('sample_data')}: found no keyframe of both {lidar} and {camera}")
    keyframes = sorted(both, key=lambda pair: stamp_s(pair[0]))
    return ViewedScene(tables, lidar, camera, sensors, [*rows[lidar], *rows[camera]], keyframes)


def _frames(scene: ViewedScene, labels: dict[str, Node]) -> list[SourceFrame]:
    tables, keyframes = scene.tables, scene.keyframes
    T_world_sensor = _sensor_poses(scene)
    T_world_lidar = [T_world_sensor[text(sweep, "token")] for sweep, _ in keyframes]
    stamps_s = np.array([stamp_s(sweep) for sweep, _ in keyframes])
    speeds = speeds_mps(np.array([T[:3, 3] for T in T_world_lidar]), np.diff(stamps_s))
    frames = []
    for (sweep, image), T, speed in zip(keyframes, T_world_lidar, speeds, strict=True):
        name = text(sweep, "token")
        tokens = " and ".join(describe(text(row, "ego_pose_token")) for row in (sweep, image))
        where = f"{tables.path('ego_pose')}: rows {tokens}: T_camera_lidar"
        T_camera_lidar = inverse(T_world_sensor[text(image, "token")]) @ T
        frames.append(
            SourceFrame(
                name=name,
                points=tables.file(sweep),
                point_labels=tables.file(labels[name]) if name in labels else None,
                image=tables.file(image),
                points_stamp=stamp_s(sweep),
                image_stamp=stamp_s(image),
                speed_mps=float(speed),
                T_camera_lidar=rigid(where, T_camera_lidar, MAX_TRANSLATION_M),
                label_names=(f"{name}_lidarseg",),
            )
        )
    return frames


def _sensor_poses(scene: ViewedScene) -> dict[str, Pose]:
    """Compute T_world_sensor (4, 4) at the time of each file of a keyframe, by the token of its row."""
    rows = [row for pair in scene.keyframes for row in pair]
    T_world_ego = {token: read_pose(row) for token, row in scene.ego_poses(rows).items()}
    return {
        text(row, "token"): T_world_ego[text(row, "ego_pose_token")] @ read_pose(scene.sensor(row))
        for row in rows
    }


def stamp_s(row: Node) -> float:
    """Read the Unix time of a row, in seconds."""
    return row.at("timestamp").number(0.0, MAX_STAMP_S / MICROSECONDS) * MICROSECONDS


def read_pose(row: Node) -> Pose:
    """Read T_vehicle_sensor or T_world_vehicle (4, 4) of a row, in metres."""
    translation_node, (w, x, y, z) = row.at("translation"), row.at("rotation").numbers(4)
    translation = [
        number(translation_node.where, value, -MAX_WORLD_M, MAX_WORLD_M)
        for value in translation_node.numbers(3)
    ]
    try:
        return pose_from_quaternion((x, y, z, w), translation)
    except ValueError as error:
        raise InputError(f"{row.where}: {error}") from None
