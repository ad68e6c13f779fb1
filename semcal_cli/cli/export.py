"""`semcal export`: drives and calibrations for other programs to look at."""

from __future__ import annotations

from pathlib import Path

import click

from semcal_cli.cli.options import KNOWN_TRANSFORMS, PATH, max_points_option, number_option, quiet_option
from semcal_cli.errors import check_installed


@click.group()
def export() -> None:
    """Write a drive for a viewer. See `semcal convert` for transforms in the formats of other tools."""


@export.command(
    help="Write DRIVE for the Rerun viewer: sweeps and pictures with their labels along time, and a camera at each "
    "pose of CALIBRATION: its hypotheses, its stages and its result, or the one pose of another file: "
    f"{KNOWN_TRANSFORMS}. Look at it by `rerun FILE.rrd`.",
    short_help="For the Rerun viewer, .rrd.",
)
@click.argument("drive", type=PATH)
@click.argument("calibration", type=PATH, required=False)
@click.option("-o", "--output", type=PATH, required=True, metavar="FILE", help="File to write, .rrd.")
@number_option("--max-frames", default=20, help="Number of evenly spaced frames written of a longer drive.")
@max_points_option
@quiet_option
def rerun(
    drive: Path, calibration: Path | None, output: Path, max_frames: int, max_points: int, quiet: bool
) -> None:
    """Write a recording of Rerun."""
    import numpy as np

    from semcal_cli.cli.outputs import check_outputs
    from semcal_cli.cli.tables import labelled
    from semcal_cli.cli.terminal import make_console, progress_line
    from semcal_cli.drive.document import drive_file, read_drive
    from semcal_cli.drive.frame_selection import evenly_spaced

    check_installed("semcal export rerun", "rerun", "view")
    from semcal_cli.formats import read_extrinsic
    from semcal_cli.report.rerun_file import begun_cameras, poses_of, write_rerun
    from semcal_cli.result.applied import apply_result

    whole = read_drive(drive, max_points)
    given = [] if calibration is None else [drive_file(calibration)]
    check_outputs([whole.path, *map(whole.resolve, whole.files()), *given], [output])
    poses = {} if whole.T_camera_lidar is None else {"reference": np.array(whole.T_camera_lidar)}
    cameras = dict.fromkeys(poses, whole.camera)
    console = make_console(quiet)
    if calibration is not None:
        extrinsic = read_extrinsic(calibration)
        poses |= poses_of(extrinsic)
        cameras |= begun_cameras(extrinsic, whole)
        applied = apply_result(extrinsic.record, whole, str(calibration))
        for change in applied.changes:
            console.print(labelled(*change), markup=False)
        whole = applied.drive
    spec = whole.model_copy(update={"frames": tuple(evenly_spaced(whole.frames, max_frames))})
    with progress_line(console) as progress:
        progress("reading frames")
        write_rerun(spec, poses, output, cameras)
    names = f", cameras {', '.join(poses)}" if poses else ""
    console.print(f"wrote {output}: {len(spec.frames)} frames{names}", markup=False)
