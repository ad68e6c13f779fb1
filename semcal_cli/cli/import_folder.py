"""`semcal import folder`: a drive from the user's own files."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

import click

from semcal_cli.cli.accumulate import MAX_SWEEPS, accumulate_into
from semcal_cli.cli.import_settings import (
    ImportSettings,
    lidar_own_points,
    lidar_spin,
    max_gap,
    ray_origin,
    resized,
    stated_lidar,
    sweeps_drive,
)
from semcal_cli.cli.import_values import PointColumns, TimeUnit
from semcal_cli.cli.options import max_points
from semcal_cli.cli.rules import given
from semcal_cli.cli.settings import made_of, option
from semcal_cli.cli.settings_command import SettingsCommand, command
from semcal_cli.config.directions import CameraFrame, Direction
from semcal_cli.config.point_files import NamedUnit, PointColumn, PointType
from semcal_cli.config.synchronization import Synchronization


@dataclass(frozen=True, kw_only=True)
class FolderSettings(ImportSettings):
    """Settings of `import folder`."""

    rules = [
        given("--image-classes").requires("--image-labels"),
        given("--reference-direction").requires("--reference"),
        given("--reference-frame").requires("--reference"),
        given("--point-type").requires("--point-columns"),
        given("--accumulate").excludes("--frames", "--max-frames", "--spread"),
    ]
    points: str = option("Point clouds, such as 'clouds/*.pcd'.", required=True, metavar="GLOB")
    point_labels: str | None = option(
        "Point labels; not needed if the clouds have a field for them.", metavar="GLOB"
    )
    image_labels: str | None = option("Label images.", metavar="GLOB")
    images: str | None = option("Images.", metavar="GLOB")
    camera_info: Path = option(
        "Intrinsics of the raw images: a ROS camera_info (its K and D, not P), a Kalibr camchain or an OpenCV "
        "FileStorage.",
        required=True,
        metavar="FILE",
    )
    model: str | None = option(
        "Camera model, if the intrinsics file names none or the wrong one.", metavar="NAME"
    )
    is_resized: bool = resized()
    reference: Path | None = option(
        "T_camera_lidar to start from and to compare with, in any known format.", metavar="FILE"
    )
    reference_direction: Direction | None = option(
        "Direction of the matrix in the --reference file, if the file does not state it: p_camera = T p_lidar, or "
        "p_lidar = T p_camera."
    )
    reference_frame: CameraFrame | None = option(
        "Axes of the camera's frame in the --reference file: optical (x right, y down, z forward) or body (x forward, "
        "y left, z up). If not given, those that the file states, or optical."
    )
    synchronization: Synchronization = option(
        "What ties images and clouds: a trigger (hardware), their recorded times (stamps), or nothing known.",
        default="unknown",
    )
    max_gap_s: float = max_gap(0.05)
    max_points: int = max_points()
    point_columns: tuple[PointColumn, ...] | None = option(
        "Columns of .bin clouds, such as x,y,z,intensity,ring,time, with _ for one that is not used; if not given, "
        "x,y,z,intensity, if the numbers are in these columns.",
        type=PointColumns(),
        metavar="NAME,...",
    )
    point_type: PointType = option("Numbers of .bin clouds: float32 (f4) or float64 (f8).", default="f4")
    time_unit: NamedUnit | float | None = option(
        "Unit of point times, or its length in seconds, such as 0.1 for times from 0 to 1 in sweeps of 0.1 s; if not "
        "given, what the time between clouds shows, or else s, and ns for whole numbers.",
        type=TimeUnit(),
        metavar="s|ms|us|ns|S",
    )
    spin: dict[str, Any] | None = lidar_spin()
    origin_m: tuple[float, float, float] | None = ray_origin()
    own_points: dict[str, Any] | None = lidar_own_points()
    accumulate: int | None = option(
        "Make a dense cloud for each image of the N sweeps around it, as `semcal accumulate` does; clouds without an "
        "image count.",
        minimum=2,
        maximum=MAX_SWEEPS,
        metavar="N",
    )


class FolderCommand(SettingsCommand["FolderSettings"]):
    """A command whose patterns the shell must not expand."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments; files in place of a pattern get the pattern to type.

        Raises:
            click.UsageError: the shell has expanded a pattern, or an option is wrong.
        """
        stray = {option: files for option in SUFFIXES_OF if len(files := _values(args, option)) > 1}
        if stray:
            patterns = [shlex.join([option, _pattern_of(files)]) for option, files in stray.items()]
            raise click.UsageError(
                f"The shell has expanded the pattern. Quote it: {', '.join(patterns)}.", ctx
            )
        return super().parse_args(ctx, args)


SUFFIXES_OF = ("--points", "--point-labels", "--image-labels", "--images")
"""Options that take a pattern."""


def _values(args: list[str], option: str) -> list[str]:
    """List the words between an option and the next one."""
    rest = args[args.index(option) + 1 :] if option in args else []
    return [*takewhile(lambda word: not word.startswith("-"), rest)]


def _pattern_of(files: list[str]) -> str:
    """Write a pattern for files that a shell has listed."""
    first = Path(files[0])
    return str(first.with_name(f"*{first.suffix}"))


@command(
    FolderSettings,
    cls=FolderCommand,
    short_help="Your own files, found by patterns and paired by time or by name.",
    help="""Make a drive from your own files.

    Quote the patterns. Files are paired by the times in their names if all names contain one (1581624663.149,
    1581624663_149, nanoseconds), otherwise by their names without suffix. Files without a partner are counted.
    --camera selects one camera of a Kalibr camchain.

    A file for --image-classes or --point-classes is written like one side of `classes` in a drive.yaml; ids that it
    does not list are ignored:

    \b
      road: [7]
      car: [26, 27]
    """,
)
def folder(settings: FolderSettings) -> None:
    """Make a drive from your own files."""
    from semcal_cli.importing.folder import FilePatterns, read

    # The labels are found by their patterns, and are part of the recording.
    labels: dict[str, Any] = {"image_labels": None, "point_labels": None}
    lidar = stated_lidar(settings.spin, settings.origin_m, settings.own_points)
    if settings.accumulate is None:
        settings.write(read(made_of(FilePatterns, settings, lidar=lidar)), **labels)
        return
    from semcal_cli.drive.document import read_drive
    from semcal_cli.importing.accumulated_drive import check_accumulated

    recording = read(made_of(FilePatterns, settings, lidar=lidar, keeps_all=True))
    sweeps = sweeps_drive(settings.output)
    tables = [Path(name) for name in (settings.image_classes, settings.point_classes) if name is not None]
    images = [frame.image or frame.image_labels for frame in recording.frames]
    known = [image for image in images if image is not None]
    check_accumulated(settings.output, sweeps.parent, [*recording.read, *tables], known, force=settings.force)
    written = settings.write(recording, sweeps, keeps_all=True, **labels)
    drive = read_drive(written.path, settings.max_points)
    accumulate_into(settings.output, drive, settings, num_sweeps=settings.accumulate, force=settings.force)
