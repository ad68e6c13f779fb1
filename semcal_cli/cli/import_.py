"""`semcal import`: drives from recordings, data sets, and folders of the user's own files."""

from __future__ import annotations

import inspect
import re
import shlex
from collections import Counter
from dataclasses import dataclass, make_dataclass
from itertools import takewhile
from pathlib import Path
from types import FunctionType
from typing import TYPE_CHECKING, Any, Literal, get_args

import click

from semcal_cli.cli.accumulate import MAX_SECONDS, MAX_SWEEPS, accumulate_into
from semcal_cli.cli.options import FrameSlice, QuietSettings, max_points
from semcal_cli.cli.rules import given, one_of
from semcal_cli.cli.settings import SettingsCommand, argument, made_of, option
from semcal_cli.config.directions import CameraFrame, Direction
from semcal_cli.config.point_files import (
    MAX_UNIT_S,
    SECONDS_PER_UNIT,
    NamedUnit,
    PointColumn,
    PointType,
)
from semcal_cli.config.synchronization import Synchronization
from semcal_cli.errors import ChoiceError, InputError, check_installed, counted, printable, shell
from semcal_cli.importing import DATASETS, PLUGINS, read_dataset

if TYPE_CHECKING:
    from semcal_cli.importing.bags.topics import BagRequest
    from semcal_cli.importing.drive_folder import WrittenDrive
    from semcal_cli.importing.recording import Recording

MAX_REASONS = 10
"""Largest number of printed reasons for leaving something out."""
HEADINGS = ("topic", "type", "messages", "Hz", "first s", "last s", "use")
SIDES = "<<>>>><"
"""Alignment of the columns in the list of topics."""
SECTION = r"\n+(Args|Returns|Raises):\n"
"""Begin of what the docstring of a plugin's function says to programmers."""


class SpinOfLidar(click.ParamType):  # type: ignore[type-arg]
    """HZ:cw|ccw:SEAM_DEG:STAMP, as the keys of `lidar: spin:` in a drive. The stamp may be left out."""

    name = "HZ:cw|ccw:SEAM_DEG[:start|middle|end]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> dict[str, Any]:
        """Parse the spin."""
        from semcal_cli.drive.lidar import Spin

        if isinstance(value, dict):
            return value
        parts = str(value).split(":")
        spin = dict(zip(("rate_hz", "clockwise", "seam_deg", "stamp"), parts, strict=False))
        try:
            numbers = {key: float(spin[key]) for key in ("rate_hz", "seam_deg")}
            is_clockwise = {"cw": True, "ccw": False}[spin["clockwise"]]
            if len(parts) > len(spin):
                raise ValueError(value)
            return Spin.model_validate(spin | numbers | {"clockwise": is_clockwise}).model_dump()
        except (KeyError, ValueError):
            needed = f"{self.name}, such as 10:cw:180:end"
            self.fail(f"found {str(value)[:40]!r}, expected {needed}.", param, ctx)


class PointColumns(click.ParamType):  # type: ignore[type-arg]
    """Comma-separated columns of a file without a header."""

    name = "columns"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[PointColumn, ...]:
        """Parse the columns: x, y and z, and any others, each once."""
        if isinstance(value, tuple):
            return value
        known = get_args(PointColumn)
        names: list[Any] = [name.strip() for name in str(value).split(",")]
        used = [name for name in names if name != "_"]
        if not {*"xyz"} <= {*used} or not {*names} <= {*known} or len({*used}) < len(used):
            needed = f"expected x, y and z, and any of {', '.join(known[3:])}, each once but _"
            self.fail(f"found {str(value)[:40]!r}, {needed}.", param, ctx)
        return tuple(names)


class TimeUnit(click.ParamType):  # type: ignore[type-arg]
    """A unit of time, or its length in seconds."""

    name = "unit"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str | float:
        """Parse the unit."""
        if value in SECONDS_PER_UNIT:
            return str(value)
        try:
            seconds = float(value)
        except ValueError:
            seconds = 0.0
        if not 0.0 < seconds <= MAX_UNIT_S:
            needed = f"expected {', '.join(SECONDS_PER_UNIT)} or its length in seconds"
            self.fail(f"found {str(value)[:40]!r}, {needed}.", param, ctx)
        return seconds


