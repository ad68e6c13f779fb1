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
from semcal_cli.cli.written_format import CAMERA, DIRECTION, FRAME, LIDAR, WrittenSettings, format_name
from semcal_cli.config.directions import BaseDirection, CameraFrame, Direction

if TYPE_CHECKING:
    from semcal_cli.formats.format import FormatOptions

OPTIONS_OF_IN = {name: f"--{name}" for name in ("from", "direction", "frame", "camera", "lidar", "repair")}
"""What messages call the options for what the input leaves open."""
NAME_WIDTH = 22
"""Columns of the names in the list of formats."""


def _list_formats(ctx: click.Context, param: click.Parameter, lists_formats: bool) -> None:
    if lists_formats and not ctx.resilient_parsing:
        from semcal_cli.cli.tables import wrapped
        from semcal_cli.formats.format_table import PLUGINS, all_formats

        for format in all_formats():
            package = f"; {PLUGINS.package(format.name)}" if format.name in PLUGINS.names else ""
            click.echo("\n".join(wrapped(format.name, format.equation + package, NAME_WIDTH)))
        ctx.exit()


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
