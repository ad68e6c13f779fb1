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

if TYPE_CHECKING:
    from semcal_cli.config import Cue
    from semcal_cli.drive.document import Drive
    from semcal_cli.drive.observations import Observations
    from semcal_cli.report.overlay import Coloring

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
    cues: tuple[Cue, ...],
    max_frames: int,
    max_points: int,
    quiet: bool,
) -> None:
    """Draw points on pictures."""
    from semcal_cli.cli.outputs import check_image_folder
    from semcal_cli.cli.tables import labelled
    from semcal_cli.cli.terminal import make_console
    from semcal_cli.drive.document import drive_file, read_drive
    from semcal_cli.drive.frame_selection import evenly_spaced
    from semcal_cli.formats import read_extrinsic
    from semcal_cli.report.overlay import Overlays
    from semcal_cli.result.applied import apply_result, seen_as
    from semcal_cli.rig.document import find_rig

    if (rig := find_rig(drive)) is not None:
        from semcal_cli.cli.rig_pages import overlay_rig

        overlay_rig(rig, calibration, output, against, by, cues, max_frames, max_points, quiet)
        return
    given = [path for path in (against, calibration) if path is not None]
    extrinsics = {str(path): read_extrinsic(path) for path in given}
    poses = {name: found.T_camera_lidar for name, found in extrinsics.items()}
    paths = map(drive_file, given)
    spec = read_drive(drive, max_points)
    frames = evenly_spaced(spec.frames, max_frames)
    check_image_folder(output, len(frames), [spec.path, *map(spec.resolve, spec.files()), *paths])
    seen = {name: apply_result(found.record, spec, name) for name, found in extrinsics.items()}
    console = make_console(quiet)
    for each in seen.values():
        for change in each.changes:
            console.print(labelled(*change), markup=False)
    spec = seen.pop(str(calibration)).drive.model_copy(update={"frames": tuple(frames)})
    by, observations = observe(spec, by, cues, "class" if against is None else "agreement")
    others = {name: seen_as(observations, spec, each.drive) for name, each in seen.items()}
    for path in Overlays(spec, observations, poses, by, others).write_all(output):
        console.print(str(path), markup=False)


def observe(
    drive: Drive, by: Coloring | None, cues: tuple[Cue, ...], of_classes: Coloring
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
    from semcal_cli.drive.cues import chosen, load_cues, maximised
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
