"""`semcal convert`: a transform from one format into another."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.options import INPUT_FILE, PATH, Command, file_or_stdout
from semcal_cli.cli.rules import CheckedCommand, given, one_of

if TYPE_CHECKING:
    from semcal_cli.formats.format import FormatOptions
    from semcal_cli.geometry.poses import Pose
    from semcal_cli.result.calibration import Calibration

DIRECTIONS = ("lidar-to-camera", "camera-to-lidar")
FRAMES = ("optical", "body")


class FormatName(click.ParamType[str]):
    """The name of a format; formats are imported when a name is given, not for `--help` of other commands."""

    name = "format"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Check that the name is that of a format."""
        from semcal_cli.formats import FORMATS

        names = [format.name for format in FORMATS]
        if value not in names:
            self.fail(f"found {value!r}, needed one of: {', '.join(names)}.", param, ctx)
        return str(value)


def open_options(prefix: str, of: str) -> Callable[[Command], Command]:
    """Add the options for what a file leaves open: the file that is read, or with a prefix the file that is written."""

    def add(command: Command) -> Command:
        for option in (
            click.option(f"--{prefix}lidar", metavar="NAME", help=f"The LiDAR's frame or entry in {of}."),
            click.option(
                f"--{prefix}camera", metavar="NAME", help=f"The camera's frame, entry or token in {of}."
            ),
            click.option(
                f"--{prefix}frame",
                type=click.Choice(FRAMES),
                help=f"Axes of the camera's frame in {of}: optical (x right, y down, z forward) or body (x forward, "
                "y left, z up).",
            ),
            click.option(
                f"--{prefix}direction",
                type=click.Choice(DIRECTIONS),
                help=f"Direction of a bare matrix in {of}: p_camera = T p_lidar, or p_lidar = T p_camera.",
            ),
        ):
            command = option(command)
        return command

    return add


def format_options(options: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """List these options of a command by their names in `FormatOptions`."""
    return {name: options[prefix + name] for name in ("direction", "frame", "camera", "lidar")}


def _list_formats(ctx: click.Context, param: click.Parameter, is_asked: bool) -> None:
    if is_asked:
        from semcal_cli.formats import FORMATS

        for format in FORMATS:
            click.echo(f"{format.name:<22}{format.equation}")
        ctx.exit()


def _transform_in(path: Path, options: FormatOptions) -> Pose | str:
    """Read the transform that a file has before it is set, or say why there is none."""
    from semcal_cli.errors import InputError, MisplacedError
    from semcal_cli.formats import read_transform

    try:
        return read_transform(path, None, options)
    except MisplacedError:
        return "which had none"
    except InputError:
        return "which had none that could be read"


def _change(path: Path, before: Pose | str, T_camera_lidar: Pose) -> str:
    """Say what was set, and how far that moves the camera."""
    from semcal_cli.geometry.pose_error import compare_poses

    if isinstance(before, str):
        return f"set the transform in {path}, {before}"
    error = compare_poses(T_camera_lidar, before)
    return f"set the transform in {path}: moved {error.rotation_deg:.3f} degrees, {error.camera_center_cm:.2f} cm"


def _put_into(
    into: Path, source: Path, from_: str | None, read: FormatOptions, written: FormatOptions
) -> None:
    """Set the transform of a file in another one, with the camera and the clock that were estimated with it."""
    from dataclasses import replace

    from semcal_cli.formats import DOUBTED, is_doubted, put_transform, read_extrinsic

    found = read_extrinsic(source, from_, read)
    camera, clock = (None, None) if found.record is None else (found.record.camera, found.record.clock)
    lines: list[str] = []
    options = replace(
        written,
        intrinsics=camera.found if camera is not None and camera.is_kept else None,
        time_offset_s=clock.time_offset_s if clock is not None and clock.is_kept else None,
        on_note=lines.append,
    )
    before = _transform_in(into, written)
    if put_transform(found.T_camera_lidar, into, options).has_transform:
        lines.insert(0, _change(into, before, found.T_camera_lidar))
    if found.record is not None:
        lines += [DOUBTED.format(source)] * is_doubted(found.record) + _what_stays(found.record, source, into)
    for line in lines:
        click.echo(line, err=True)


def _what_stays(record: Calibration, source: Path, into: Path) -> list[str]:
    """Say which of a drive's camera and clock differs from that of the transform that was set in it."""
    from semcal_cli.drive.document import read_drive
    from semcal_cli.formats.format import Source
    from semcal_cli.formats.semcal import DRIVE
    from semcal_cli.result.applied import apply_result

    if DRIVE not in Source.read(into).mapping:
        return []
    changes = apply_result(record, read_drive(into), str(source)).changes
    return [f"the transform belongs to another {label} than the drive has, {line}" for label, line in changes]


@click.command(
    cls=CheckedCommand,
    rules=[
        one_of("--to", "--into"),
        given("--into").excludes("--to", "-o", because="it changes its own file"),
    ],
)
@click.argument("source", metavar="IN", type=INPUT_FILE)
@click.option("--to", type=FormatName(), metavar="FORMAT", help="Format to write; see --formats.")
@click.option(
    "--from", "from_", type=FormatName(), metavar="FORMAT", help="Format of IN, if its content does not tell."
)
@file_or_stdout("File to write. Standard output if it is - or not given.")
@click.option(
    "--into",
    type=PATH,
    metavar="FILE",
    help="Set the transform in this file instead, and leave every other byte of it as it is; intrinsics that were "
    "estimated together with the transform, too, and in a drive the offset of the clock.",
)
@open_options("", "IN")
@open_options("to-", "what is written")
@click.option("--repair", is_flag=True, help="Replace an invalid rotation by the nearest one, and say so.")
@click.option(
    "--formats",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_list_formats,
    help="List the formats, and exit.",
)
def convert(
    source: Path,
    to: str | None,
    from_: str | None,
    output: Path | None,
    into: Path | None,
    repair: bool,
    **options: Any,
) -> None:
    """Convert the transform of IN, or of standard input if it is -, into another format.

    Where IN is a calibration of semcal's or a drive, camera-info, kalibr and opencv also get the intrinsics of its
    camera. --into sets intrinsics that the file has already if IN is a calibration that estimated them and kept them,
    and in a drive likewise the offset of the clock, so that a next calibration begins with both.
    """
    from semcal_cli.errors import InputError
    from semcal_cli.files.writing import STANDARD_OUTPUT, check_descriptor, descriptor
    from semcal_cli.formats import convert as convert_file
    from semcal_cli.formats.format import FormatOptions

    if into is not None and descriptor(into) is not None:
        raise InputError(f"{into}: found a descriptor, needed a file to change")
    if into is None:
        check_descriptor(output or STANDARD_OUTPUT)
    tell = partial(click.echo, err=True)
    written = FormatOptions(**format_options(options, "to_"), on_note=tell)
    on_repair = (lambda line: click.echo(f"semcal: repaired: {line}", err=True)) if repair else None
    read = FormatOptions(**format_options(options), on_repair=on_repair)
    if into is not None:
        _put_into(into, source, from_, read, written)
        return
    assert to is not None
    content = convert_file(source, to, output, from_format=from_, read_options=read, write_options=written)
    if output is None:
        click.echo(content, nl=False)