def _max_gap(default: float | None = None, **maximum: float) -> Any:
    text = "Largest time difference between a sweep and its image, in seconds."
    return option(text, default=default, above=0.0, metavar="S", **maximum)


@dataclass(frozen=True, kw_only=True)
class ImportSettings(QuietSettings):
    """Options of every import of files."""

    output: Path = option(
        "Folder for the drive, or its drive.yaml.", "-o", "--output", required=True, metavar="DRIVE"
    )
    camera: str | None = option("Name of the camera.", metavar="NAME")
    frames: slice | None = option("Keep these frames, counted from 0, such as 0:100:10.", type=FrameSlice())
    max_frames: int | None = option(
        "Keep at most N frames: evenly spaced ones, or those that --spread chooses (then 20 if not given).",
        minimum=1,
    )
    spread: bool = option(
        "Keep the frames whose label images differ most; if speeds are known, only from the slower half.",
        default=False,
    )
    image_classes: str | None = option(
        "Classes of the label images: a table such as cityscapes-train, or a file with lines such as `road: [7]`.",
        metavar="NAME|FILE",
    )
    point_classes: str | None = option(
        "Classes of the point labels: a table such as semantickitti, or a file with lines such as `road: [40]`.",
        metavar="NAME|FILE",
    )
    max_gap_s: float | None = _max_gap()
    odometry: bool = option(
        "Estimate the motion from the sweeps with KISS-ICP. A motion that the data state takes precedence, and is "
        "compared with the estimate.",
        default=False,
    )
    force: bool = option("Replace a drive.yaml, even of other data.", default=False)

    def write(
        self,
        recording: Recording,
        sweeps: Path | None = None,
        *,
        is_last: bool = True,
        read: Path | None = None,
        **others: Any,
    ) -> WrittenDrive:
        """Write the drive, and say what was written, and which command comes next if this one is the last.

        With `sweeps`, this drive is the one of all sweeps, of which an accumulated one is made; `read` is the data set
        of a drive that is temporary; `others` are options that have another meaning here.
        """
        if self.odometry:
            check_installed("--odometry", "kiss_icp", "odometry")
        from semcal_cli.importing.choice import Options
        from semcal_cli.importing.drive_folder import write_drive

        options = made_of(Options, self, frames=self.frames or slice(None), **others)
        written = write_drive(recording, options, sweeps or self.output, force=self.force)
        if not self.quiet:
            copies = f", {counted(written.num_converted, 'cloud')} converted" if written.num_converted else ""
            _tell(written, copies, is_last=is_last and sweeps is None, read=read)
        return written


def _sweeps_drive(output: Path) -> Path:
    """Locate the drive of all sweeps, of which an accumulated one is made at `output`."""
    from semcal_cli.drive.document import output_drive_file

    path = output_drive_file(output)
    return path.parent / "sweeps" / path.name


def _tell(
    written: WrittenDrive,
    details: str,
    lines: tuple[str, ...] = (),
    *,
    is_last: bool = True,
    read: Path | None = None,
) -> None:
    """Print what was written, what to know about it, and which command comes next if nothing else is written.

    The path of a temporary drive helps nobody: what was `read` stands in its place.
    """
    from semcal_cli.cli.tables import wrapped
    from semcal_cli.result.next_steps import after_import

    remarks = (line for remark in written.remarks for line in wrapped("note:", remark, indent=6))
    wrote = f"wrote {written.path}" if read is None else f"read {read}"
    wrote += f": {counted(written.num_frames, 'frame')}{details}"
    next_command = (f"next: {after_import(written.drive)}",) if is_last else ()
    for line in (wrote, *lines, *remarks, *next_command):
        click.echo(line, err=True)


@dataclass(frozen=True, kw_only=True)
class DatasetSettings(ImportSettings):
    """Options of the import of a data set."""

    root: Path = argument()
    sequences: tuple[str, ...] = option(
        "Name of the sequence; needed if there are several. Give the option again for more of the same camera.",
        "--sequence",
        metavar="NAME",
        multiple=True,
        default=(),
    )
    image_labels: Path | None = option("Take the label images from this folder.", metavar="DIR")
    point_labels: Path | None = option("Take the point labels from this folder.", metavar="DIR")


