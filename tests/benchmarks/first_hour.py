"""Prints a Markdown table: one command from a recording to a transform, for ROS 1, ROS 2 and MCAP.

    python tests/benchmarks/first_hour.py DATA -o DIR [--only mcap] [--places 14]

Writes recordings of a rig that stands at the places of DATA/kitti_object, in two sweeps and images each, with 1 cm of
noise in the ranges and two grey values in the images. /tf_static is 2 degrees and 0.2 m from the transform that KITTI
publishes. `semcal calibrate` runs on each in a process of its own, without a network and with nothing else in its
folder. Needs the extras `bag` and `odometry`, and `mcap`.
"""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from bags import NS, START_NS, BagWriter, write_pair
from benchmark import SEMCAL, script, table

from semcal_cli.drive.document import read_drive
from semcal_cli.files.image_files import read_image
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.importing import read_dataset
from semcal_cli.importing.choice import FrameChoice
from semcal_cli.importing.drive_folder import write_drive
from semcal_cli.importing.recording import Request
from semcal_cli.observations.reading import read_clouds
from semcal_cli.result.calibration_document import read_calibration

KINDS = {"mcap": "mcap library", "ros1": "ros1", "sqlite3": "sqlite3"}
START_DEG, START_M = 2.0, 0.2
SWEEPS_PER_PLACE, PERIOD_NS, STOP_NS = 2, NS // 10, 10 * NS
RANGE_NOISE, GREY_NOISE = 0.01, 2.0
"""Standard deviations: of a range in metres, and of a pixel."""


def write(folder: Path, kind: str, drive: Path, T_camera_lidar: Pose) -> Path:
    """Record a rig that stands at the place of each frame."""
    spec, rng = read_drive(drive), np.random.default_rng(1)
    with BagWriter(folder, kind) as bag:
        bag.write("/tf_static", bag.transforms({("optical", "lidar"): T_camera_lidar}), START_NS)
        for place, (frame, cloud) in enumerate(zip(spec.frames, read_clouds(spec), strict=True)):
            pixels = read_image(spec.resolve(frame.image or ""))
            for sweep in range(SWEEPS_PER_PLACE):
                ranges = np.linalg.norm(cloud.points, axis=1, keepdims=True)
                points = cloud.points * (1.0 + rng.normal(0.0, RANGE_NOISE, ranges.shape) / ranges)
                grey = np.clip(pixels + rng.normal(0.0, GREY_NOISE, pixels.shape), 0, 255).astype(np.uint8)
                stamp_ns = START_NS + place * STOP_NS + sweep * PERIOD_NS
                write_pair(bag, spec.camera, points, cloud.intensity, grey, stamp_ns)
    return bag.path


def main(data: Path, *, output: Path, only: str = "", places: int = 14) -> Iterator[str]:
    """Write the recordings, calibrate each, and print the table."""
    recording = read_dataset("kitti-object", Request(data.resolve() / "kitti_object"))
    drive = write_drive(recording, FrameChoice(max_frames=places), output / "kitti", force=True).path
    T_true = read_transform(drive)
    T_start = displace(T_true, START_DEG, START_M, np.random.default_rng(1))

    def rows() -> Iterator[list[object]]:
        for name, kind in KINDS.items():
            if only not in name:
                continue
            folder = output / name
            folder.mkdir(parents=True)
            path = write(folder, kind, drive, T_start)
            command = ["calibrate", path.name]
            with (folder / "log.txt").open("w") as log:
                done = subprocess.run([*SEMCAL, *command], cwd=folder, stderr=log, check=False)
            result = read_calibration(folder / "calibration.yaml")
            error = compare_poses(result.pose, T_true)
            yield [
                name,
                f"`{shlex.join(['semcal', *command])}`",
                f"{result.status}, {done.returncode}",
                f"{error.rotation_deg:.3f}",
                f"{error.camera_center_cm:.1f}",
            ]

    yield from table("recording | command | status, exit code | rotation, deg | camera centre, cm", rows())


if __name__ == "__main__":
    script(main)
