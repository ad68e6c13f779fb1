"""`semcal verify`: the check whether a transform still holds."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.ci import EXIT_CODES, Case, annotate, check_line, junit_xml, of_verdict
from semcal_cli.cli.options import (
    KNOWN_TRANSFORMS,
    PATH,
    cue_option,
    drive_argument,
    limit_options,
    max_frames_option,
    max_points_option,
    quiet_option,
    seed_option,
    threads_option,
)
from semcal_cli.cli.search import read_initial_pose
from semcal_cli.config import CalibrationConfig, Cue, Limits

if TYPE_CHECKING:
    from semcal_cli.verification import Verification


@click.command(
    help=f"""Verify the transform of CALIBRATION on DRIVE: {KNOWN_TRANSFORMS}.

    The pose is estimated again, starting at the transform. Limits are along and about each
    axis of the camera, and in all. Exit code 0: each passes. 3: an offset lies beyond its limit
    with its whole 95 % interval. 4: the data cannot decide.
    """
)
@drive_argument
@click.argument("calibration", type=PATH)
@limit_options(may_be_zero=False)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option("--junit", type=PATH, metavar="FILE", help="Also write a JUnit XML file.")
@seed_option
@threads_option
@max_frames_option
@max_points_option
@cue_option
@quiet_option
def verify(
    drive: Path,
    calibration: Path,
    max_rotation_deg: float,
    max_translation_m: float,
    as_json: bool,
    junit: Path | None,
    seed: int,
    threads: int | None,
    max_frames: int,
    max_points: int,
    cues: tuple[Cue, ...],
    quiet: bool,
) -> None:
    """Verify a transform on a drive."""
    from semcal_cli.cli.drive import loaded_drive
    from semcal_cli.cli.outputs import Outputs
    from semcal_cli.files.writing import write_text
    from semcal_cli.verification import verify as check

    if "features" in cues:
        raise click.UsageError(
            "--cue features: verify compares by the exact histogram, which vectors have none of"
        )
    initial_pose = read_initial_pose(calibration)
    config = CalibrationConfig(seed, cues, max_frames)
    limits = Limits(max_rotation_deg, max_translation_m)
    # The JUnit file must not replace an input; neither must a log.
    outputs = Outputs(log=junit)
    opened = loaded_drive(
        drive, config, outputs, initial_pose, threads=threads, quiet=quiet, max_points=max_points
    )
    with opened as (data, terminal):
        found = check(data, initial_pose, limits, seed, terminal.on_event)
    cases = [Case.of_check(check, found.reasons) for check in found.checks]
    if junit is not None:
        write_text(junit_xml("verify", cases), junit)
    _print(found, as_json)
    annotate("verify", found.verdict, of_verdict(found.verdict, cases), found.reasons)
    sys.exit(EXIT_CODES[found.verdict])


def _print(found: Verification, as_json: bool) -> None:
    if as_json:
        import json
        from dataclasses import asdict

        click.echo(
            json.dumps(asdict(found) | {"T_camera_lidar": found.T_camera_lidar.tolist()}, allow_nan=False)
        )
        return
    for check in found.checks:
        click.echo(check_line(check))
    for sentence in (*found.reasons, *found.notes):
        click.echo(sentence)
    click.echo(found.verdict)
