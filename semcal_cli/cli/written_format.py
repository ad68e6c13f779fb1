"""Options for the format in which `convert` and `calibrate` write a transform."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.settings import option
from semcal_cli.config.directions import CameraFrame, Direction

if TYPE_CHECKING:
    from semcal_cli.formats.format import FormatOptions

LIDAR = "Name of the LiDAR's frame or entry in {}."
CAMERA = "Name of the camera's frame, entry or token in {}."
FRAME = (
    "Axes of the camera frame in {}: optical (x right, y down, z forward) or body (x forward, y left, z up)."
)
DIRECTION = "Direction of a bare matrix in {}: p_camera = T p_lidar, or p_lidar = T p_camera."
WRITTEN = "the output"
OPTIONS_OF_OUTPUT = {name: f"--to-{name}" for name in ("direction", "frame", "camera", "lidar")} | {
    "repair": "--repair"
}
"""What messages call the options for what the output leaves open."""


class FormatName(click.ParamType[str]):
    """The name of a format. Formats are imported only when a name is given, so `--help` stays fast."""

    name = "format"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Check that a format has this name."""
        from semcal_cli.formats.format_table import FORMATS, PLUGINS

        names = [format.name for format in FORMATS]
        if value not in names and value not in PLUGINS.names:
            self.fail(f"found {value!r}, expected one of: {', '.join([*names, *PLUGINS.names])}.", param, ctx)
        return str(value)


def format_name(help: str, *names: str, **about: Any) -> Any:
    """Make an option field for the name of a format."""
    return option(help, *names, type=FormatName(), metavar="FORMAT", **about)


@dataclass(frozen=True, kw_only=True)
class WrittenSettings:
    """Options for the format that a transform is written in, and for what the format leaves open."""

    to: str | None = format_name("Write only the transform, in a format that `convert --formats` lists.")
    to_direction: Direction | None = option(DIRECTION.format(WRITTEN))
    to_frame: CameraFrame | None = option(FRAME.format(WRITTEN))
    to_camera: str | None = option(CAMERA.format(WRITTEN), metavar="NAME")
    to_lidar: str | None = option(LIDAR.format(WRITTEN), metavar="NAME")

    def written(self, **about: Any) -> FormatOptions:
        """Make the options of the written format; `about` holds the others."""
        from semcal_cli.formats.format import FormatOptions

        return FormatOptions(
            self.to_direction,
            self.to_frame,
            self.to_camera,
            self.to_lidar,
            names=OPTIONS_OF_OUTPUT,
            **about,
        )
