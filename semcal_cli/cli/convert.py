"""`semcal convert`: a transform from one format to another."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.options import result_file
from semcal_cli.cli.parameter_types import INPUT_FILE
from semcal_cli.cli.rules import given, one_of
from semcal_cli.cli.settings import argument, option
from semcal_cli.cli.settings_command import command
from semcal_cli.config.directions import BaseDirection, CameraFrame, Direction

if TYPE_CHECKING:
    from semcal_cli.formats.format import FormatOptions

LIDAR = "Name of the LiDAR's frame or entry in {}."
CAMERA = "Name of the camera's frame, entry or token in {}."
FRAME = (
    "Axes of the camera frame in {}: optical (x right, y down, z forward) or body (x forward, y left, z up)."
)
DIRECTION = "Direction of a bare matrix in {}: p_camera = T p_lidar, or p_lidar = T p_camera."
WRITTEN = "the output"
OPTIONS_OF_IN = {name: f"--{name}" for name in ("from", "direction", "frame", "camera", "lidar", "repair")}
OPTIONS_OF_OUTPUT = {name: f"--to-{name}" for name in ("direction", "frame", "camera", "lidar")} | {
    "repair": "--repair"
}
"""What messages call the options for what the input and the output leave open."""
NAME_WIDTH = 22
"""Columns of the names in the list of formats."""


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


def _list_formats(ctx: click.Context, param: click.Parameter, lists_formats: bool) -> None:
    if lists_formats and not ctx.resilient_parsing:
        from semcal_cli.cli.tables import wrapped
        from semcal_cli.formats.format_table import PLUGINS, all_formats

        for format in all_formats():
            package = f"; {PLUGINS.package(format.name)}" if format.name in PLUGINS.names else ""
            click.echo("\n".join(wrapped(format.name, format.equation + package, NAME_WIDTH)))
        ctx.exit()


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


@dataclass(frozen=True, kw_only=True)
class ConvertSettings(WrittenSettings):
    """Settings of `convert`."""

    rules = [
        one_of("--to", "--into"),
        given("--to").excludes("--into"),
        given("--key").requires("--into"),
        given("--base-direction", "--base-frame").requires("--base"),
    ]
    source: Path = argument(type=INPUT_FILE, metavar="IN")
    from_: str | None = format_name("Format of IN, if its content does not show it.", "--from")
    to: str | None = format_name("Format to write; see --formats.")
    into: Path | None = option(
        "File to set the transform in, in place of --to. -o gets a copy of it in which only the numbers of the "
        "transform change: a YAML or JSON document, a URDF or xacro, a launch file of ROS, or a calibration of KITTI "
        "or OpenCalib.",
        type=INPUT_FILE,
        metavar="FILE",
    )
    key: str | None = option(
        "Where --into has the transform: the keys that lead to it in a document, such as sensors.front.T, or the name "
        "of the joint in a URDF. The value keeps its notation; angles are radians.",
        metavar="KEY",
    )
    base: Path | None = option(
        "Write the transform from the vehicle's base_link to the camera, in place of that from the LiDAR. FILE holds "
        "the pose of the LiDAR on the vehicle, p_base = T_base_lidar p_lidar: the result of `semcal base`, a URDF, "
        "tf2, a static_transform_publisher, a launch file, a file of Autoware, or a matrix.",
        type=INPUT_FILE,
        metavar="FILE",
    )
    base_direction: BaseDirection | None = option(
        "Direction of a bare matrix in --base: p_base = T p_lidar, or p_lidar = T p_base."
    )
    base_frame: str | None = option(
        "Name of the vehicle's frame, in --base and in the output.  [default: that in FILE, or base_link]",
        metavar="NAME",
    )
    force: bool = option("Replace a file that is there, such as that of --into, by -o.", default=False)
    output: Path | None = result_file("File to write. Standard output if it is - or not given.")
    direction: Direction | None = option(DIRECTION.format("IN"))
    frame: CameraFrame | None = option(FRAME.format("IN"))
    camera: str | None = option(CAMERA.format("IN"), metavar="NAME")
    lidar: str | None = option(LIDAR.format("IN"), metavar="NAME")
    repair: bool = option("Replace an invalid rotation by the nearest valid one, and say so.", default=False)

    def read(self) -> FormatOptions:
        """Make the options of the format that is read."""
        from semcal_cli.formats.format import FormatOptions

        on_repair = (lambda line: click.echo(f"semcal: repaired: {line}", err=True)) if self.repair else None
        on_note = partial(click.echo, err=True)
        return FormatOptions(
            self.direction,
            self.frame,
            self.camera,
            self.lidar,
            on_repair=on_repair,
            on_note=on_note,
            names=OPTIONS_OF_IN,
        )


@command(ConvertSettings)
@click.option(
    "--formats",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_list_formats,
    help="List the formats, and exit.",
)
def convert(settings: ConvertSettings) -> None:
    """Convert the transform in IN, or on standard input if IN is -, to another format, or set it in a file.

    If IN is a semcal calibration or a drive, the formats camera-info, kalibr and opencv also get the intrinsics of its
    camera.
    """
    from semcal_cli.files.output_files import STANDARD_OUTPUT, check_descriptor
    from semcal_cli.formats import convert as convert_file, set_in_file

    source, output = settings.source, settings.output
    check_descriptor(output or STANDARD_OUTPUT)
    written = settings.written(on_note=partial(click.echo, err=True))
    options: dict[str, Any] = {
        "from_format": settings.from_,
        "read_options": settings.read(),
        "write_options": written,
        "base": settings.base,
        "base_direction": settings.base_direction,
        "base_frame": settings.base_frame,
    }
    if settings.into is not None:
        content = set_in_file(
            source, settings.into, output, key=settings.key, replaces=settings.force, **options
        )
    else:
        assert settings.to is not None
        content = convert_file(
            source,
            settings.to,
            output,
            replaces=settings.force,
            **options,
        )
    if output is None:
        click.echo(content, nl=False)
