"""`semcal import`: drives from recordings, from data sets, and from folders of the user's own files."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from pathlib import Path
from types import FunctionType
from typing import TYPE_CHECKING, Any, Literal

import click

from semcal_cli.cli.options import QuietSettings, max_points
from semcal_cli.cli.rules import given, one_of
from semcal_cli.cli.settings import SettingsCommand, argument, made_of, option
from semcal_cli.datasets import DATASETS, PLUGINS, read_dataset
from semcal_cli.errors import check_installed, printable

if TYPE_CHECKING:
    from semcal_cli.datasets.recording import Recording
    from semcal_cli.datasets.writing import Written

MAX_REASONS = 10
"""Largest number of reasons for leaving something out that are printed."""
HEADINGS = ("topic", "type", "messages", "Hz", "first s", "last s", "use")
SIDES = "<<>>>><"
"""Alignment of the columns of the list of topics."""


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


@dataclass(frozen=True, kw_only=True)
class ImportSettings(QuietSettings):
    """Options of every import of files."""

    output: Path = option(
        "Folder of the drive, or its drive.yaml.", "-o", "--output", required=True, metavar="DRIVE"
    )
    camera: str | None = option("The camera.", metavar="NAME")
    frames: slice | None = option("Keep these frames, counted from 0, as 0:100:10.", type=FrameSlice())
    max_frames: int | None = option(
        "Keep at most N frames, evenly spaced, or as --spread says (20 if not given).", least=1
    )
    spread: bool = option(
        "Keep the frames whose label images differ most; if speeds are known, only among the slower half.",
        default=False,
    )
    image_classes: str | None = option(
        "Classes of the label images: a table as cityscapes-train, or a file of lines as `road: [7]`.",
        metavar="NAME|FILE",
    )
    point_classes: str | None = option(
        "Classes of the point labels: a table as semantickitti, or a file of lines as `road: [40]`.",
        metavar="NAME|FILE",
    )
    max_gap_s: float | None = option(
        "Largest difference in time between a sweep and its image.", above=0.0, metavar="S"
    )

    def write(self, recording: Recording, **others: Any) -> None:
        """Write the drive, and say what was written; `others` are options that have another meaning here."""
        from semcal_cli.datasets.choice import Options
        from semcal_cli.datasets.writing import write_drive

        options = made_of(Options, self, frames=self.frames or slice(None), **others)
        written = write_drive(recording, options, self.output)
        if not self.quiet:
            copies = f", {written.num_converted:,} clouds converted" if written.num_converted else ""
            _tell(written, copies)


def _tell(written: Written, details: str, lines: tuple[str, ...] = ()) -> None:
    """Say what was written, what a user should know of it, and which command follows."""
    from semcal_cli.cli.tables import wrapped
    from semcal_cli.result.next_steps import after_import

    remarks = (line for remark in written.remarks for line in wrapped("note:", remark, indent=6))
    wrote = f"wrote {written.path}: {written.num_frames:,} frames{details}"
    for line in (wrote, *lines, *remarks, f"next: {after_import(written.drive)}"):
        click.echo(line, err=True)


@dataclass(frozen=True, kw_only=True)
class DatasetSettings(ImportSettings):
    """Options of the import of a data set."""

    root: Path = argument()
    sequence: str | None = option("The sequence; needed if there are several.", metavar="NAME")
    image_labels: Path | None = option("Take the label images from this folder.", metavar="DIR")
    point_labels: Path | None = option("Take the point labels from this folder.", metavar="DIR")
    version: str | None = None
    rectified: bool | None = None


@dataclass(frozen=True, kw_only=True)
class NuscenesSettings(DatasetSettings):
    """Options of the import of nuScenes."""

    version: str | None = option(
        "The folder of the tables, as v1.0-mini, if there are several.", metavar="NAME"
    )


@dataclass(frozen=True, kw_only=True)
class CarlaSettings(DatasetSettings):
    """Options of the import of CARLA."""

    version: str | None = option(
        "The release that wrote the data, as 0.9.15, from 0.9.10 on: tags changed at 0.9.14.", metavar="NAME"
    )


@dataclass(frozen=True, kw_only=True)
class Kitti360Settings(DatasetSettings):
    """Options of the import of KITTI-360."""

    rectified: bool | None = option(
        "Images of image_00 and image_01. Rectified: data_rect, with P_rect and a reference that is turned by "
        "R_rect. Raw: data_rgb, with K, D and the reference as calib_cam_to_velo.txt has it.  [default: rectified]",
        "--rectified/--raw",
    )


OWN_SETTINGS = {"nuscenes": NuscenesSettings, "carla": CarlaSettings, "kitti-360": Kitti360Settings}
"""Settings of the data sets that have options of their own."""


class Imports(click.Group):
    """The imports of semcal, and after them those of plugins."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """List the names of all imports."""
        return [*super().list_commands(ctx), *PLUGINS.names]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Find an import; None if there is none of this name, or if its plugin is broken."""
        if (command := super().get_command(ctx, cmd_name)) is not None:
            return command
        if (read := PLUGINS.get(cmd_name, FunctionType)) is None:
            return None
        about, package = inspect.getdoc(read) or cmd_name, PLUGINS.package(cmd_name)
        summary = f"{about.splitlines()[0]} ({package})"
        return _dataset_command(cmd_name, summary, f"{about}\n\nThe data set comes from {package}.")


