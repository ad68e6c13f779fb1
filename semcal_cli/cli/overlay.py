"""`semcal overlay`: points drawn on images."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.options import (
    KNOWN_TRANSFORMS,
    PATH,
    cue_option,
    max_points_option,
    number_option,
    quiet_option,
)
from semcal_cli.cli.rules import Options, refuse

if TYPE_CHECKING:
    from rich.console import Console

    from semcal_cli.config import CueName
    from semcal_cli.drive.document import Drive
    from semcal_cli.drive.observations import Observations
    from semcal_cli.report.overlay import Overlays
    from semcal_cli.report.palette import Coloring

COLORINGS = ("class", "depth", "agreement", "segment", "edge")
WITHOUT_LABELS = ("depth", "segment")


@click.command(
    help=f"Draw the points of DRIVE on its pictures, as CALIBRATION puts them: {KNOWN_TRANSFORMS}. Points that the "
    "camera cannot see are left out, or grey with --by agreement. Of a rig.yaml, CALIBRATION is the folder that semcal "
    "calibrate wrote, and each camera has a folder of pictures."
)
@click.argument("drive", type=PATH)
@click.argument("calibration", type=PATH)
@click.option(
    "-o",
    "--output",
    type=PATH,
    required=True,
    metavar="DIR",
    help="Folder of the pictures, 000000.png and so on.",
)
@click.option("--against", type=PATH, metavar="FILE", help="Transform to show beside it.")
@click.option(
    "--by",
    type=click.Choice(COLORINGS),
    help="Meaning of the colours: the class of the point; its distance from the camera; whether its class and the "
    "pixel's go together; the part of the sweep, by shape alone, that it belongs to: a cell of the ground, or an "
    "object; or how far range (orange) or intensity (blue) steps beside it, drawn on the edges of the picture. "
    "Distance, parts and edges need no labels.  [default: class; with --against, agreement; by the cue edges, edge]",
)
@cue_option
@number_option("--max-frames", default=20, help="Number of evenly spaced frames drawn of a longer drive.")
@max_points_option
@quiet_option
def overlay(
    drive: Path,
    calibration: Path,
    output: Path,
    against: Path | None,
    by: Coloring | None,
    cues: tuple[CueName, ...],
    max_frames: int,
    max_points: int,
    quiet: bool,
) -> None:
    """Draw points on pictures."""
    from semcal_cli.cli.terminal import make_console
    from semcal_cli.drive.document import read_drive
    from semcal_cli.files.writing import make_folder
    from semcal_cli.report.overlay import Overlays
    from semcal_cli.rig.document import find_rig
    from semcal_cli.rig.result import read_rig_files

    console = make_console(quiet)

    def write(overlays: Overlays, folder: Path) -> None:
        for path in overlays.write_all(folder):
            console.print(str(path), markup=False)

    if (rig := find_rig(drive)) is None:
        spec = read_drive(drive, max_points)
        write(_overlays(spec, calibration, against, by, cues, output, max_frames, console), output)
        return
    refuse(Options(click.get_current_context()), ["--against"], f"is of one camera, and {rig} is a rig")
    found, drives, read = read_rig_files(rig, calibration, max_points)
    drives = {name: _few(each, max_frames, output / name, read) for name, each in drives.items()}
    make_folder(output)
    for name, camera in found.cameras.items():
        chosen, observations = _observe(drives[name], by, cues, "class")
        write(Overlays(drives[name], observations, {name: camera.pose}, chosen), output / name)
    for name, reason in found.failures.items():
        console.print(f"{name}: has no transform to draw with: {reason}", markup=False)


def _overlays(
    drive: Drive,
    calibration: Path,
    against: Path | None,
    by: Coloring | None,
    cues: tuple[CueName, ...],
    folder: Path,
    max_frames: int,
    console: Console,
) -> Overlays:
    """Prepare the pictures of a drive at one transform or two, and tell where a camera or a clock is another one."""
    from semcal_cli.cli.tables import labelled
    from semcal_cli.drive.document import drive_file
    from semcal_cli.formats import read_extrinsic
    from semcal_cli.report.overlay import Overlays
    from semcal_cli.result.applied import apply_result, seen_as

    given = [path for path in (against, calibration) if path is not None]
    extrinsics = {str(path): read_extrinsic(path) for path in given}
    read = [drive.path, *map(drive.resolve, drive.files()), *map(drive_file, given)]
    frames = _few(drive, max_frames, folder, read).frames
    seen = {name: apply_result(found.record, drive, name) for name, found in extrinsics.items()}
    for each in seen.values():
        for change in each.changes:
            console.print(labelled(*change), markup=False)
    spec = seen.pop(str(calibration)).drive.model_copy(update={"frames": frames})
    by, observations = _observe(spec, by, cues, "class" if against is None else "agreement")
    others = {name: seen_as(observations, spec, each.drive) for name, each in seen.items()}
    poses = {name: found.T_camera_lidar for name, found in extrinsics.items()}
    return Overlays(spec, observations, poses, by, others)


def _few(drive: Drive, max_frames: int, folder: Path, read: list[Path]) -> Drive:
    """Take evenly spaced frames of a drive, and check that their pictures replace nothing that is read."""
    from semcal_cli.cli.outputs import check_image_folder
    from semcal_cli.drive.frame_selection import evenly_spaced

    frames = evenly_spaced(drive.frames, max_frames)
    check_image_folder(folder, len(frames), read)
    return drive.model_copy(update={"frames": tuple(frames)})


def _observe(
    drive: Drive, by: Coloring | None, cues: tuple[CueName, ...], of_classes: Coloring
) -> tuple[Coloring, Observations]:
    """Load what colours show of the frames of a drive.

    Args:
        drive: The drive.
        by: Meaning of the colours; None takes edges, if a pose is refined by them, or else `of_classes`.
        cues: Cues that classes are of, where colours show classes.
        of_classes: Meaning of the colours of points with classes.

    Raises:
        InputError: a file is missing or wrong, or the drive does not name one that is needed.
        CalibrationError: the points or the pixels carry no information.
    """
    from semcal_cli.config import AUTO, LABELS
    from semcal_cli.drive.cues.table import chosen, load_cues, maximised
    from semcal_cli.drive.reading import load_points
    from semcal_cli.files.point_clouds import Sweeps

    if by in WITHOUT_LABELS:
        return by, load_points(drive)
    if by == "edge":
        return by, load_cues(drive, ("edges",))
    sweeps = Sweeps()
    # Who asks for classes means labels: without any, the error says what is missing.
    cues = LABELS if by == "class" and cues == AUTO else chosen(cues, drive, sweeps)
    # Pixels of one cue share no information with points of another: the first one is shown.
    shown = maximised(cues)[:1]
    by = by or ("edge" if shown == ("edges",) else of_classes)
    return by, load_cues(drive, shown, sweeps, is_raw=True)
