"""`semcal evaluate`: the error of a calibration against a reference; kept for scripts, `compare` is its successor."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click

from semcal_cli.cli.options import PATH, json_only_option


@click.command(hidden=True)
@click.argument("calibration", type=PATH)
@click.option(
    "--reference",
    type=PATH,
    required=True,
    metavar="FILE|DRIVE",
    help="Reference: a calibration, a drive with T_camera_lidar, or a RELLIS-3D transforms.yaml.",
)
@json_only_option
def evaluate(calibration: Path, reference: Path, as_json: bool) -> None:
    """Print how far CALIBRATION is from a reference. `semcal compare` tells more.

    Rotation in degrees, camera centre in centimetres, along the axes of the camera.
    """
    from semcal_cli.formats import read_transform
    from semcal_cli.geometry.pose_error import compare_poses

    error = compare_poses(read_transform(calibration), read_transform(reference))
    if as_json:
        click.echo(json.dumps(asdict(error)))
        return
    from semcal_cli.cli.tables import error_lines

    for line in error_lines(error):
        click.echo(line)