@dataclass(frozen=True, kw_only=True)
class NuscenesSettings(DatasetSettings):
    """Options of the import of nuScenes."""

    version: str | None = option(
        "Folder of the tables, such as v1.0-mini; needed if there are several.", metavar="NAME"
    )


@dataclass(frozen=True, kw_only=True)
class CarlaSettings(DatasetSettings):
    """Options of the import of CARLA."""

    version: str | None = option(
        "Release that wrote the data, such as 0.9.15; at least 0.9.10. Tags changed in 0.9.14.",
        metavar="NAME",
    )


@dataclass(frozen=True, kw_only=True)
class Kitti360Settings(DatasetSettings):
    """Options of the import of KITTI-360."""

    rectified: bool | None = option(
        "Which images of image_00 and image_01 to use. Rectified: data_rect, with P_rect and a reference that is "
        "rotated by R_rect. Raw: data_rgb, with K, D and the reference as in calib_cam_to_velo.txt.  "
        "[default: rectified]",
        "--rectified/--raw",
    )


@dataclass(frozen=True, kw_only=True)
class LidarSettings(DatasetSettings):
    """Options of the import of a data set of several LiDARs."""

    lidar: str | None = option("Name of the LiDAR.", metavar="NAME")


OWN_SETTINGS = {"nuscenes": NuscenesSettings, "carla": CarlaSettings, "kitti-360": Kitti360Settings}
"""Settings of the data sets that have options of their own."""
SETTINGS_OF_OPTIONS: dict[str, type[DatasetSettings]] = {"lidar": LidarSettings, "version": NuscenesSettings}
"""Settings with each option that a plugin's data set may declare."""


