"""MAN TruckScenes: keyframes of a scene, from the tables in ROOT/v1.2-mini (schema_truckscenes.md of its devkit).

The tables are nuScenes' with several LiDARs. Sweeps are as measured: each point has its own time, in microseconds on
the clock of the tables. Poses map the vehicle to the world at their own times.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from semcal_cli.config.point_files import PointForm
from semcal_cli.drive.frame_ids import FrameIds
from semcal_cli.errors import InputError, counted
from semcal_cli.files.validation import MAX_TRANSLATION_M
from semcal_cli.formats.node import Node, rigid
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse
from semcal_cli.importing import reads
from semcal_cli.importing.dataset_tree import speeds_mps
from semcal_cli.importing.nuscenes import Scene, find_scene, read_pose, stamp_s, text
from semcal_cli.importing.recording import Recording, Request, SourceFrame
from semcal_cli.importing.sweep_odometry import NS, SIGMA, are_covered

DEFAULT_LIDAR = "LIDAR_LEFT"
DEFAULT_CAMERA = "CAMERA_LEFT_FRONT"
SWEEP_NS = NS // 10
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
    poses = _lidar_poses(scene, T_ego_lidar)
    covered = [pair for pair in scene.keyframes if _is_covered(pair, [*poses])]
    if not covered:
        raise InputError(
            f"{scene.tables.path('ego_pose')}: found no keyframe with poses before and after its sweep"
        )
    named, remarks = FrameIds.of_recording(scene.lidar, scene.camera)
    if left_out := len(scene.keyframes) - len(covered):
        remarks.append(f"left out {counted(left_out, 'keyframe')} without poses before and after the sweep")
    return Recording(
        camera=scene.camera_block(),
        frames=_frames(scene, covered, poses),
        T_camera_lidar=T_camera_lidar,
        frame_ids=None if named is None else named.model_dump(exclude_none=True),
        point_form=PointForm(time_unit="us"),
        motion={"point_times": "absolute", "sigma": SIGMA},
        poses=poses,
        synchronization="stamps",
        remarks=tuple(remarks),
    )


def _lidar_poses(scene: Scene, T_ego_lidar: Pose) -> dict[int, Pose]:
    """Compute T_world_lidar (4, 4) by their times in nanoseconds, ascending."""
    rows = sorted(scene.ego_poses(scene.rows).values(), key=stamp_s)
    return {_stamp_ns(row): read_pose(row) @ T_ego_lidar for row in rows}


def _stamp_ns(row: Node) -> int:
    """Read the Unix time of a row, which is a whole number of microseconds, in nanoseconds."""
    return round(stamp_s(row) * 1e6) * 1_000


def _is_covered(keyframe: tuple[Node, Node], stamps_ns: Sequence[int]) -> bool:
    """Return whether there are poses before and after all points of the sweep, and the image."""
    sweep_ns, image_ns = map(_stamp_ns, keyframe)
    return are_covered(stamps_ns, (sweep_ns - SWEEP_NS, sweep_ns + SWEEP_NS, image_ns))


def _frames(
    scene: Scene, keyframes: Sequence[tuple[Node, Node]], poses: Mapping[int, Pose]
) -> list[SourceFrame]:
    stamps_s = np.array([stamp_s(sweep) for sweep, _ in keyframes])
    times_s, positions = np.array([*poses]) / NS, np.array([T[:3, 3] for T in poses.values()])
    at_sweeps = np.column_stack([np.interp(stamps_s, times_s, axis) for axis in positions.T])
    speeds = speeds_mps(at_sweeps, np.diff(stamps_s))
    return [
        SourceFrame(
            name=text(sweep, "token"),
            points=scene.tables.file(sweep),
            image=scene.tables.file(image),
            points_stamp=stamp_s(sweep),
            image_stamp=stamp_s(image),
            speed_mps=float(speed),
        )
        for (sweep, image), speed in zip(keyframes, speeds, strict=True)
    ]
