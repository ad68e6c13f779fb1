"""Prints a Markdown table: what deskewing by azimuth does for KITTI's rigs, and when their images are taken.

    python tests/benchmarks/spin.py ../shared/data [--starts 3] [--only NAME] [--from-deg 2] [--from-m 0.2]

KITTI raw's right camera, all drives of the day, has the motion of its inertial unit. A street of KITTI-360 has poses by
KISS-ICP, from its skewed sweeps. Each is calibrated by edges as it is recorded, deskewed by the speed that its sweeps
show, and deskewed by its motion with images of several moments after the LiDAR faces forward. Offsets of the camera's
centre from the published one are along the LiDAR's axes, ahead and to the left.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from benchmark import script, summary
from real_data import READERS

from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.lidar import Lidar
from semcal_cli.drive.stated_motion import Motion
from semcal_cli.errors import SemcalError
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.experiments.summary import NUMBER, Column, common, count, digits, measure_of, median
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import camera_center, compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.importing import read_dataset
from semcal_cli.importing.choice import FrameChoice
from semcal_cli.importing.drive_folder import write_drive
from semcal_cli.importing.kitti_motion import MOMENT_S, SPIN, poses_along
from semcal_cli.importing.recording import Request
from semcal_cli.importing.stamps import tum_text
from semcal_cli.importing.sweep_odometry import twist_from
from semcal_cli.pipeline import calibrate

MOMENTS_MS = (0.0, 1e3 * MOMENT_S, 7.4)
PERIOD_S = 0.1
FIRST_SEED = 90


class Run(NamedTuple):
    """What one calibration says."""

    drive: str
    images: str
    rotation_deg: float = np.inf
    camera_center_cm: float = np.inf
    ahead_cm: float = np.nan
    left_cm: float = np.nan
    information_nats: float = np.nan
    is_trusted: bool = False


def drives(data: Path, folder: Path) -> Iterator[tuple[str, Drive]]:
    """Make the drives with their motion, and name them."""
    if (data / "kitti_raw_right").is_dir():
        recording = read_dataset("kitti-raw", Request(data / "kitti_raw_right", "2011_09_26", "image_03"))
        yield "KITTI raw, right camera", write_drive(recording, FrameChoice(), folder / "raw").drive
    if (data / "kitti360_street").is_dir():
        (real,) = READERS["kitti360_street"](data / "kitti360_street", folder)
        listed = json.loads((data / "kitti360_street/calib.json").read_text())["frames"]
        stamps = [PERIOD_S * (int(frame["name"]) - int(listed[0]["name"])) for frame in listed]
        poses = [np.array(frame["pose"]) for frame in listed]
        steps = [twist_from(*pair, 2.0 * PERIOD_S) for pair in pairwise(poses)]
        twists = np.mean([[steps[0], *steps], [*steps, steps[-1]]], axis=0)
        (folder / "poses.txt").write_text(tum_text(poses_along(stamps, list(twists))))
        drive = read_drive(real.path)
        frames = [
            frame.model_copy(update={"points_stamp": stamp, "image_stamp": stamp})
            for frame, stamp in zip(drive.frames, stamps, strict=True)
        ]
        motion = Motion(poses=str(folder / "poses.txt"))
        # The poses reach from the first sweep to the last, and cover half of each.
        update = {
            "frames": tuple(frames[1:-1]),
            "lidar": Lidar.model_validate({"spin": SPIN}),
            "motion": motion,
        }
        yield "KITTI-360, a street", drive.model_copy(update=update)


def run(name: str, images: str, drive: Drive, T_published: Pose, start: Pose, seed: int) -> Run:
    """Calibrate a drive from a start (4, 4)."""
    unknown = Run(name, images)
    try:
        found = calibrate(
            drive, CalibrationConfig(cues=("edges",), seed=seed), initial_pose=InitialPose(start, "")
        )
    except SemcalError:
        return unknown
    error = compare_poses(found.pose, T_published)
    ahead_cm, left_cm, _ = 100.0 * (camera_center(found.pose) - camera_center(T_published))
    return Run(
        name,
        images,
        error.rotation_deg,
        error.camera_center_cm,
        ahead_cm,
        left_cm,
        found.quality.mutual_information_nats,
        found.trusted,
    )


COLUMNS = (
    common("drive", "drive"),
    common("images", "sweeps, and images after the LiDAR faces forward"),
    NUMBER,
    Column("rotation, deg: median", {"deg": measure_of("rotation_deg", median)}, digits(3)),
    Column("camera centre, cm: median", {"cm": measure_of("camera_center_cm", median)}, digits(1)),
    Column("worst", {"worst_cm": measure_of("camera_center_cm", max)}, digits(1)),
    Column("ahead", {"ahead_cm": measure_of("ahead_cm", median)}, digits(1)),
    Column("to the left", {"left_cm": measure_of("left_cm", median)}, digits(1)),
    Column("information, nats", {"nats": measure_of("information_nats", median)}, digits(4)),
    count("trusted", lambda run: run.is_trusted),
)


def main(
    data: Path, *, starts: int = 3, only: str = "", from_deg: float = 2.0, from_m: float = 0.2
) -> Iterator[str]:
    """Print the table."""
    with TemporaryDirectory() as folder:
        yield from summary(_groups(data.resolve(), Path(folder), starts, only, (from_deg, from_m)), COLUMNS)


def _groups(
    data: Path, folder: Path, starts: int, only: str, off: tuple[float, float]
) -> Iterator[list[Run]]:
    for name, drive in drives(data, folder):
        T_published = np.array(drive.T_camera_lidar)
        unknown = drive.model_copy(update={"motion": None, "time_offset_s": MOMENT_S})
        told = f"deskewed by the speed that they show, {1e3 * MOMENT_S:.1f} ms"
        variants = {"as recorded": unknown.model_copy(update={"lidar": None}), told: unknown}
        for moment_ms in MOMENTS_MS:
            update = {"time_offset_s": 1e-3 * moment_ms}
            variants[f"deskewed, {moment_ms:.1f} ms"] = drive.model_copy(update=update)
        for images, variant in variants.items():
            if only not in f"{name}, {images}":
                continue
            seeds = range(FIRST_SEED, FIRST_SEED + starts)
            made = []
            for seed in seeds:
                start = displace(T_published, *off, np.random.default_rng(seed))
                made.append(run(name, images, variant, T_published, start, seed))
            yield made


if __name__ == "__main__":
    script(main)
