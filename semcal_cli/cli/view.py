"""`semcal view`: a transform that is adjusted by hand."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.options import EstimateSettings, reference_direction
from semcal_cli.cli.rules import none_of
from semcal_cli.cli.settings import argument, option, output_file
from semcal_cli.cli.settings_command import command
from semcal_cli.cli.stage_options import read_initial_pose
from semcal_cli.config import AUTO, CalibrationConfig
from semcal_cli.config.directions import Direction

if TYPE_CHECKING:
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.drive.document import Drive
    from semcal_cli.files.point_clouds import SweepCache
    from semcal_cli.geometry.arrays import Pose
    from semcal_cli.report.view.session import Session

MAX_PORT = 65_535


@dataclass(frozen=True, kw_only=True)
class ViewSettings(EstimateSettings):
    """Settings of `view`."""

    rules = [none_of("--cue features", because="feature vectors have no classes to show")]
    calibration: Path | None = argument()
    reference_direction: Direction | None = reference_direction()
    output: Path | None = output_file(
        "File to which the page saves the transform: .yaml, .yml or .json. If not given, the browser saves it.",
        "-o",
        "--output",
    )
    port: int = option("Port of the page; 0 picks a free one.", default=0, minimum=0, maximum=MAX_PORT)
    is_opened: bool = option("Also open the page in the browser.", "--open", default=False)


@command(ViewSettings)
def view(settings: ViewSettings) -> None:
    """Adjust a transform by hand, on a page in the browser that shows the points of DRIVE on its images.

    CALIBRATION is the start: {KNOWN_TRANSFORMS}. Without it, the page offers mountings to start from. Sliders and the
    mouse move the camera. The page shows how well the labels agree, can refine the pose, and saves it for
    `semcal calibrate DRIVE --init FILE`.

    The page is served only to this machine, at an address with a random word. The command ends with Ctrl-C (exit code
    130) or, with -o, with the button "Save and end" (0).
    """
    from semcal_cli.formats import REFERENCE_DIRECTION
    from semcal_cli.report.view.server import ViewServer
    from semcal_cli.result.applied import apply_result, cues_applied
    from semcal_cli.threads import set_num_threads

    calibration, output = settings.calibration, settings.output
    start = None
    if calibration is not None:
        direction, name = settings.reference_direction, REFERENCE_DIRECTION
        start = read_initial_pose(calibration, direction, direction_option=name, ignores_unasked=True)
    drive = settings.read_drive()
    applied = apply_result(None if start is None else start.record, drive, str(calibration))
    if output is not None:
        _check_output(output, applied.drive, calibration)
    set_num_threads(settings.threads)
    terminal = settings.terminal()
    terminal.print_changes(applied.changes)
    with terminal:
        terminal.show("reading frames")
        cues = cues_applied(None if start is None else start.record, settings.cues, applied.drive)
        config = CalibrationConfig(settings.seed, cues, settings.max_frames)
        T_start = None if start is None else start.T_camera_lidar
        session = _session(applied.drive, config, T_start, output, terminal)
    server = ViewServer(session, settings.port)
    terminal.print("open this address in a browser on this machine; press Ctrl-C to stop")
    # The address is the result of the command, and the only way to the page.
    click.echo(server.address)
    if settings.is_opened:
        click.launch(server.address)
    server.answer_until_ended()
    if output is not None and session.has_saved:
        terminal.print_path("written to", output)


def _check_output(output: Path, drive: Drive, calibration: Path | None) -> None:
    """Check that the page can save the transform, and that this replaces no input."""
    from semcal_cli.cli.output_checks import check_outputs, files_read
    from semcal_cli.files.documents import output_format
    from semcal_cli.files.output_files import descriptor

    if descriptor(output) is not None:
        raise click.UsageError("-o: the page saves to a file, and its address goes to standard output")
    output_format(output)
    check_outputs(files_read(drive, calibration), output)


def _session(
    spec: Drive,
    config: CalibrationConfig,
    start: Pose | None,
    output: Path | None,
    terminal: Terminal,
) -> Session:
    """Load the drive. If its files allow no cue and none was requested, it is shown without classes."""
    from semcal_cli.errors import InputError
    from semcal_cli.files.point_clouds import SweepCache
    from semcal_cli.observations.frame_selection import with_few_frames
    from semcal_cli.observations.loading import LoadedDrive, load
    from semcal_cli.observations.reading import load_points, read_clouds
    from semcal_cli.report.view.session import Session

    sweeps, unlabelled = SweepCache(), ""
    few = with_few_frames(spec, config.max_frames)
    try:
        data = load(spec, config, sweeps=sweeps)
    except InputError:
        unlabelled = _missing_labels(few, sweeps) if config.cues == AUTO else ""
        if not unlabelled:
            raise
        data = LoadedDrive(few, load_points(few))
    session = Session(data, read_clouds(data.drive, sweeps), config, start, output, unlabelled)
    session.check_images()  # a missing one is reported before the page opens
    if unlabelled:
        terminal.print(f"note: the page cannot show how well the points fit: {unlabelled}")
    return session


def _missing_labels(drive: Drive, sweeps: SweepCache) -> str:
    """Describe which labels a drive lacks; empty if it has all."""
    from semcal_cli.errors import InputError
    from semcal_cli.observations.reading import check_labelled, read_clouds

    clouds = read_clouds(drive, sweeps)
    try:
        check_labelled(drive, clouds)
    except InputError as error:
        return str(error)
    return ""
