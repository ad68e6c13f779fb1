"""`semcal inspect`: the content of a drive."""

from __future__ import annotations

import json
import os
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.options import json_flag, max_points
from semcal_cli.cli.rules import given
from semcal_cli.cli.settings import argument, option
from semcal_cli.cli.settings_command import command
from semcal_cli.errors import CalibrationError, counted, printable, shell

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from rich.table import Table

    from semcal_cli.checks.inspection import DriveReport
    from semcal_cli.drive.document import Drive

NUM_NAMED = 4
"""Number of classes that the table names, most common first."""
NUM_NAMED_FRAMES = 3
"""Number of frames that a finding about several frames names."""
NUM_SWEEPS = 4
"""Number of sweeps from which the origin of their rays is found."""
LABEL_WIDTH = 12
FEW_SECONDS = 10.0
"""Time below which tenths of a second are printed."""
WIDE = 240
"""Width of the table of frames on a pipe, in columns."""


@dataclass(frozen=True, kw_only=True)
class InspectSettings:
    """Settings of `inspect`."""

    rules = [
        given("--find-mask").excludes("--frames", "--json", "--find-origin", because="it only writes a mask"),
        given("--find-origin").excludes("--frames", "--json", because="it only prints a place"),
    ]
    drive: Path = argument()
    with_frames: bool = option("Also print one row per frame.", "--frames", default=False)
    as_json: bool = json_flag()
    find_mask: Path | None = option(
        "Only propose a mask, .png: black where images never change while the rig moves, next to the lower border or a "
        "side, as on the car's own bonnet. Look at it before you use it as camera.mask.",
        metavar="FILE",
    )
    find_origin: bool = option(
        "Only find where the rays of the LiDAR start, from the points alone, and print the line that states it under "
        "lidar: in drive.yaml. It is good to some 20 cm.",
        default=False,
    )
    max_points: int = max_points()


@command(InspectSettings)
def inspect(settings: InspectSettings) -> None:
    """Show what DRIVE contains, and what looks wrong with it. For a rig.yaml, show the drive of each camera.

    Among other things, this finds mirrored clouds, a K for another image size, labels that are shifted against their
    points or images, and frames that share files.
    """
    from semcal_cli.checks.inspection import inspect as look_through
    from semcal_cli.cli.start import after_import
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.drive.document import read_drive
    from semcal_cli.many.rig.rig_document import find_rig

    path, max_points = settings.drive, settings.max_points
    rig = find_rig(path)
    if settings.find_mask is not None or settings.find_origin:
        if rig is not None:
            option = "--find-origin" if settings.find_origin else "--find-mask"
            raise click.UsageError(f"{option}: found a rig, expected the drive of one camera.")
        drive = read_drive(path, max_points)
        if settings.find_mask is not None:
            _write_mask(drive, settings.find_mask)
        else:
            _print_origin(drive)
        return
    drives = {"": read_drive(path, max_points)} if rig is None else rig.read_drives(max_points)
    reports = {}
    with Terminal(quiet=settings.as_json) as terminal:
        for name, drive in drives.items():
            terminal.show(f"inspecting {drive.path}")
            reports[name] = look_through(drive)
    if settings.as_json:
        documents = {name: asdict(report) for name, report in reports.items()}
        click.echo(json.dumps(documents[""] if rig is None else documents, indent=2))
        return
    next_command = (
        after_import(drives[""], is_inspected=True)
        if rig is None
        else shell("calibrate", path, "-o", "results")
    )
    _print(reports, next_command, with_frames=settings.with_frames)


def _write_mask(drive: Drive, path: Path) -> None:
    """Propose a mask of the car's own parts, and write it if there is one."""
    from semcal_cli.cli.output_checks import check_outputs, files_read
    from semcal_cli.files.image_files import write_image
    from semcal_cli.files.output_files import check_suffix
    from semcal_cli.observations.proposed_mask import propose_mask

    check_suffix(path, ".png")
    own = drive.camera.mask
    before = drive.resolve(own) if isinstance(own, str) else None
    check_outputs([file for file in files_read(drive) if file != before], path)
    is_scene = propose_mask(drive)
    share = 1.0 - is_scene.mean()
    if not share:
        what = f"all that reaches into the images of {drive.path} from below or from a side changes"
        click.echo(f"no mask is needed: {what}", err=True)
        return
    write_image((255 * is_scene).astype("uint8"), path)
    use = f"look at it, and use it as `mask: {os.path.relpath(path, drive.root)}` under `camera:`"
    click.echo(f"wrote {path}: {share:.1%} of the image never change; {use}", err=True)


