"""The drive that a command works on: read once its outputs are checked, while the terminal shows the progress."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from semcal_cli.cli.outputs import Outputs
from semcal_cli.cli.tables import labelled
from semcal_cli.cli.terminal import Terminal
from semcal_cli.drive.document import read_drive
from semcal_cli.drive.loading import LoadedDrive, load
from semcal_cli.result.applied import apply_result
from semcal_cli.threads import set_num_threads

if TYPE_CHECKING:
    from semcal_cli.cli.options import RunOptions
    from semcal_cli.config import CalibrationConfig
    from semcal_cli.initialization.initial_pose import InitialPose


@contextmanager
def loaded_drive(
    drive: Path,
    config: CalibrationConfig,
    outputs: Outputs,
    asked: RunOptions,
    initial_pose: InitialPose | None = None,
    parts: Sequence[Outputs] = (),
    *,
    as_result_sees: bool = False,
) -> Iterator[tuple[LoadedDrive, Terminal]]:
    """Load a drive, and show the progress of all that is done with it.

    Args:
        drive: Folder of the drive, or its drive.yaml.
        config: Settings, which say what is read.
        outputs: Output files, which are checked before anything long begins.
        asked: How the drive is read, and what is shown.
        initial_pose: Pose to start at, whose file no output may replace.
        parts: Output files of the parts of the drive, which are checked with the others.
        as_result_sees: Whether the drive gets the camera and the clock that were estimated together with the initial
            pose.

    Raises:
        InputError: the drive, one of its files or an output is wrong.
        CalibrationError: one side's labels carry no information.
    """
    spec = read_drive(drive, asked.max_points)
    outputs.check(spec, initial_pose, parts)
    set_num_threads(asked.threads)
    with Terminal(quiet=asked.quiet, verbose=asked.verbose) as terminal:
        if as_result_sees and initial_pose is not None:
            applied = apply_result(initial_pose.record, spec, initial_pose.name)
            terminal.print(*(labelled(*change) for change in applied.changes))
            spec = applied.drive
        data = load(spec, config, terminal.on_event)
        outputs.check_pictures(data.drive)
        yield data, terminal
