"""MAN TruckScenes: keyframes of a scene, from the tables in ROOT/v1.2-mini (schema_truckscenes.md of its devkit).

The tables are nuScenes' with several LiDARs. Sweeps are as measured: each point has its own time, in microseconds on
the clock of the tables. Poses map the vehicle to the world at their own times.
"""

from __future__ import annotations

from semcal_cli.config.point_files import PointForm
from semcal_cli.drive.frame_ids import FrameIds
from semcal_cli.files.validation import MAX_TRANSLATION_M
from semcal_cli.formats.node import Node, rigid
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse
from semcal_cli.importing import reads
from semcal_cli.importing.nuscenes import MICROSECONDS, ViewedScene, find_scene, read_pose, stamp_s, text
from semcal_cli.importing.recording import Recording, Request, SourceFrame, with_trajectory

DEFAULT_LIDAR = "LIDAR_LEFT"
DEFAULT_CAMERA = "CAMERA_LEFT_FRONT"
SWEEP_S = 0.1
"""Duration of a sweep. Which moment of it the stamp of the sweep is, is not stated."""


@reads("lidar", "version")
def read(request: Request) -> Recording:
    """MAN TruckScenes keyframes: ROOT/v1.2-mini and samples; by default CAMERA_LEFT_FRONT and LIDAR_LEFT.

    Raises:
        InputError: the scene, the camera, the LiDAR, a row or a file is missing or wrong, or no keyframe has poses.
    """
    scene = find_scene(request, DEFAULT_LIDAR, DEFAULT_CAMERA)
    T_ego_lidar, T_ego_camera = (read_pose(scene.sensor(row)) for row in scene.keyframes[0])
    where = f"{scene.tables.path('calibrated_sensor')}: T_camera_lidar"
    T_camera_lidar = rigid(where, inverse(T_ego_camera) @ T_ego_lidar, MAX_TRANSLATION_M)
    named, remarks = FrameIds.of_recording(scene.lidar, scene.camera)
    recording = Recording(
        camera=scene.camera_block(),
        frames=[_frame(scene, sweep, image) for sweep, image in scene.keyframes],
        T_camera_lidar=T_camera_lidar,
        frame_ids=None if named is None else named.model_dump(exclude_none=True),
        point_form=PointForm(time_unit="us"),
        synchronization="stamps",
        remarks=tuple(remarks),
    )
    poses = _lidar_poses(scene, T_ego_lidar)
    source = scene.tables.path("ego_pose")
    return with_trajectory(recording, poses, source, point_times="absolute", sweep_s=SWEEP_S)


def _frame(scene: ViewedScene, sweep: Node, image: Node) -> SourceFrame:
    return SourceFrame(
        name=text(sweep, "token"),
        points=scene.tables.file(sweep),
        image=scene.tables.file(image),
        points_stamp=stamp_s(sweep),
        image_stamp=stamp_s(image),
    )


def _lidar_poses(scene: ViewedScene, T_ego_lidar: Pose) -> dict[int, Pose]:
    """Compute T_world_lidar (4, 4) by their times in nanoseconds, ascending."""
    rows = sorted(scene.ego_poses(scene.rows).values(), key=stamp_s)
    # Stamps are whole numbers of microseconds.
    return {round(stamp_s(row) / MICROSECONDS) * 1_000: read_pose(row) @ T_ego_lidar for row in rows}
