"""`semcal import bag`: a drive from a recording of ROS 1 or ROS 2."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.options import PATH, FiniteRange, number_option, quiet_option
from semcal_cli.cli.rules import CheckedCommand, given, one_of
from semcal_cli.errors import check_installed, printable

if TYPE_CHECKING:
    from semcal_cli.datasets.bags.topics import Request

MAX_REASONS = 10
"""Most reasons for what was left out that are printed."""
HEADINGS = ("topic", "type", "messages", "Hz", "first s", "last s", "use")
SIDES = "<<>>>><"
"""Alignment of the columns of the list of topics."""


@click.command(
    cls=CheckedCommand,
    rules=[
        one_of("-o", "--list"),
        given("--intrinsics").excludes("--camera-info"),
        given("--motion-frame").excludes("--motion none"),
    ],
    short_help="A recording of ROS 1 or ROS 2: .bag, MCAP, .db3, or a folder of them.",
)
@click.argument("paths", type=PATH, nargs=-1, required=True, metavar="PATH...")
@click.option("-o", "--output", type=PATH, metavar="DRIVE", help="Folder of the drive, or its drive.yaml.")
@click.option("--list", "is_list", is_flag=True, help="List the topics, and what would be taken.")
@click.option("--points", metavar="TOPIC", help="Sweeps; needed if there are several topics of them.")
@click.option("--image", metavar="TOPIC", help="Pictures; needed if there are several topics of them.")
@click.option("--camera-info", metavar="TOPIC", help="Intrinsics; if not given, those beside the pictures.")
@click.option(
    "--intrinsics",
    type=PATH,
    metavar="FILE",
    help="Intrinsics from a file instead: a ROS camera_info, a Kalibr camchain or an OpenCV FileStorage.",
)
@number_option(
    "--max-frames",
    help="Keep at most N frames, spread so that their scenes differ: 70 if neither this nor --every is given.",
)
@click.option(
    "--every",
    type=FiniteRange(0.0, 1e6, min_open=True),
    metavar="S",
    help="Take a frame every S seconds instead, and no more than --max-frames.",
)
@click.option(
    "--stamps",
    type=click.Choice(["header", "receive"]),
    default="header",
    show_default=True,
    help="Times of sweeps and pictures: those of their headers, or when they were received.",
)
@click.option(
    "--max-gap-s",
    type=FiniteRange(0.0, 1e3, min_open=True),
    default=0.05,
    show_default=True,
    metavar="S",
    help="Largest time between a sweep and its picture.",
)
@click.option(
    "--motion",
    metavar="TOPIC|none",
    help="Odometry, PoseStamped or /tf that tells how the LiDAR moves; the only one if not given.",
)
@click.option(
    "--motion-frame", metavar="FRAME", help="Frame whose poses it holds, if its messages do not say so."
)
@quiet_option
def bag(paths: tuple[Path, ...], output: Path | None, is_list: bool, quiet: bool, **settings: Any) -> None:
    """Make a drive of a recording, without ROS. Several PATHs are one recording in parts.

    Sweeps keep all their fields, JPEG and PNG pictures their bytes. Intrinsics come from camera_info, the reference
    T_camera_lidar from /tf_static, motion from odometry or /tf. Damaged parts are left out, and told.
    """
    from semcal_cli.cli.terminal import make_console, progress_line

    for package in ("rosbags", "mcap"):
        check_installed("semcal import bag", package, "bag")
    if is_list:
        _list(paths)
        return
    assert output is not None  # by a rule of the command
    from semcal_cli.datasets.bags.importing import import_bag
    from semcal_cli.drive.document import DRIVE_FILE
    from semcal_cli.drive.events import Event, Progress

    with progress_line(make_console(quiet)) as show:

        def on_event(event: Event) -> None:
            if isinstance(event, Progress):
                show(event.doing)

        done = import_bag(_request(paths, settings), output, on_event)
    if quiet:
        return
    written = done.written
    click.echo(f"wrote {written.path}: {written.num_frames:,} frames of {done.num_sweeps:,} sweeps", err=True)
    rows = done.left_out.most_common()
    for reason, count in rows[:MAX_REASONS]:
        click.echo(f"left out {count:>7,} {reason}", err=True)
    if others := sum(count for _, count in rows[MAX_REASONS:]):
        click.echo(f"left out {others:>7,} for {len(rows) - MAX_REASONS:,} other reasons", err=True)
    for remark in written.remarks:
        click.echo(f"note: {remark}", err=True)
    drive = written.path.parent if written.path.name == DRIVE_FILE else written.path
    click.echo(f"next: semcal label {drive} --image-model FILE.onnx -o LABELLED", err=True)


def _request(paths: tuple[Path, ...], settings: dict[str, Any]) -> Request:
    from semcal_cli.datasets.bags.topics import Request

    by_receipt = settings.pop("stamps") == "receive"
    return Request(paths, every_s=settings.pop("every"), by_receipt=by_receipt, **settings)


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
            is_choice = use in ("sweeps", "pictures", "fixed frames") and list(uses.values()).count(use) > 1
            choice = " (one of several)" if is_choice else ""
            rate = f"{topic.rate_hz:.1f}"
            rows.append((topic.name, topic.type, f"{span.num_messages:,}", rate, first, last, use + choice))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [f"{each:{side}{width}}" for each, side, width in zip(row, SIDES, widths, strict=True)]
        click.echo(printable("  ".join(cells).rstrip()))
    for remark in recording.remarks:
        click.echo(f"note: {remark}", err=True)