def _print_origin(drive: Drive) -> None:
    """Print where the rays start, as a line of drive.yaml, and how much smoother sweeps look from there."""
    import numpy as np

    from semcal_cli.estimation.search.ray_origin import FARTHEST_M, find_ray_origin, place_text
    from semcal_cli.observations.frame_selection import with_few_frames
    from semcal_cli.observations.reading import read_clouds

    clouds = read_clouds(with_few_frames(drive, NUM_SWEEPS))
    found = find_ray_origin([drive.rays(cloud.points) for cloud in clouds], start_m=-np.array(drive.origin_m))
    if found.is_at_limit:
        raise CalibrationError(
            f"{drive.path}: the rays seem to start more than {FARTHEST_M:.0f} m from where they are taken to start, or "
            "the columns of the files are mixed up; state `origin_m` under `lidar:`, or `point_columns`"
        )
    click.echo(f"origin_m: {place_text(np.array(drive.origin_m) + found.origin_m)}")
    jumps = f"seen from the place that is stated, ranges of neighbouring rays jump {found.ratio:.1f} times as much"
    clear = ", which does not speak against it" if not found.is_clear else ""
    click.echo(f"under `lidar:` in drive.yaml, good to some 20 cm; {jumps}{clear}", err=True)


def _print(reports: Mapping[str, DriveReport], next_command: str | None, *, with_frames: bool) -> None:
    """Print what is suspicious for any camera, the content of each drive, under its name if it has one, and what next.

    The table of frames is as wide as the terminal, or as COLUMNS; without both, rows are not wrapped.
    """
    from semcal_cli.cli.tables import labelled, wrapped
    from semcal_cli.cli.terminal import make_console

    console = make_console(stderr=False)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = WIDE

    def show(label: str, text: str) -> None:
        for line in wrapped(label, text, LABEL_WIDTH):
            console.print(line, markup=False)

    suspicious, too_little = (
        [f"{name}: {line}" if name else line for name, report in reports.items() for line in lines_of(report)]
        for lines_of in (lambda report: (*_grouped(report), *report.suspicions), lambda report: report.advice)
    )
    for line in (*suspicious, *too_little):
        show("warning", line)
    if not suspicious and not too_little:
        console.print("no problems found")
    for name, report in reports.items():
        if name:
            console.print(f"\n[{printable(name)}]", markup=False)
        for label, line in _content(report):
            show(label, line)
        if with_frames:
            console.print(_table(report), soft_wrap=False)
    if next_command is not None:
        console.print(labelled("next", next_command, LABEL_WIDTH), markup=False)


def _grouped(report: DriveReport) -> list[str]:
    """List the findings about frames; equal findings are joined and name their first frames."""
    from semcal_cli.observations.frame_naming import frame_names

    frames_by_finding: dict[str, list[str]] = {}
    names_of_frames = frame_names([frame.points for frame in report.frames])
    for name, frame in zip(names_of_frames, report.frames, strict=True):
        for suspicion in frame.suspicions:
            frames_by_finding.setdefault(suspicion, []).append(name)
    lines = []
    for suspicion, names in frames_by_finding.items():
        more = f" and {len(names) - NUM_NAMED_FRAMES:,} more" if len(names) > NUM_NAMED_FRAMES else ""
        lines.append(f"{', '.join(names[:NUM_NAMED_FRAMES])}{more}: {suspicion}")
    return lines


