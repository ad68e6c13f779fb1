"""`semcal odometry`: the motion of the LiDAR from the sweeps of a drive."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from semcal_cli.cli.options import DriveSettings
from semcal_cli.cli.settings import option
from semcal_cli.cli.settings_command import command
from semcal_cli.errors import check_installed, counted


@dataclass(frozen=True, kw_only=True)
class OdometrySettings(DriveSettings):
    """Settings of `odometry`."""

    output: Path = option("File for the poses, .txt.", "-o", "--output", required=True, metavar="FILE")


@command(OdometrySettings)
def odometry(settings: OdometrySettings) -> None:
    """Estimate the motion of the LiDAR in DRIVE with KISS-ICP. The sweeps of DRIVE must be consecutive.

    Poses are written in the TUM format, one per line: seconds x y z qx qy qz qw. Add the printed line to
    drive.yaml, which this command does not change. If DRIVE has poses, the two motions are compared.
    """
    from semcal_cli.cli.output_checks import check_outputs, files_read
    from semcal_cli.cli.tables import wrapped
    from semcal_cli.drive.document import read_drive

    check_installed("semcal odometry", "kiss_icp", "odometry")
    from semcal_cli.files.output_files import write_text
    from semcal_cli.importing.drive_odometry import drive_motion
    from semcal_cli.importing.motion_agreement import compare_with_drive
    from semcal_cli.importing.sweep_odometry import SIGMA

    drive = read_drive(settings.drive, settings.max_points)
    check_outputs(files_read(drive), settings.output)
    with settings.terminal() as terminal:
        motion = drive_motion(drive, terminal.on_event)
    compared = compare_with_drive(drive, motion.poses)
    write_text(motion.tum(), settings.output)
    terminal.print(f"wrote {settings.output}: {counted(len(motion.poses), 'pose')}")
    if motion.doubtful_ns:
        count, first_s = len(motion.doubtful_ns), 1e-9 * motion.doubtful_ns[0]
        terminal.print(
            f"note: the motion jumps {count:,} times, first at {first_s:.3f} s; no poses are written around jumps"
        )
    if motion.uncovered:
        count, first = len(motion.uncovered), motion.uncovered[0]
        terminal.print(
            f"note: {count:,} sweeps have no poses around them, first {first}: leave out their frames"
        )
    for sentence in motion.assumption:
        terminal.print(*wrapped("note:", sentence, indent=6))
    if compared is not None:
        terminal.print(f"note: {compared.describe('motion.poses of the drive')}")
    name = Path(os.path.relpath(settings.output, drive.root)).as_posix()
    sigma = ", ".join(f"{key}: {value:g}" for key, value in SIGMA.items())
    block = f"poses: {name}, point_times: {motion.point_times}, sigma: {{{sigma}}}"
    terminal.print(f"add to {drive.path}: motion: {{{block}}}")