class Imports(click.Group):
    """semcal's imports, followed by those of plugins."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """List the names of all imports."""
        return [*super().list_commands(ctx), *PLUGINS.names]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Find an import; None if there is none with this name, or if its plugin is broken."""
        if (command := super().get_command(ctx, cmd_name)) is not None:
            return command
        if (read := PLUGINS.get(cmd_name, FunctionType)) is None:
            return None
        about, package = inspect.getdoc(read) or cmd_name, PLUGINS.package(cmd_name)
        about = re.split(SECTION, about)[0]
        summary = f"{about.splitlines()[0]} ({package})"
        declared = [SETTINGS_OF_OPTIONS[name] for name in getattr(read, "request_options", ())]
        settings = make_dataclass(
            "PluginSettings", (), bases=(*declared, DatasetSettings), kw_only=True, frozen=True
        )
        return _dataset_command(cmd_name, summary, f"{about}\n\nThe data set comes from {package}.", settings)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the import that is typed, or suggest one."""
        if not ctx.resilient_parsing and self.get_command(ctx, args[0]) is None:
            self._suggest(ctx, args[0])
        return super().resolve_command(ctx, args)

    def _suggest(self, ctx: click.Context, name: str) -> None:
        """Suggest the right import for a path, and for a name that begins as several do; else click suggests one.

        Raises:
            click.UsageError: there is a suggestion.
        """
        from semcal_cli.importing.recognition import recognise

        if (source := recognise(Path(name))) is not None:
            command = source.command(source.drive)
            raise click.UsageError(f"{name} is {source.name}. Type `{command}`.", ctx)
        if name.lower() in NAMES_OF_RECORDINGS:
            raise click.UsageError(
                f"No such command {name!r}. Recordings: `semcal import bag PATH -o DRIVE`.", ctx
            )
        names = [known for known in self.list_commands(ctx) if name.lower() in known]
        if names:
            raise click.UsageError(f"No such command {name!r}. Did you mean one of {', '.join(names)}?", ctx)


NAMES_OF_RECORDINGS = ("ros", "ros1", "ros2", "rosbag", "rosbag2", "mcap", "db3", "foxglove", "recording")
"""Words that somebody may type for `bag`."""


@click.group(name="import", cls=Imports)
def import_() -> None:
    """Make a drive from a recording, a data set, or a folder of your own files.

    Writes a drive.yaml that points to the original files, with intrinsics, class names and ignored ids. The calibration
    of a data set becomes the reference, T_camera_lidar.
    """


@dataclass(frozen=True, kw_only=True)
class BagSettings(QuietSettings):
    """Settings of `import bag`."""

    rules = [
        one_of("-o", "--list"),
        given("--intrinsics").excludes("--camera-info"),
        given("--motion-frame").excludes("--motion none"),
        given("--accumulate").excludes("--list"),
        given("--all-cameras").excludes("--list", "--image", "--camera-info", "--intrinsics", "--accumulate"),
    ]
    paths: tuple[Path, ...] = argument(metavar="PATH...")
    output: Path | None = option(
        "Folder for the drive, or its drive.yaml.", "-o", "--output", metavar="DRIVE"
    )
    is_list: bool = option("List the topics, and show which would be used.", "--list", default=False)
    points: str | None = option("Topic of the sweeps; needed if there are several.", metavar="TOPIC")
    image: str | None = option("Topic of the images; needed if there are several.", metavar="TOPIC")
    all_cameras: bool = option(
        "Make a drive of each camera in one folder, of the same sweeps where all have images, and a rig.yaml of them.",
        default=False,
    )
    camera_info: str | None = option(
        "Topic of the intrinsics; if not given, the one next to the image topic.", metavar="TOPIC"
    )
    intrinsics: Path | None = option(
        "Take the intrinsics from a file instead: a ROS camera_info, a Kalibr camchain or an OpenCV FileStorage.",
        metavar="FILE",
    )
    frame: CameraFrame | None = option(
        "Axes of the images' frame in /tf_static: optical (x right, y down, z forward) or body (x forward, y left, "
        "z up). If not given, optical."
    )
    is_resized: bool = option(
        "Images were resized after the camera was calibrated: convert K to their size, of the same aspect.",
        "--resized",
        default=False,
    )
    bayer: Literal["rggb", "bggr", "gbrg", "grbg"] | None = option(
        "Images are mosaics of this pattern, whatever their messages state: the colours of the first two pixels of the "
        "first two rows."
    )
    max_frames: int | None = option(
        "Keep at most N frames, chosen so that their scenes differ; 70 if neither this nor --every is given.",
        minimum=1,
    )
    every_s: float | None = option(
        "Take one frame every S seconds instead, and at most --max-frames.",
        "--every",
        above=0.0,
        maximum=1e6,
        metavar="S",
    )
    stamps: Literal["header", "receive"] = option(
        "Times of sweeps and images: from their headers, or when they were received.", default="header"
    )
    max_gap_s: float = _max_gap(0.05, maximum=1e3)
    motion: str | None = option(
        "Topic of the LiDAR's motion: Odometry, PoseStamped or /tf. Needed if there are several.",
        metavar="TOPIC|none",
    )
    motion_frame: str | None = option(
        "Frame whose poses the topic contains, if its messages do not say.", metavar="FRAME"
    )
    spin: dict[str, Any] | None = option(
        "How a LiDAR turns whose points have no times: turns per second, cw or ccw as seen from above, the azimuth "
        "at which sweeps begin, and which moment of a sweep its stamp states: start, middle or end "
        "(middle if not given).",
        type=SpinOfLidar(),
        metavar="HZ:cw|ccw:SEAM_DEG[:STAMP]",
    )
    odometry: bool = option(
        "Estimate the motion from the sweeps with KISS-ICP. A motion topic takes precedence, and is compared "
        "with the estimate; --motion none ignores all topics.",
        default=False,
    )
    accumulate: float | None = option(
        "Make a dense cloud for each image of the sweeps of SECONDS around it, as `semcal accumulate` does; the sweeps "
        "are kept in the folder sweeps beside it.",
        above=0.0,
        maximum=MAX_SECONDS,
        metavar="SECONDS",
    )
    force: bool = option("Replace a drive.yaml, even of other data.", default=False)


@import_.command(
    cls=SettingsCommand,
    settings=BagSettings,
    short_help="A ROS or Foxglove recording: .bag, MCAP, .db3, or a folder of them.",
)
def bag(settings: BagSettings) -> None:
    """Make a drive from a recording. ROS is not needed. Several PATHs are parts of one recording.

    Sweeps keep all their fields, and JPEG and PNG images their bytes; video is decoded, and Bayer mosaics become
    colours. Intrinsics come from camera_info, the reference T_camera_lidar from /tf_static, and motion from odometry or
    /tf. Damaged parts are reported and left out.
    """
    if settings.is_list:
        _check_libraries()
        _list(settings.paths)
        return
    if settings.all_cameras:
        _import_all_cameras(settings)
        return
    import_recording(settings)


def _import_all_cameras(settings: BagSettings) -> None:
    from semcal_cli.drive.document import RIG_FILE
    from semcal_cli.importing.bags.all_cameras import import_cameras

    request, output = _request(settings), settings.output
    assert output is not None  # by a rule
    with settings.terminal() as terminal:
        done = import_cameras(request, output, terminal.on_event, is_rig=True, force=settings.force)
    if settings.quiet:
        return
    for drive in done.values():
        _tell_import(drive.written, drive.num_sweeps, drive.left_out, is_last=False)
    click.echo(f"wrote {output / RIG_FILE}: {counted(len(done), 'camera')}, {', '.join(done)}", err=True)
    click.echo(f"next: {shell('calibrate', output / RIG_FILE, '-o', output / 'results')}", err=True)


def _tell_import(
    written: WrittenDrive,
    num_sweeps: int,
    reasons: Counter[str],
    *,
    is_last: bool,
    read: Path | None = None,
) -> None:
    """Print what was made of a recording, and what was left out, by reason."""
    rows = reasons.most_common()
    left_out = [f"left out {count:>7,} {reason}" for reason, count in rows[:MAX_REASONS]]
    if others := sum(count for _, count in rows[MAX_REASONS:]):
        left_out.append(f"left out {others:>7,} for {len(rows) - MAX_REASONS:,} other reasons")
    _tell(written, f" of {num_sweeps:,} sweeps", tuple(left_out), is_last=is_last, read=read)


def _request(settings: BagSettings) -> BagRequest:
    """Make the request for a recording.

    Raises:
        InputError: a library is missing.
    """
    _check_libraries()
    if settings.odometry:
        check_installed("--odometry", "kiss_icp", "odometry")
    from semcal_cli.drive.lidar import Spin
    from semcal_cli.importing.bags.topics import BagRequest

    spin = None if settings.spin is None else Spin(**settings.spin)
    return made_of(
        BagRequest,
        settings,
        by_receipt=settings.stamps == "receive",
        spin=spin,
        around_s=settings.accumulate,
    )


def _check_libraries() -> None:
    for package in ("rosbags", "mcap"):
        check_installed("recordings", package, "bag")


def import_recording(
    settings: BagSettings, *, is_last: bool = True, read: Path | None = None
) -> WrittenDrive:
    """Make a drive from a recording, and print what was written, and which command comes next if this one is the last.

    Of a temporary drive, `read` is the recording that is named in its place.

    Raises:
        InputError: the recording or an option is wrong, or a library is missing.
    """
    from semcal_cli.drive.document import read_drive
    from semcal_cli.importing.accumulated_drive import check_accumulated
    from semcal_cli.importing.bags.all_cameras import import_cameras

    request = _request(settings)
    assert settings.output is not None  # by a rule
    output = settings.output
    if settings.accumulate is not None:
        output = _sweeps_drive(settings.output)
        check_accumulated(settings.output, output.parent, force=settings.force)
    with settings.terminal() as terminal:
        imported = import_cameras(request, output, terminal.on_event, is_rig=False, force=settings.force)
    (done,) = imported.values()
    if not settings.quiet:
        is_last = is_last and settings.accumulate is None
        _tell_import(done.written, done.num_sweeps, done.left_out, is_last=is_last, read=read)
    if settings.accumulate is not None:
        drive = read_drive(done.written.path)
        accumulate_into(settings.output, drive, settings, seconds=settings.accumulate, force=settings.force)
    return done.written


def _list(paths: tuple[Path, ...]) -> None:
    """Print the topics as a table."""
    from semcal_cli.importing.bags.bag import Bag
    from semcal_cli.importing.bags.topics import roles

    with Bag(paths) as recording:
        uses = roles(recording)
        rows = [HEADINGS]
        for topic in recording.topics:
            span, use = topic.span, uses.get(topic, "")
            times = [f"{1e-9 * (time - recording.start_ns):.3f}" for time in (span.first_ns, span.last_ns)]
            first, last = times if span.num_messages else ("", "")
            is_choice = use in ("sweeps", "images", "fixed frames") and list(uses.values()).count(use) > 1
            choice = " (one of several)" if is_choice else ""
            rate = f"{topic.rate_hz:.1f}"
            rows.append((topic.name, topic.type, f"{span.num_messages:,}", rate, first, last, use + choice))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [f"{cell:{side}{width}}" for cell, side, width in zip(row, SIDES, widths, strict=True)]
        click.echo(printable("  ".join(cells).rstrip()))
    for remark in recording.remarks:
        click.echo(f"note: {remark}", err=True)


def import_dataset(
    name: str, settings: DatasetSettings, *, is_last: bool = True, read: Path | None = None
) -> WrittenDrive:
    """Make a drive from a data set, and print what was written, and which command comes next if this one is the last.

    Of a temporary drive, `read` is the data set that is named in its place.

    Raises:
        ChoiceError: there are several sequences or cameras.
        InputError: a file or an option is wrong.
    """
    from semcal_cli.importing.recognition import recognise
    from semcal_cli.importing.recording import Request, join_sequences

    sequences: list[str | None] = [*dict.fromkeys(settings.sequences)] or [None]
    try:
        recordings = {
            str(sequence): read_dataset(name, made_of(Request, settings, sequence=sequence))
            for sequence in sequences
        }
    except ChoiceError:
        raise
    except InputError as error:
        source = recognise(settings.root)
        if source is None or (source.kind, source.root) == (name, settings.root):
            raise
        command = source.command(settings.output)
        raise InputError(f"{error}; {settings.root} looks like {source.name}: `{command}`") from None
    by_name = settings.image_labels is not None or settings.point_labels is not None
    recording = join_sequences(recordings, are_labelled_by_name=by_name, by_odometry=settings.odometry)
    return settings.write(recording, is_last=is_last, read=read)


def _dataset_command(name: str, summary: str, help: str, kind: type[DatasetSettings]) -> click.Command:
    def read(settings: DatasetSettings) -> None:
        import_dataset(name, settings)

    return SettingsCommand(
        name,
        callback=read,
        settings=kind,
        help=help,
        short_help=summary,
    )


for _name, _dataset in DATASETS.items():
    _kind = OWN_SETTINGS.get(_name, DatasetSettings)
    import_.add_command(_dataset_command(_name, _dataset.summary, f"Import {_dataset.summary}", _kind))


@dataclass(frozen=True, kw_only=True)
class FolderSettings(ImportSettings):
    """Settings of `import folder`."""

    rules = [
        given("--image-classes").requires("--image-labels"),
        given("--reference-direction").requires("--reference"),
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
    reference: Path | None = option("T_camera_lidar to compare with, in any known format.", metavar="FILE")
    reference_direction: Direction | None = option(
        "Direction of the matrix in the --reference file, if the file does not state it: p_camera = T p_lidar, or "
        "p_lidar = T p_camera."
    )
    synchronization: Synchronization = option(
        "What ties images and clouds: a trigger (hardware), their recorded times (stamps), or nothing known.",
        default="unknown",
    )
    max_gap_s: float = _max_gap(0.05)
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


@import_.command(
    cls=FolderCommand,
    settings=FolderSettings,
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
    from semcal_cli.importing.folder import Folder, read

    # The labels are found by their patterns, and are part of the recording.
    labels: dict[str, Any] = {"image_labels": None, "point_labels": None}
    if settings.accumulate is None:
        settings.write(read(made_of(Folder, settings)), **labels)
        return
    from semcal_cli.drive.document import read_drive
    from semcal_cli.importing.accumulated_drive import check_accumulated

    recording = read(made_of(Folder, settings, keeps_all=True))
    sweeps = _sweeps_drive(settings.output)
    tables = [Path(name) for name in (settings.image_classes, settings.point_classes) if name is not None]
    images = [frame.image or frame.image_labels for frame in recording.frames]
    known = [image for image in images if image is not None]
    check_accumulated(settings.output, sweeps.parent, [*recording.read, *tables], known, force=settings.force)
    written = settings.write(recording, sweeps, keeps_all=True, **labels)
    drive = read_drive(written.path, settings.max_points)
    accumulate_into(settings.output, drive, settings, num_sweeps=settings.accumulate, force=settings.force)