def _content(report: DriveReport) -> list[tuple[str, str]]:
    """Describe the content of the drive in labelled lines."""
    low, high = report.elevations_deg
    across, down = report.field_of_view_deg
    num_points = sum(frame.num_points for frame in report.frames)
    point_classes = _together(frame.point_classes for frame in report.frames)
    pixel_classes = _together(frame.image_classes for frame in report.frames)
    return [
        ("drive", f"{counted(len(report.frames), 'frame')}, {counted(num_points, 'point')}"),
        (
            "LiDAR",
            f"{report.pattern}; elevation {low:.0f} to {high:.0f} degrees, azimuth {report.azimuths_deg:.0f}; median "
            f"range {report.median_range_m:.1f} m",
        ),
        *([] if report.own_points is None else [("own points", report.own_points)]),
        *([] if report.span_s is None else [("motion", _motion(report, report.span_s))]),
        (
            "camera",
            f"{across:.1f} x {down:.1f} degrees (inspect does not check intrinsics)",
        ),
        *([] if report.hidden_shares is None else [("mask", _hidden(*report.hidden_shares))]),
        *([] if report.image_levels is None else [("images", _levels(*report.image_levels))]),
        *([] if point_classes is None else [("points", _commonest(point_classes))]),
        *([] if pixel_classes is None else [("pixels", _commonest(pixel_classes))]),
        *(("network", line) for line in report.networks),
        *([("both sides", ", ".join(report.shared_classes))] if report.shared_classes else []),
    ]


def _hidden(low: float, high: float) -> str:
    """Describe how much masks hide."""
    shares = [f"{share:.1%}" for share in (low, high)]
    return f"hides {' to '.join(dict.fromkeys(shares))} of the image"


def _levels(black: int, white: int) -> str:
    """Describe the brightness of 16-bit images."""
    return f"16-bit numbers, of which {black:,} is shown as black and {white:,} as white"


def _motion(report: DriveReport, span_s: float) -> str:
    """Describe how long the drive is and how fast it moves."""
    span = f"frames span {span_s:.{1 if span_s < FEW_SECONDS else 0}f} s"
    if report.speeds_m_s is None or report.fastest_turn_deg_s is None:
        return f"{span}; no poses, no twist"
    low, high = report.speeds_m_s
    turns = f"turns up to {report.fastest_turn_deg_s:.0f} degrees per second"
    return f"{span}, at {low:.1f} to {high:.1f} m/s, with {turns}"


def _table(report: DriveReport) -> Table:
    """Make a table with a row for each frame."""
    from rich.table import Table
    from rich.text import Text

    from semcal_cli.observations.frame_naming import frame_names

    frames = report.frames
    columns = {
        "frame": frame_names([frame.points for frame in frames]),
        "points": [f"{frame.num_points:,}" for frame in frames],
        "no return": [f"{frame.num_no_returns:,}" for frame in frames],
        "ignored": [f"{frame.num_points_ignored:,}" for frame in frames],
        "pixels ignored": [f"{frame.num_pixels_ignored:,}" for frame in frames],
        "point classes": [_commonest(frame.point_classes) for frame in frames],
        "pixel classes": [_commonest(frame.image_classes) for frame in frames],
        "gap, s": ["" if frame.gap_s is None else f"{frame.gap_s:.3f}" for frame in frames],
    }
    table = Table(box=None, pad_edge=False)
    for name in columns:
        table.add_column(name, justify="left" if "classes" in name or name == "frame" else "right")
    for cells in zip(*columns.values(), strict=True):
        table.add_row(*(Text(printable(cell)) for cell in cells))  # names are not markup
    return table


def _together(counts: Iterable[Mapping[str, int] | None]) -> Mapping[str, int] | None:
    """Add up the counts of all frames that have labels; None if no frame has."""
    labelled = [by_class for by_class in counts if by_class is not None]
    total: Counter[str] = Counter()
    for by_class in labelled:
        total.update(by_class)
    return total if labelled else None


def _commonest(counts: Mapping[str, int] | None) -> str:
    if counts is None:
        return "no labels"
    names = sorted(counts, key=lambda name: -counts[name])
    more = f" and {len(names) - NUM_NAMED} more" if len(names) > NUM_NAMED else ""
    return ", ".join(names[:NUM_NAMED]) + more
