"""Prints a Markdown table: what calibrations with a sparse LiDAR gain by accumulation.

    python tests/benchmarks/accumulation.py [--streets 8]

A Livox Mid-360 (360 by 59 degrees, 200,000 points a second at 10 Hz, up to 70 m: its data sheet) stands for 10 s in
each of several synthetic streets, or drives 3 s along each at 5 m/s. Its sweeps are accumulated: all of a street, or
those of each second by the motion that KISS-ICP estimates. Calibrations by labels start from nothing, those by edges 2
degrees and 0.2 m off. Beside them are the same images with one sweep each. Needs the extra `odometry`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import yaml

sys.path.insert(0, str(Path(__file__).parents[1]))
from benchmark import script, table
from moving_street import MovingStreet

from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.importing.accumulated_drive import accumulate_drive
from semcal_cli.importing.drive_odometry import drive_motion
from semcal_cli.importing.merged_drive import merge_drives
from semcal_cli.importing.stamps import tum_text
from semcal_cli.importing.sweep_odometry import SIGMA
from semcal_cli.observations.loading import load
from semcal_cli.pipeline import calibrate

MID_360 = {"fov_up_deg": 52.0, "fov_down_deg": -7.0, "max_range_m": 70.0}
SPEED_M_S, TURN_RAD_S, MOVING_SWEEPS = 5.0, 0.2, 30
APART_S = 100.0
"""Time from one street to the next."""
START_DEG, START_M = 2.0, 0.2


def main(
    *,
    streets: int = 8,
    first_seed: int = 97000,
    sweeps: int = 100,
    points: int = 20_000,
    width: int = 1280,
    cue: tuple[str, ...] = ("labels", "edges"),
) -> Iterator[str]:
    """Print the table."""
    header = "rig | cue | frames | points a frame | rotation, deg | camera centre, cm | status"
    yield from table(header, rows(range(first_seed, first_seed + streets), sweeps, points, width, cue))


def rows(
    seeds: range, sweeps: int, points: int, width: int, cues: tuple[str, ...]
) -> Iterator[tuple[str, ...]]:
    for speed_m_s in (0.0, SPEED_M_S):
        name = f"moves at {speed_m_s:g} m/s" if speed_m_s else f"stands for {sweeps / 10:g} s"
        with TemporaryDirectory() as folder:
            of_sweeps, of_clouds = list[Drive](), list[Drive]()
            for number, seed in enumerate(seeds):
                one, dense = drives(
                    Path(folder) / str(number), seed, number, speed_m_s, (sweeps, points, width)
                )
                of_sweeps.append(one)
                of_clouds.append(dense)
            for kind, parts in (("one sweep", of_sweeps), ("accumulated", of_clouds)):
                path = merge_drives(parts, Path(folder) / kind).path
                for cue in cues:
                    yield f"{name}, {kind}", cue, *calibrated(read_drive(path), cue)


def drives(
    folder: Path, seed: int, number: int, speed_m_s: float, size: tuple[int, int, int]
) -> tuple[Drive, Drive]:
    """Make the drive of the sweeps with images, and the accumulated one, of a street."""
    sweeps, points, width = size
    count = MOVING_SWEEPS if speed_m_s else sweeps
    images = range(5, count, 10) if speed_m_s else [count // 2]
    turn_rad_s = TURN_RAD_S if speed_m_s else 0.0
    street = MovingStreet(speed_m_s, turn_rad_s, seed, points, width, num_sweeps=count, rig_seed=7, **MID_360)
    path = street.write(folder / "sweeps", count=count, images=images)
    document = yaml.safe_load(path.read_text())
    for frame in document["frames"]:
        for key in {"points_stamp", "image_stamp"} & frame.keys():
            frame[key] += APART_S * number
    document["motion"] = {"speed_m_s": 0.0}
    path.write_text(yaml.safe_dump(document))
    if speed_m_s:
        motion = drive_motion(read_drive(path))
        (folder / "sweeps/poses.txt").write_text(tum_text(motion.poses))
        document["motion"] = {"poses": "poses.txt", "point_times": motion.point_times, "sigma": SIGMA}
        path.write_text(yaml.safe_dump(document))
    drive = read_drive(path)
    seconds = 1.0 if speed_m_s else 0.1 * count
    dense = accumulate_drive(drive, folder / "dense", seconds=seconds).drive
    document["frames"] = [document["frames"][index] for index in images]
    other = path.with_name("images.yaml")
    other.write_text(yaml.safe_dump(document))
    return read_drive(other), read_drive(dense.path)


def calibrated(drive: Drive, cue: str) -> tuple[str, ...]:
    config = CalibrationConfig(cues=(cue,))
    truth = np.array(drive.T_camera_lidar)
    start = None
    if cue != "labels":
        start = InitialPose(displace(truth, START_DEG, START_M, np.random.default_rng(1)), "start")
    data = load(drive, config)
    found = calibrate(data, config, initial_pose=start)
    error = compare_poses(found.pose, truth)
    num_points = np.median([cloud.num_points for cloud in data.observations.clouds])
    return (
        str(len(drive.frames)),
        f"{num_points:,.0f}",
        f"{error.rotation_deg:.3f}",
        f"{error.camera_center_cm:.2f}",
        found.status.replace("_", " "),
    )


if __name__ == "__main__":
    script(main)
