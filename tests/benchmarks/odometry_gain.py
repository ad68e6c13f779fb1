"""Prints Markdown tables: what calibrations gain by the motion that sweeps tell.

    python tests/benchmarks/odometry_gain.py [--seeds 3] [--only gain] [--only clock] [--change 0.5]

A rig drives three seconds along a synthetic street, at 30 twisted sweeps. Drives are calibrated from nothing with the
true motion, with that of the sweeps by KISS-ICP, and without any: median errors of the rotation and of the camera
centre, with a global shutter and with one that rolls within 30 ms. Then images are 30 ms late, and `--estimate-delay`
finds the offset on drives whose speed changes by this share. Needs the extra `odometry`.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from benchmark import script, table
from moving_street import MovingStreet

from semcal_cli.config import AdjustmentConfig, CalibrationConfig, RefinementConfig
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.stated_motion import Motion, MotionSigma
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.importing.drive_odometry import drive_motion
from semcal_cli.importing.stamps import tum_text
from semcal_cli.importing.sweep_odometry import SIGMA
from semcal_cli.observations.loading import load
from semcal_cli.pipeline import calibrate
from semcal_cli.result.calibration_document import CalibrationDocument

STREETS = {
    "5 m/s": (5.0, 0.3, 0.0, 0.0),
    "10 m/s": (10.0, -0.2, 0.0, 0.0),
    "15 m/s": (15.0, 0.15, 0.0, 0.0),
    "7 to 13 m/s, 30 ms": (10.0, 0.2, 0.3, 0.03),
}
"""Speed, turn, the share by which both rise and fall, and the readout in seconds."""
CHANGING = 10.0, 0.2
"""Mean speed and turn of the drives whose clock is late. With a change of 0.5 they brake by up to 10 m/s^2."""
LATE_S = 0.03
TRUE = Motion(poses="true.txt")
ESTIMATED = Motion(poses="estimated.txt", sigma=MotionSigma(**SIGMA))
JOINTLY = CalibrationConfig(refinement=RefinementConfig(jointly=AdjustmentConfig(with_delay=True)))


def drive_of(street: MovingStreet, folder: Path, late_s: float = 0.0) -> Drive:
    """Write a drive, with a file of the true poses and one of those that its sweeps tell."""
    drive = read_drive(street.write(folder / "drive", late_s=late_s))
    drive.resolve("estimated.txt").write_text(tum_text(drive_motion(drive).poses))
    return drive


def calibrated(drive: Drive, motion: Motion | None, config: CalibrationConfig) -> CalibrationDocument:
    return calibrate(load(drive.model_copy(update={"motion": motion}), config), config)


def row(name: str, seeds: range, points: int, width: int) -> tuple[str, ...]:
    errors = []
    speed_m_s, turn_rad_s, change, readout_s = STREETS[name]
    for seed in seeds:
        street = MovingStreet(speed_m_s, turn_rad_s, seed, points, width, change=change, readout_s=readout_s)
        with tempfile.TemporaryDirectory() as folder:
            drive = drive_of(street, Path(folder))
            ends = [calibrated(drive, motion, CalibrationConfig()) for motion in (TRUE, ESTIMATED, None)]
        found = [compare_poses(end.pose, street.T_camera_lidar) for end in ends]
        errors.append([(each.rotation_deg, each.camera_center_cm) for each in found])
    return name, *(f"{deg:.3f}, {cm:.3f}" for deg, cm in np.median(errors, axis=0))


def clock_row(seed: int, change: float, points: int, width: int) -> tuple[str, ...]:
    street, cells = MovingStreet(*CHANGING, seed, points, width, change=change), []
    with tempfile.TemporaryDirectory() as folder:
        drive = drive_of(street, Path(folder), LATE_S)
        for motion in (TRUE, ESTIMATED):
            clock = calibrated(drive, motion, JOINTLY).clock
            assert clock is not None
            told = "not determined"
            if clock.half_width_95_s is not None:
                told = f"{1e3 * clock.time_offset_s:.1f} +- {1e3 * clock.half_width_95_s:.1f}"
            cells.append(told if clock.is_kept or not clock.is_determined else f"{told}, not kept")
    return str(seed), *cells


def main(
    *,
    seeds: int = 3,
    first_seed: int = 300,
    points: int = 40_000,
    width: int = 640,
    change: float = 0.5,
    only: tuple[str, ...] = ("gain", "clock"),
) -> Iterator[str]:
    """Print the tables, or one of them."""
    of_seeds = range(first_seed, first_seed + seeds)
    if "gain" in only:
        header = "speed, readout | true motion: deg, cm | motion of the sweeps | none"
        yield from table(header, (row(name, of_seeds, points, width) for name in STREETS))
        yield ""
    if "clock" in only:
        header = "images 30 ms late, seed | found with the true motion, ms | with that of the sweeps"
        yield from table(header, (clock_row(seed, change, points, width) for seed in of_seeds))


if __name__ == "__main__":
    script(main)
