"""`semcal calibrate`: the whole pipeline, on a drive or on the drives of a rig."""

from __future__ import annotations

import sys
from dataclasses import replace

import click

from semcal_cli.cli.calibrate_options import CalibrateSettings
from semcal_cli.cli.label import label_on_the_way
from semcal_cli.cli.settings import command


@command(CalibrateSettings)
def calibrate(settings: CalibrateSettings) -> None:
    """Calibrate the camera and the LiDAR of DRIVE, a folder with a drive.yaml or the file itself.

    No initial guess is needed: all mounting directions are searched, then the best pose is refined. Exit code 3 means
    that a result was written but is not trusted.

    DRIVE may be a rig.yaml, which lists the drives of several cameras with one LiDAR. All of them are calibrated. -o is
    then a folder, for the result of each camera and for rig_calibration.yaml, which relates the cameras to each other.
    """
    from semcal_cli.many.rig.rig_document import find_rig

    settings.check_estimator()
    settings.check()
    if (rig := find_rig(settings.drive)) is not None:
        from semcal_cli.cli.rig import calibrate_rig

        if settings.has_chosen_frames:
            raise click.UsageError("--frames, --exclude: found a rig, needed the drive of one camera.")
        sys.exit(calibrate_rig(rig, settings))
    if settings.image_model:
        with settings.terminal() as terminal:
            drive = label_on_the_way(settings.read_drive(), settings, settings.max_frames, terminal)
        settings = replace(settings, drive=drive, frames=None, exclude=())
    sys.exit(_calibrate_drive(settings))


def _calibrate_drive(settings: CalibrateSettings) -> int:
    """Calibrate one camera, write the result, and return the exit code."""
    from semcal_cli.cli.outputs import loaded_drive

    outputs, initial_pose = settings.outputs, settings.initial_pose
    run = settings.calibration()
    with loaded_drive(settings, settings.config, outputs, initial_pose) as (data, terminal):
        calibration = run(data, on_event=terminal.on_event)
        calibration = outputs.with_provenance(calibration, data, initial_pose)
    return outputs.write(calibration, terminal, settings.threads, data.drive)