@click.group(name="import", cls=Imports)
def import_() -> None:
    """Make a drive of a recording, of a data set, or of a folder of your own files.

    Writes a drive.yaml that points at the original files, with intrinsics, class names, ignored ids and, as
    the reference T_camera_lidar, the data set's own calibration.
    """


@dataclass(frozen=True, kw_only=True)
class BagSettings(QuietSettings):
    """What the options of `import bag` say."""

    rules = [
        one_of("-o", "--list"),
        given("--intrinsics").excludes("--camera-info"),
        given("--motion-frame").excludes("--motion none"),
    ]
    paths: tuple[Path, ...] = argument(metavar="PATH...")
    output: Path | None = option("Folder of the drive, or its drive.yaml.", "-o", "--output", metavar="DRIVE")
    is_list: bool = option("List the topics, and what would be taken.", "--list", default=False)
    points: str | None = option("Sweeps; needed if there are several topics of them.", metavar="TOPIC")
    image: str | None = option("Images; needed if there are several topics of them.", metavar="TOPIC")
    camera_info: str | None = option("Intrinsics; if not given, those beside the images.", metavar="TOPIC")
    intrinsics: Path | None = option(
        "Intrinsics from a file instead: a ROS camera_info, a Kalibr camchain or an OpenCV FileStorage.",
        metavar="FILE",
    )
    max_frames: int | None = option(
        "Keep at most N frames, spread so that their scenes differ: 70 if neither this nor --every is given.",
        least=1,
    )
    every_s: float | None = option(
        "Take a frame every S seconds instead, and no more than --max-frames.",
        "--every",
        above=0.0,
        most=1e6,
        metavar="S",
    )
    stamps: Literal["header", "receive"] = option(
        "Times of sweeps and images: those of their headers, or when they were received.", default="header"
    )
    max_gap_s: float = option(
        "Largest time between a sweep and its image.", default=0.05, above=0.0, most=1e3, metavar="S"
    )
    motion: str | None = option(
        "Odometry, PoseStamped or /tf that tells how the LiDAR moves; the only one if not given.",
        metavar="TOPIC|none",
    )
    motion_frame: str | None = option(
        "Frame whose poses it holds, if its messages do not say so.", metavar="FRAME"
    )
    odometry: bool = option(
        "Estimate the motion from the sweeps by KISS-ICP. A topic that tells it goes first and is compared with it; "
        "--motion none takes none.",
        default=False,
    )


