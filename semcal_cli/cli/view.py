"""`semcal view`: a drive that is moved by hand."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.options import (
    KNOWN_TRANSFORMS,
    OUTPUT_FILE,
    PATH,
    cue_option,
    drive_argument,
    max_frames_option,
    max_points_option,
    number_option,
    quiet_option,
    seed_option,
    threads_option,
)
from semcal_cli.cli.rules import CheckedCommand, Options, none_of
from semcal_cli.config import CalibrationConfig

if TYPE_CHECKING:
    from rich.console import Console

    from semcal_cli.config import CueName
    from semcal_cli.drive.document import Drive
    from semcal_cli.files.point_clouds import Sweeps
    from semcal_cli.geometry.poses import Pose
    from semcal_cli.report.view.session import Session

MAX_PORT = 65_535


@click.command(
    cls=CheckedCommand,
    rules=[none_of("--cue features", because="vectors have no classes to show")],
    help=f"""Move the points of DRIVE on its pictures by hand, as a page in a browser shows them.

    CALIBRATION is where it begins: {KNOWN_TRANSFORMS}. Without one, the page offers mountings to begin with.
    Sliders and the mouse move the camera, the page tells how well labels agree, refines from the pose, and saves it
    for `semcal calibrate DRIVE --init FILE`. The page is served to this machine alone, at an address that holds
    a random word. It ends with Ctrl-C (exit code 130) or, with -o, with its button "Save and end" (0).
    """,
)
@drive_argument
@click.argument("calibration", type=PATH, required=False)
@click.option(
    "-o",
    "--output",
    type=OUTPUT_FILE,
    metavar="FILE",
    help="File that the page saves the transform to: .yaml, .yml or .json. The browser saves it if not given.",
)
@number_option("--port", default=0, least=0, most=MAX_PORT, help="Port of the page; 0 takes a free one.")
@click.option("--open", "is_opened", is_flag=True, help="Also open the page in the browser.")
@seed_option
@threads_option
@max_frames_option
@max_points_option
@cue_option
@quiet_option
def view(
    drive: Path,
    calibration: Path | None,
    output: Path | None,
    port: int,
    is_opened: bool,
    seed: int,
    threads: int | None,
    max_frames: int,
    max_points: int,
    cues: tuple[CueName, ...],
    quiet: bool,
) -> None:
    """Show a drive on a page where it is moved by hand."""
    from semcal_cli.cli.search import read_initial_pose
    from semcal_cli.cli.tables import labelled
    from semcal_cli.cli.terminal import make_console, progress_line
    from semcal_cli.drive.document import read_drive
    from semcal_cli.report.view.server import ViewServer
    from semcal_cli.result.applied import apply_result
    from semcal_cli.threads import set_num_threads

    start = None if calibration is None else read_initial_pose(calibration)
    applied = apply_result(
        None if start is None else start.record, read_drive(drive, max_points), str(calibration)
    )
    spec = applied.drive
    if output is not None:
        _check_output(output, spec, calibration)
    set_num_threads(threads)
    console = make_console(quiet)
    for change in applied.changes:
        console.print(labelled(*change), markup=False)
    with progress_line(console) as progress:
        progress("reading frames")
        config = CalibrationConfig(seed, cues, max_frames)
        T_start = None if start is None else start.T_camera_lidar
        session = _session(spec, config, T_start, output, console)
    server = ViewServer(session, port)
    console.print("open this address in a browser of this machine; Ctrl-C ends it", markup=False)
    # The address is the result of the command, and the only way to the page.
    click.echo(server.address)
    if is_opened:
        click.launch(server.address)
    server.answer_until_ended()
    if output is not None and session.has_saved:
        console.print(labelled("written to", str(output)), markup=False)


def _check_output(output: Path, drive: Drive, calibration: Path | None) -> None:
    """Check that the page can save the transform, and that this replaces nothing that is read.

    Raises:
        click.UsageError: it would go to a stream.
        InputError: it cannot be written to its path.
    """
    from semcal_cli.cli.outputs import check_outputs
    from semcal_cli.drive.document import drive_file
    from semcal_cli.files.documents import output_format
    from semcal_cli.files.writing import descriptor

    if descriptor(output) is not None:
        raise click.UsageError("-o: the page saves to a file, and its address goes to standard output")
    output_format(output)
    given = [] if calibration is None else [drive_file(calibration)]
    check_outputs([drive.path, *map(drive.resolve, drive.files()), *given], [output])


def _session(
    spec: Drive,
    config: CalibrationConfig,
    start: Pose | None,
    output: Path | None,
    console: Console,
) -> Session:
    """Load the drive; one whose files allow no cue is shown without classes, unless one was asked for."""
    from semcal_cli.drive.frame_selection import evenly_spaced
    from semcal_cli.drive.loading import LoadedDrive, load
    from semcal_cli.drive.reading import load_points, read_clouds
    from semcal_cli.errors import InputError
    from semcal_cli.files.point_clouds import Sweeps
    from semcal_cli.report.overlay import picture_of
    from semcal_cli.report.view.session import Session

    sweeps, unlabelled = Sweeps(), ""
    few = spec.model_copy(update={"frames": tuple(evenly_spaced(spec.frames, config.max_frames))})
    try:
        data = load(spec, config, sweeps=sweeps)
    except InputError:
        is_given = Options(click.get_current_context()).holds("--cue")
        unlabelled = "" if is_given else _missing_labels(few, sweeps)
        if not unlabelled:
            raise
        data = LoadedDrive(few, load_points(few))
    session = Session(data, read_clouds(data.drive, sweeps), config, start, output, unlabelled)
    for frame in range(len(data.drive.frames)):
        picture_of(data.drive, session.observations, frame)  # a missing one is told before the page is
    if unlabelled:
        console.print(f"note: nothing tells how well points fit: {unlabelled}", markup=False)
    return session


def _missing_labels(drive: Drive, sweeps: Sweeps) -> str:
    """Say which labels a drive lacks; empty if it has all.

    Raises:
        InputError: a sweep or its labels are damaged.
    """
    from semcal_cli.drive.reading import check_labelled, read_clouds
    from semcal_cli.errors import InputError

    clouds = read_clouds(drive, sweeps)
    try:
        check_labelled(drive, clouds)
    except InputError as error:
        return str(error)
    return ""
