"""Prints a Markdown table: what deskewing does for `--refine-intrinsics`, on drives whose sweeps a speed skews.

    python tests/benchmarks/skewed_intrinsics.py DATA [--starts 2] [--only NAME] [--errors NAME]

KITTI's sets are calibrated by edges from 2 degrees and 0.2 m off, with fx, fy, cx and cy estimated: as their sweeps
were recorded, and with the spin stated, so that they are deskewed if they show a speed. K is right, or cx or both focal
lengths are wrong. Errors are those of the pose and the camera of the result, from the published ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from benchmark import script, summary
from real_data import RealDrive, real_drives
from real_drives import RIGHT

from semcal_cli.config import AdjustmentConfig, CalibrationConfig, RefinementConfig
from semcal_cli.drive.camera import K_ENTRIES, Camera, intrinsic_value, with_intrinsics
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.errors import SemcalError
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.experiments.summary import NUMBER, Column, cell, common, count, digits, measure_of, median
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.skew import Skew
from semcal_cli.pipeline import calibrate

START_DEG, START_M = 2.0, 0.2
FIRST_SEED = 90
ERRORS = {"right": (0.0, 1.0), "cx +8 px": (8.0, 1.0), "fx, fy +1 %": (0.0, 1.01)}
"""What is added to cx, pixels, and by what the focal lengths are multiplied."""
SWEEPS = ("as recorded", "spin stated")


class JointRun(NamedTuple):
    """What one calibration says."""

    drive: str
    K: str
    sweeps: str
    speed_m_s: float = np.nan
    sigma_m_s: float = np.nan
    rotation_deg: float = np.inf
    camera_center_cm: float = np.inf
    cx_px: float = np.nan
    """Error of the cx that the pose belongs to."""
    fx_px: float = np.nan
    fy_px: float = np.nan
    is_kept: bool = False
    is_trusted: bool = False

    @property
    def is_right(self) -> bool:
        """Whether both errors of the pose are small."""
        return self.rotation_deg <= RIGHT[0] and self.camera_center_cm <= RIGHT[1]


def run(name: str, K: str, sweeps: str, drive: Drive, T_published: Pose, seed: int) -> JointRun:
    """Calibrate a drive with an error of its K, from near its published pose (4, 4)."""
    right, (cx_px, scale) = drive.camera, ERRORS[K]
    wrong = {name: scale * intrinsic_value(right, name) for name in ("fx", "fy")}
    camera = with_intrinsics(right, wrong | {"cx": intrinsic_value(right, "cx") + cx_px})
    update: dict[str, object] = {"camera": camera} | ({"lidar": None} if sweeps == SWEEPS[0] else {})
    jointly = AdjustmentConfig(intrinsics=tuple(K_ENTRIES))
    config = CalibrationConfig(cues=("edges",), seed=seed, refinement=RefinementConfig(jointly=jointly))
    start = displace(T_published, START_DEG, START_M, np.random.default_rng(seed))
    unknown = JointRun(name, K, sweeps)
    try:
        found = calibrate(drive.model_copy(update=update), config, initial_pose=InitialPose(start, "start"))
    except SemcalError:
        return unknown
    error, refined = compare_poses(found.pose, T_published), found.camera
    is_kept = refined is not None and refined.is_kept
    used: Camera = refined.found if refined is not None and is_kept else camera
    off = {entry: intrinsic_value(used, entry) - intrinsic_value(right, entry) for entry in K_ENTRIES}
    return unknown._replace(
        speed_m_s=np.nan if found.speed is None else found.speed.along_view_m_s,
        sigma_m_s=np.nan if found.speed is None else found.speed.sigma_m_s,
        rotation_deg=error.rotation_deg,
        camera_center_cm=error.camera_center_cm,
        cx_px=off["cx"],
        fx_px=off["fx"],
        fy_px=off["fy"],
        is_kept=is_kept,
        is_trusted=found.status == "trusted",
    )


def _speed(runs: Sequence[JointRun]) -> str:
    speeds, sigmas = [run.speed_m_s for run in runs], [run.sigma_m_s for run in runs]
    return "-" if np.isnan(speeds).any() else f"{np.median(speeds):.1f} +- {np.median(sigmas):.1f}"


COLUMNS = (
    common("drive", "drive"),
    common("K", "K"),
    common("sweeps", "sweeps"),
    NUMBER,
    cell("speed, m/s", _speed),
    Column("rotation, deg: median", {"deg": measure_of("rotation_deg", median)}, digits(2)),
    Column("camera centre, cm: median", {"cm": measure_of("camera_center_cm", median)}, digits(1)),
    Column("cx off, px: median", {"cx_px": measure_of("cx_px", median)}, digits(1)),
    Column("fx", {"fx_px": measure_of("fx_px", median)}, digits(1)),
    Column("fy", {"fy_px": measure_of("fy_px", median)}, digits(1)),
    count("K kept", lambda run: run.is_kept),
    count("within 0.2 deg, 5 cm", lambda run: run.is_right),
    count("trusted", lambda run: run.is_trusted),
    count("trusted, not within", lambda run: run.is_trusted and not run.is_right),
)


def main(data: Path, *, starts: int = 2, only: str = "KITTI ", errors: str = "") -> Iterator[str]:
    """Print the table."""
    with TemporaryDirectory() as folder:
        yield from summary(_groups(data.resolve(), Path(folder), starts, only, errors), COLUMNS)


def _groups(data: Path, folder: Path, starts: int, only: str, errors: str) -> Iterator[list[JointRun]]:
    drives: list[RealDrive] = [
        # Edges see no labels, so that one set with those of another network is the same.
        real
        for real in real_drives(data, folder)
        if only in real.name and "DiCENet" not in real.name
    ]
    for real in drives:
        drive, T_published = read_drive(real.path), read_transform(real.path)
        if Skew.of(drive, T_published) is None:
            continue
        for K in (name for name in ERRORS if errors in name):
            for sweeps in SWEEPS:
                seeds = range(FIRST_SEED, FIRST_SEED + starts)
                yield [run(real.name, K, sweeps, drive, T_published, seed) for seed in seeds]


if __name__ == "__main__":
    script(main)
