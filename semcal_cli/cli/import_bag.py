"""`semcal import bag`: drives from ROS and Foxglove recordings."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from semcal_cli.cli.accumulate import MAX_SECONDS, accumulate_into
from semcal_cli.cli.import_settings import (
    lidar_own_points,
    lidar_spin,
    max_gap,
    ray_origin,
    resized,
    stated_lidar,
    sweeps_drive,
    tell_written,
)
from semcal_cli.cli.options import QuietSettings
from semcal_cli.cli.rules import given, one_of
from semcal_cli.cli.settings import argument, made_of, option
from semcal_cli.cli.settings_command import command
from semcal_cli.config.directions import CameraFrame
from semcal_cli.errors import check_installed, counted, printable, shell

if TYPE_CHECKING:
    from semcal_cli.importing.bags.topics import BagRequest
    from semcal_cli.importing.drive_folder import WrittenDrive

MAX_REASONS = 10
"""Largest number of printed reasons for leaving something out."""
HEADINGS = ("topic", "type", "messages", "Hz", "first s", "last s", "use")
SIDES = "<<>>>><"
"""Alignment of the columns in the list of topics."""


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
    is_resized: bool = resized()
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
    max_gap_s: float = max_gap(0.05, maximum=1e3)
    motion: str | None = option(
        "Topic of the LiDAR's motion: Odometry, PoseStamped or /tf. Needed if there are several.",
        metavar="TOPIC|none",
    )
    motion_frame: str | None = option(
        "Frame whose poses the topic contains, if its messages do not say.", metavar="FRAME"
    )
    spin: dict[str, Any] | None = lidar_spin()
    origin_m: tuple[float, float, float] | None = ray_origin()
    own_points: dict[str, Any] | None = lidar_own_points()
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


@command(BagSettings, short_help="A ROS or Foxglove recording: .bag, MCAP, .db3, or a folder of them.")
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
    tell_written(written, f" of {num_sweeps:,} sweeps", tuple(left_out), is_last=is_last, read=read)


def _request(settings: BagSettings) -> BagRequest:
    """Make the request for a recording.

    Raises:
        InputError: a library is missing.
    """
    _check_libraries()
    if settings.odometry:
        check_installed("--odometry", "kiss_icp", "odometry")
    from semcal_cli.drive.lidar import Lidar
    from semcal_cli.importing.bags.topics import BagRequest

    stated = stated_lidar(settings.spin, settings.origin_m, settings.own_points)
    return made_of(
        BagRequest,
        settings,
        by_receipt=settings.stamps == "receive",
        lidar=None if stated is None else Lidar.model_validate(stated),
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
        output = sweeps_drive(settings.output)
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
