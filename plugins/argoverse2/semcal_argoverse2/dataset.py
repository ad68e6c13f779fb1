"""Argoverse 2 Sensor: logs in ROOT, or in ROOT/train, ROOT/val and ROOT/test (argoverse.github.io/user-guide).

A sweep holds the points of two LiDARs in the frame of the vehicle, all moved to the time in its name: lasers 0 to 31
are those of up_lidar, 32 to 63 those of down_lidar. A drive has the points of one of them, in its own frame, so that
T_camera_lidar = inv(T_ego_camera) T_ego_lidar. Images are undistorted: k1 k2 k3 of the lenses play no part.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from semcal_argoverse2.feather_tables import read_columns, read_sensors
from semcal_cli.config.nanoseconds import NS
from semcal_cli.drive.frame_ids import FrameIds
from semcal_cli.errors import InputError
from semcal_cli.formats.node import MAX_WORLD_M, checked_camera_block, image_side, pick, rigid, stamp_s
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import inverse, pose_from_quaternion
from semcal_cli.importing import reads
from semcal_cli.importing.dataset_tree import folders, numbered_files
from semcal_cli.importing.recording import Cloud, Conversion, Recording, Request, SourceFrame, with_trajectory

SPLITS = ("train", "val", "test")
EXTRINSICS = "calibration/egovehicle_SE3_sensor.feather"
INTRINSICS = "calibration/intrinsics.feather"
POSES = "city_SE3_egovehicle.feather"
POSE_COLUMNS = ("qx", "qy", "qz", "qw", "tx_m", "ty_m", "tz_m")
DEFAULT_CAMERA = "ring_front_center"
DEFAULT_LIDAR = "up_lidar"
LASERS = {"up_lidar": range(32), "down_lidar": range(32, 64)}
"""Numbers of the lasers of each LiDAR."""
MAX_GAP_NS = NS // 20
"""Longest time between a sweep and its image: half the time between two sweeps."""
MIN_STEP_NS = 1_000
"""Shortest time between two poses that are kept. The files have pairs of the same pose, 1 ns apart."""


@reads("lidar")
def read(request: Request) -> Recording:
    """Argoverse 2 Sensor: ROOT/LOG or ROOT/train/LOG; by default ring_front_center and up_lidar.

    Raises:
        InputError: the log, the camera, the LiDAR or a file is missing or wrong, or no sweep has an image and poses.
    """
    logs = _find_logs(request.root)
    expected = f"folders of logs, with {EXTRINSICS}"
    log = logs[pick("sequence", request.sequence, [*logs], request.root, expected=expected)]
    intrinsics = read_sensors(log / INTRINSICS, "fx_px", "fy_px", "cx_px", "cy_px", "width_px", "height_px")
    camera = pick("camera", request.camera, [*intrinsics], log / INTRINSICS, default=DEFAULT_CAMERA)
    lidar = pick("lidar", request.lidar, [*LASERS], request.root, default=DEFAULT_LIDAR)
    T_ego_lidar, T_ego_camera = _read_mountings(log / EXTRINSICS, lidar, camera)
    poses = {stamp_ns: T @ T_ego_lidar for stamp_ns, T in _read_poses(log / POSES).items()}
    named, remarks = FrameIds.of_recording(lidar, camera)
    recording = Recording(
        camera=_camera(log / INTRINSICS, intrinsics[camera]),
        frames=_find_frames(
            log, camera, partial(_cut, lasers=LASERS[lidar], T_lidar_ego=inverse(T_ego_lidar))
        ),
        T_camera_lidar=inverse(T_ego_camera) @ T_ego_lidar,
        frame_ids=None if named is None else named.model_dump(exclude_none=True),
        # Exposures are centred on the moment at which a LiDAR sweeps through the camera's view (user guide).
        synchronization="hardware",
        remarks=tuple(remarks),
    )
    return with_trajectory(recording, poses, log / POSES, point_times="deskewed")


def _find_logs(root: Path) -> dict[str, Path]:
    """Find the folders of logs by their names."""
    parents = [root, *(root / split for split in SPLITS if (root / split).is_dir())]
    logs = {name: parent / name for parent in parents for name in folders(parent)}
    return {name: log for name, log in sorted(logs.items()) if (log / EXTRINSICS).exists()}


def _read_mountings(path: Path, *sensors: str) -> list[Pose]:
    """Read T_ego_sensor (4, 4) of sensors, metres."""
    rows = read_sensors(path, *POSE_COLUMNS)
    if missing := [sensor for sensor in sensors if sensor not in rows]:
        raise InputError(f"{path}: found no row with sensor_name {missing[0]}")
    return [rigid(f"{path}: {sensor}", _pose(path, [*rows[sensor].values()])) for sensor in sensors]


def _read_poses(path: Path) -> dict[int, Pose]:
    """Read T_city_ego (4, 4) by their times in nanoseconds, ascending, metres."""
    columns = read_columns(path, "timestamp_ns", *POSE_COLUMNS)
    poses: dict[int, Pose] = {}
    next_ns = 0
    for stamp_ns, *values in sorted(zip(*(column.tolist() for column in columns), strict=True)):
        if stamp_ns >= next_ns:
            poses[int(stamp_ns)] = rigid(f"{path}: timestamp_ns {stamp_ns}", _pose(path, values), MAX_WORLD_M)
            next_ns = stamp_ns + MIN_STEP_NS
    return poses


def _pose(path: Path, values: Sequence[float]) -> Pose:
    try:
        return pose_from_quaternion(values[:4], values[4:])
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None


def _camera(path: Path, row: Mapping[str, float]) -> dict[str, Any]:
    """Make the camera block of undistorted images."""
    K = [[row["fx_px"], 0.0, row["cx_px"]], [0.0, row["fy_px"], row["cy_px"]], [0.0, 0.0, 1.0]]
    width, height = (image_side(f"{path}: {key}", row[key]) for key in ("width_px", "height_px"))
    return checked_camera_block(path, {"model": "plumb_bob", "width": width, "height": height, "K": K}, {})


def _files(log: Path, folder: str, suffix: str) -> dict[int, Path]:
    """Find the files of a sensor by the times in their names, in nanoseconds, ascending."""
    files = numbered_files(log / "sensors" / folder, suffix)
    for file in files.values():
        stamp_s(str(file), int(file.stem) / NS)
    return {int(name): file for name, file in files.items()}


def _find_frames(log: Path, camera: str, cut: Callable[[Path], Cloud]) -> list[SourceFrame]:
    """Pair sweeps and images that are nearest to one another in time."""
    sweeps, images = _files(log, "lidar", ".feather"), _files(log, f"cameras/{camera}", ".jpg")
    nearest = {sweep_ns: _nearest(sweep_ns, [*images]) for sweep_ns in sweeps if images}
    pairs = [
        (sweep_ns, image_ns)
        for sweep_ns, image_ns in nearest.items()
        if abs(image_ns - sweep_ns) <= MAX_GAP_NS and _nearest(image_ns, [*sweeps]) == sweep_ns
    ]
    if not pairs:
        raise InputError(f"{log}: found no sweep with an image of {camera} within {MAX_GAP_NS / NS} s")
    return [
        SourceFrame(
            name=str(sweep_ns),
            points=Conversion(partial(cut, sweeps[sweep_ns]), False, sweeps[sweep_ns], in_order=False),
            image=images[image_ns],
            points_stamp=sweep_ns / NS,
            image_stamp=image_ns / NS,
        )
        for sweep_ns, image_ns in pairs
    ]


def _nearest(stamp_ns: int, ascending_ns: Sequence[int]) -> int:
    """Find the one of some times that is nearest to another time."""
    index = bisect_left(ascending_ns, stamp_ns)
    return min(ascending_ns[max(index - 1, 0) : index + 1], key=lambda other_ns: abs(other_ns - stamp_ns))


def _cut(path: Path, lasers: range, T_lidar_ego: Pose) -> Cloud:
    """Cut the points of one LiDAR out of a sweep, and move them from the vehicle's frame to the LiDAR's."""
    *columns, laser_number = read_columns(path, "x", "y", "z", "intensity", "laser_number")
    mask = (laser_number >= lasers.start) & (laser_number < lasers.stop)
    x, y, z, intensity = (column[mask].astype(np.float64) for column in columns)
    points_lidar = np.stack([x, y, z], axis=1) @ T_lidar_ego[:3, :3].T + T_lidar_ego[:3, 3]
    return Cloud(np.column_stack([points_lidar, intensity]).astype(np.float32), None)