@import_.command(
    cls=SettingsCommand,
    settings=BagSettings,
    short_help="A recording of ROS or Foxglove: .bag, MCAP, .db3, or a folder of them.",
)
def bag(settings: BagSettings) -> None:
    """Make a drive of a recording, without ROS. Several PATHs are one recording in parts.

    Sweeps keep all their fields, JPEG and PNG images their bytes; video is decoded. Intrinsics come from
    camera_info, the reference T_camera_lidar from /tf_static, motion from odometry or /tf. Damaged parts are left out,
    and told.
    """
    from semcal_cli.cli.terminal import Terminal

    for package in ("rosbags", "mcap"):
        check_installed("semcal import bag", package, "bag")
    if settings.odometry:
        check_installed("--odometry", "kiss_icp", "odometry")
    if settings.is_list:
        _list(settings.paths)
        return
    from semcal_cli.datasets.bags.importing import import_bag
    from semcal_cli.datasets.bags.topics import Request

    request = made_of(Request, settings, by_receipt=settings.stamps == "receive")
    assert settings.output is not None  # by a rule
    with Terminal(quiet=settings.quiet) as terminal:
        done = import_bag(request, settings.output, terminal.on_event)
    if settings.quiet:
        return
    rows = done.left_out.most_common()
    left_out = [f"left out {count:>7,} {reason}" for reason, count in rows[:MAX_REASONS]]
    if others := sum(count for _, count in rows[MAX_REASONS:]):
        left_out.append(f"left out {others:>7,} for {len(rows) - MAX_REASONS:,} other reasons")
    _tell(done.written, f" of {done.num_sweeps:,} sweeps", tuple(left_out))


def _list(paths: tuple[Path, ...]) -> None:
    """Print the topics as a table."""
    from semcal_cli.datasets.bags.bag import Bag
    from semcal_cli.datasets.bags.messages import NS
    from semcal_cli.datasets.bags.topics import roles

    with Bag(paths) as recording:
        uses = roles(recording)
        rows = [HEADINGS]
        for topic in recording.topics:
            span, use = topic.span, uses.get(topic, "")
            times = [f"{(time - recording.start_ns) / NS:.3f}" for time in (span.first_ns, span.last_ns)]
            first, last = times if span.num_messages else ("", "")
            is_choice = use in ("sweeps", "images", "fixed frames") and list(uses.values()).count(use) > 1
            choice = " (one of several)" if is_choice else ""
            rate = f"{topic.rate_hz:.1f}"
            rows.append((topic.name, topic.type, f"{span.num_messages:,}", rate, first, last, use + choice))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [f"{each:{side}{width}}" for each, side, width in zip(row, SIDES, widths, strict=True)]
        click.echo(printable("  ".join(cells).rstrip()))
    for remark in recording.remarks:
        click.echo(f"note: {remark}", err=True)


def _dataset_command(name: str, summary: str, help: str) -> click.Command:
    def read(settings: DatasetSettings) -> None:
        from semcal_cli.datasets.recording import Request

        settings.write(read_dataset(name, made_of(Request, settings)))

    return SettingsCommand(
        name,
        callback=read,
        settings=OWN_SETTINGS.get(name, DatasetSettings),
        help=help,
        short_help=summary,
    )


for _name, _dataset in DATASETS.items():
    import_.add_command(_dataset_command(_name, _dataset.summary, f"Import {_dataset.summary}"))


@dataclass(frozen=True, kw_only=True)
class FolderSettings(ImportSettings):
    """What the options of `import folder` say."""

    rules = [given("--image-classes").requires("--image-labels")]
    points: str = option("Point clouds, as 'clouds/*.pcd'.", required=True, metavar="GLOB")
    point_labels: str | None = option(
        "Point labels; not needed where the clouds have a field of them.", metavar="GLOB"
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
        "Camera model, if the file of the intrinsics names none, or another one.", metavar="NAME"
    )
    reference: Path | None = option("T_camera_lidar to compare with, in any known format.", metavar="FILE")
    max_gap_s: float = option(
        "Largest difference in time between a sweep and its image.", default=0.05, above=0.0, metavar="S"
    )
    max_points: int = max_points()


@import_.command(
    cls=SettingsCommand,
    settings=FolderSettings,
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
def folder(settings: FolderSettings) -> None:
    """Make a drive of your own files."""
    from semcal_cli.datasets.folder import Folder, read

    # The labels are found by their patterns, and belong to the recording.
    settings.write(read(made_of(Folder, settings)), image_labels=None, point_labels=None)
