"""`semcal import`: drives from data sets, and from folders of the user's own files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.import_bag import bag
from semcal_cli.cli.options import PATH, FiniteRange, max_points_option, number_option, quiet_option
from semcal_cli.cli.rules import CheckedCommand, given
from semcal_cli.datasets import DATASETS, read_dataset

if TYPE_CHECKING:
    from semcal_cli.datasets.recording import Recording

OWN_OPTIONS = {
    "nuscenes": click.Option(
        ["--version"],
        metavar="NAME",
        help="The folder of the tables, as v1.0-mini, if there are several.",
    ),
    "carla": click.Option(
        ["--version"],
        metavar="NAME",
        help="The release that wrote the data, as 0.9.15, from 0.9.10 on: tags changed at 0.9.14.",
    ),
    "kitti-360": click.Option(
        ["--rectified/--raw"],
        default=None,
        help="Pictures of image_00 and image_01. Rectified: data_rect, with P_rect and a reference that is turned by "
        "R_rect. Raw: data_rgb, with K, D and the reference as calib_cam_to_velo.txt has it.  [default: rectified]",
    ),
}
"""Options that only one data set has."""


class FrameSlice(click.ParamType):  # type: ignore[type-arg]
    """START:STOP:STEP as in Python."""

    name = "START:STOP:STEP"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> slice:
        """Parse the slice."""
        if isinstance(value, slice):
            return value
        try:
            parts = [int(part) if part else None for part in str(value).split(":")]
        except ValueError:
            parts = []
        if len(parts) not in (2, 3) or (len(parts) == 3 and parts[2] is not None and parts[2] < 1):
            needed = "START:STOP or START:STOP:STEP, with a step of at least 1"
            self.fail(f"found {str(value)[:40]!r}, needed {needed}.", param, ctx)
        return slice(*parts)


@click.group(name="import")
def import_() -> None:
    """Make a drive of a recording, of a data set, or of a folder of your own files.

    Writes a drive.yaml that points at the original files, with intrinsics, class names, ignored ids and, as
    the reference T_camera_lidar, the data set's own calibration.
    """


def drive_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that every import has."""
    for option in (
        quiet_option,
        click.option(
            "--point-classes",
            metavar="NAME|FILE",
            help="Classes of the labels of points: a table as semantickitti, or a file of lines as `road: [40]`.",
        ),
        click.option(
            "--image-classes",
            metavar="NAME|FILE",
            help="Classes of the label images: a table as cityscapes-train, or a file of lines as `road: [7]`.",
        ),
        click.option(
            "--spread",
            is_flag=True,
            help="Keep the frames whose label images differ most; if speeds are known, only among the slower half.",
        ),
        number_option(
            "--max-frames",
            help="Keep at most N frames, evenly spaced, or as --spread says (20 if not given).",
        ),
        click.option(
            "--frames",
            type=FrameSlice(),
            default=slice(None),
            help="Keep these frames, counted from 0, as 0:100:10.",
        ),
        click.option("--camera", metavar="NAME", help="The camera."),
        click.option(
            "-o",
            "--output",
            type=PATH,
            required=True,
            metavar="DRIVE",
            help="Folder of the drive, or its drive.yaml.",
        ),
    ):
        command = option(command)
    return command


def _gap_option(default: float | None) -> Callable[..., Any]:
    return click.option(
        "--max-gap-s",
        type=FiniteRange(0.0, min_open=True),
        default=default,
        show_default=default is not None,
        metavar="S",
        help="Largest difference in time between a sweep and its image.",
    )


def _write(recording: Recording, output: Path, quiet: bool, settings: dict[str, Any]) -> None:
    from semcal_cli.datasets.choice import Options
    from semcal_cli.datasets.writing import write_drive

    written = write_drive(recording, Options(**settings), output)
    if quiet:
        return
    copies = f", {written.num_converted:,} clouds converted" if written.num_converted else ""
    click.echo(f"wrote {written.path}: {written.num_frames:,} frames{copies}", err=True)
    for remark in written.remarks:
        click.echo(f"note: {remark}", err=True)


def _dataset_command(name: str, summary: str) -> click.Command:
    @click.command(name, help=f"Import {summary}", short_help=summary)
    @click.argument("root", type=PATH)
    @drive_options
    @_gap_option(None)
    @click.option("--sequence", metavar="NAME", help="The sequence; needed if there are several.")
    @click.option("--image-labels", type=PATH, metavar="DIR", help="Take the label images from this folder.")
    @click.option(
        "--point-labels", type=PATH, metavar="DIR", help="Take the labels of points from this folder."
    )
    def command(root: Path, output: Path, quiet: bool, **settings: Any) -> None:
        from semcal_cli.datasets.recording import Request

        keys = ("sequence", "camera", "version", "rectified")
        request = Request(root, **{key: settings.pop(key) for key in keys if key in settings})
        _write(read_dataset(name, request), output, quiet, settings)

    if name in OWN_OPTIONS:
        command.params.append(OWN_OPTIONS[name])
    return command


import_.add_command(bag)
for _name, _dataset in DATASETS.items():
    import_.add_command(_dataset_command(_name, _dataset.summary))


@import_.command(
    cls=CheckedCommand,
    rules=[given("--image-classes").requires("--image-labels")],
    short_help="Your own files, found by patterns and paired by time or by name.",
    help="""Make a drive of your own files.

    Quote the patterns. Files are paired by the times in their names where all names hold one (1581624663.149,
    1581624663_149, nanoseconds), else by their names without suffix. Files without a partner are counted.
    --camera names one of the cameras of a Kalibr camchain.

    A file of --image-classes or --point-classes is written as one side of the classes of a drive.yaml; other ids
    are ignored:

    \b
      road: [7]
      car: [26, 27]
    """,
)
@click.option("--points", required=True, metavar="GLOB", help="Point clouds, as 'clouds/*.pcd'.")
@click.option(
    "--point-labels",
    metavar="GLOB",
    help="Labels of points; not needed where the clouds have a field of them.",
)
@click.option("--image-labels", metavar="GLOB", help="Label images.")
@click.option("--images", metavar="GLOB", help="Images.")
@click.option(
    "--camera-info",
    type=PATH,
    required=True,
    metavar="FILE",
    help="Intrinsics of the raw images: a ROS camera_info (its K and D, not P), a Kalibr camchain or an OpenCV "
    "FileStorage.",
)
@click.option(
    "--model", metavar="NAME", help="Camera model, if the file of the intrinsics names none, or another one."
)
@click.option(
    "--reference", type=PATH, metavar="FILE", help="T_camera_lidar to compare with, in any known format."
)
@drive_options
@_gap_option(0.05)
@max_points_option
def folder(
    points: str,
    point_labels: str | None,
    image_labels: str | None,
    images: str | None,
    camera_info: Path,
    model: str | None,
    reference: Path | None,
    camera: str | None,
    max_points: int,
    output: Path,
    quiet: bool,
    **settings: Any,
) -> None:
    """Make a drive of your own files."""
    from semcal_cli.datasets.folder import Folder, read

    source = Folder(
        points=points,
        camera_info=camera_info,
        max_gap_s=settings["max_gap_s"],
        image_labels=image_labels,
        point_labels=point_labels,
        images=images,
        camera=camera,
        model=model,
        reference=reference,
        max_points=max_points,
    )
    _write(read(source), output, quiet, settings)
