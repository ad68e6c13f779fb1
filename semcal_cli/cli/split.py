"""`semcal calibrate --split`: a drive in whose middle the camera was moved, and each of its parts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from semcal_cli.assessment.disagreement import MAX_PARTS
from semcal_cli.cli.drive import loaded_drive
from semcal_cli.cli.tables import labelled
from semcal_cli.cli.terminal import Terminal
from semcal_cli.errors import CalibrationError, SemcalError
from semcal_cli.pipeline.parts import split

if TYPE_CHECKING:
    from pathlib import Path

    from semcal_cli.cli.options import ResultOptions
    from semcal_cli.cli.outputs import Outputs
    from semcal_cli.config import CalibrationConfig
    from semcal_cli.drive.loading import LoadedDrive
    from semcal_cli.initialization.initial_pose import InitialPose
    from semcal_cli.result.calibration import Calibration


def calibrate_parts(
    drive: Path,
    calibrate: Callable[..., Calibration],
    outputs: Outputs,
    options: ResultOptions,
    config: CalibrationConfig,
    initial_pose: InitialPose | None,
) -> int:
    """Calibrate a drive, and each of its parts if the camera was moved, and write the results.

    Args:
        drive: Folder of the drive, or its drive.yaml.
        calibrate: Function that calibrates a drive: `pipeline.calibrate` with its settings.
        outputs: Output files of the whole drive, after which those of the parts are named.
        options: Options of every command that computes a calibration.
        config: All settings of a calibration.
        initial_pose: Pose to start at.

    Returns:
        The exit code: the worst of the parts, or that of the whole drive if it has none.

    Raises:
        InputError: the drive, one of its files or an output is wrong.
        CalibrationError: the drive or a part has no answer; the results of the others are written.
    """
    of_parts = [outputs.of_part(number) for number in range(1, MAX_PARTS + 1)]
    run = partial(calibrate, relative_to=outputs.folder, hashes={})
    with loaded_drive(drive, config, outputs, options, initial_pose, of_parts) as (data, terminal):
        whole = run(data, on_event=terminal.on_event)
    code = outputs.write(whole, terminal, options.threads, data.drive)
    parts = split(data, whole)
    for earlier in of_parts[len(parts) :]:
        if earlier.output is not None and earlier.output.exists():
            terminal.print(labelled("of another run", str(earlier.output)))
    if not parts:
        terminal.print(labelled("parts", "none: no movement of the camera was found"))
        return code
    return _calibrate_each(parts, run, of_parts[: len(parts)], options)


def _calibrate_each(
    parts: Sequence[LoadedDrive],
    run: Callable[..., Calibration],
    of_parts: Sequence[Outputs],
    options: ResultOptions,
) -> int:
    """Calibrate and write the parts one after another, and return the worst exit code."""
    code, failures = 0, list[str]()
    for number, (part, outputs) in enumerate(zip(parts, of_parts, strict=True), start=1):
        terminal = Terminal(quiet=options.quiet, verbose=options.verbose)
        first, last = part.drive.frames[0].points, part.drive.frames[-1].points
        terminal.print(f"[part {number}: {len(part.drive.frames)} frames, {first} to {last}]")
        try:
            with terminal:
                found = run(part, on_event=terminal.on_event)
            code = max(code, outputs.write(found, terminal, options.threads))
        except SemcalError as error:
            failures.append(f"part {number}: {error}")
            terminal.print(labelled("failed", str(error)))
    if failures:
        raise CalibrationError(f"{len(failures)} of {len(parts)} parts failed; {failures[0]}")
    return code
