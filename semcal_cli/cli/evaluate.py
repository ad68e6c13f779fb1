"""`semcal evaluate`: the error of a calibration against a reference; kept for scripts, `compare` is its successor."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import click

from semcal_cli.cli.options import json_flag
from semcal_cli.cli.settings import argument, command, option


@dataclass(frozen=True, kw_only=True)
class EvaluateSettings:
    """Settings of `evaluate`."""

    calibration: Path = argument()
    reference: Path = option(
        "Reference: a calibration, a drive with T_camera_lidar, or a RELLIS-3D transforms.yaml.",
        required=True,
        metavar="FILE|DRIVE",
    )
    as_json: bool = json_flag()


@command(EvaluateSettings, hidden=True)
def evaluate(settings: EvaluateSettings) -> None:
    """Print how far CALIBRATION is from a reference. `semcal compare` shows more.

    Rotation is in degrees, the camera centre in centimetres, both along the camera's axes.
    """
    from semcal_cli.cli.tables import error_lines
    from semcal_cli.formats import read_transform
    from semcal_cli.geometry.poses import compare_poses

    error = compare_poses(read_transform(settings.calibration), read_transform(settings.reference))
    click.echo(json.dumps(asdict(error)) if settings.as_json else "\n".join(error_lines(error)))
