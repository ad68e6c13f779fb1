"""`semcal calibrate`: the whole pipeline, on a drive, a recording, a data set, or the drives of a rig."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.calibrate_options import CalibrateSettings
from semcal_cli.cli.image_networks import label_on_the_way
from semcal_cli.cli.settings_command import command
from semcal_cli.errors import NoStartError, shell

if TYPE_CHECKING:
    from semcal_cli.drive.document import Drive


@command(CalibrateSettings)
def calibrate(settings: CalibrateSettings) -> None:
    """Calibrate the camera and the LiDAR of a drive, a recording or a data set.

    A drive is a folder with a drive.yaml. A recording (.mcap, .bag, .db3, or a folder of them) or a data set becomes
    one beside the output, with a report and overlays. A rig.yaml stands for several cameras; -o is then a folder.

    Without --init, labels in the drive find the mounting, or else the start is the transform that the recording or
    drive states, labels by --image-model, or the turns of the motion. Exit code 3 means that a result was written but
    is not trusted.
    """
    from semcal_cli.cli.given_source import typed_for, with_drive
    from semcal_cli.cli.start import advised, choose_start
    from semcal_cli.cli.tables import labelled
    from semcal_cli.many.rig.rig_document import find_rig

    settings.check_estimator()
    settings.check()
    given, terminal = _without_unasked_file(settings), settings.terminal()
    settings = with_drive(given, terminal)
    if (rig := find_rig(settings.drive)) is not None:
        from semcal_cli.cli.rig import calibrate_rig

        sys.exit(calibrate_rig(rig, settings if _has_output() else replace(settings, output=None)))
    drive, is_imported = settings.read_drive(), settings.drive != given.drive
    try:
        settings, sentence = choose_start(settings, drive)
        settings.outputs.check(drive, settings.initial_pose)
        terminal.print(labelled("start", sentence))
        if is_imported:
            terminal.print(labelled("same as", typed_for(settings.drive)))
        if settings.image_model:
            with terminal:
                labelled_drive = label_on_the_way(drive, settings, settings.max_frames, terminal)
            if is_imported:
                names = [word for name in settings.image_model for word in ("--image-model", name)]
                output = drive.argument.with_name(f"{drive.argument.name}_labelled")
                terminal.print(labelled("same as", shell("label", drive.argument, *names, "-o", output)))
            settings = replace(settings, drive=labelled_drive, frames=None, exclude=())
        sys.exit(
            _calibrate_drive(settings, None if settings.image_model else drive, names_commands=is_imported)
        )
    except NoStartError as error:
        raise advised(error, drive) from None


def _has_output() -> bool:
    """Whether -o is given."""
    source = click.get_current_context().get_parameter_source("output")
    return source is not click.core.ParameterSource.DEFAULT


def _without_unasked_file(settings: CalibrateSettings) -> CalibrateSettings:
    """Leave out the default output if the result is printed."""
    is_printed = settings.as_json or settings.to is not None
    return replace(settings, output=None) if is_printed and not _has_output() else settings


def _calibrate_drive(settings: CalibrateSettings, drive: Drive | None, *, names_commands: bool) -> int:
    """Calibrate one camera, write the result, and return the exit code; a drive is given if it is read and checked."""
    from semcal_cli.cli.outputs import loaded_drive

    outputs, initial_pose = replace(settings.outputs, names_commands=names_commands), settings.initial_pose
    run = settings.calibration()
    with loaded_drive(settings, settings.config, outputs, initial_pose, drive=drive) as (data, terminal):
        calibration = run(data, on_event=terminal.on_event)
        calibration = outputs.with_provenance(calibration, data, initial_pose)
    return outputs.write(calibration, terminal, settings.threads, data.drive)
