"""`semcal accumulate`: sweeps that follow one another as one dense cloud for each image."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from semcal_cli.cli.options import DriveSettings, QuietSettings
from semcal_cli.cli.rules import given
from semcal_cli.cli.settings import option
from semcal_cli.cli.settings_command import command
from semcal_cli.errors import counted

if TYPE_CHECKING:
    from semcal_cli.drive.document import Drive

DEFAULT_SECONDS = 1.0
MAX_SWEEPS, MAX_SECONDS = 100_000, 3600.0
"""Largest numbers of sweeps and of seconds that become one cloud."""
MAX_REASONS = 3
"""Number of reasons for which frames were left out that are printed."""


@dataclass(frozen=True, kw_only=True)
class AccumulateSettings(DriveSettings):
    """Settings of `accumulate`."""

    rules = [given("--seconds").excludes("--sweeps")]
    output: Path = option(
        "Folder for the new drive, or its drive.yaml.", "-o", "--output", required=True, metavar="DRIVE"
    )
    seconds: float | None = option(
        f"Put the sweeps of S seconds together; {DEFAULT_SECONDS:g} if neither this nor --sweeps is given.",
        above=0.0,
        maximum=MAX_SECONDS,
        metavar="S",
    )
    num_sweeps: int | None = option(
        "Put N sweeps together.", "--sweeps", minimum=2, maximum=MAX_SWEEPS, metavar="N"
    )
    force: bool = option("Replace a drive.yaml, even of other data.", default=False)


@command(AccumulateSettings)
def accumulate(settings: AccumulateSettings) -> None:
    """Put sweeps of DRIVE that follow one another together: a dense cloud for each image, from a sparse LiDAR.

    The frames of DRIVE are its sweeps, with an image or without. If the rig stands, sweeps stay as they are; if it
    moves, the poses or the twist of DRIVE move them. Either way their surfaces must agree. Objects that move are left
    out, and so are points that the LiDAR would not see from where it is at the time of the frame.
    """
    from semcal_cli.drive.document import read_drive

    is_default = settings.seconds is None and settings.num_sweeps is None
    accumulate_into(
        settings.output,
        read_drive(settings.drive, settings.max_points),
        settings,
        seconds=DEFAULT_SECONDS if is_default else settings.seconds,
        num_sweeps=settings.num_sweeps,
        force=settings.force,
    )


def accumulate_into(
    output: Path, drive: Drive, settings: QuietSettings, *, force: bool, **length: Any
) -> None:
    """Write the accumulated drive of a drive, and print how well its sweeps fit, and which command comes next.

    Args:
        output: Folder of the new drive, or its drive.yaml.
        drive: The drive of all sweeps.
        settings: What to print.
        force: Whether a drive.yaml of other data is replaced.
        length: How many sweeps become one cloud: see `accumulate_drive`.
    """
    from semcal_cli.cli.start import after_import
    from semcal_cli.cli.tables import wrapped
    from semcal_cli.importing.accumulated_drive import accumulate_drive

    with settings.terminal() as terminal:
        done = accumulate_drive(drive, output, terminal.on_event, force=force, **length)
    num_sweeps, num_points = median(done.num_sweeps), median(done.num_points)
    terminal.print(
        f"wrote {done.drive.path}: {counted(len(done.num_points), 'frame')}, each of {num_sweeps:g} sweeps",
        f"a frame has {num_points:,.0f} points; its sweeps fit to {100.0 * done.distance_m:.1f} cm (medians)",
        f"left out {done.share_moving:.1%} of the points, which move, and {done.share_hidden:.1%}, which are hidden",
    )
    if done.num_sharing:
        sharing = f"{counted(done.num_sharing, 'more image')} of the same sweeps: each sweep is in one cloud"
        terminal.print(*wrapped("note:", f"left out {sharing}", indent=6))
    rows = done.left_out.most_common()
    for reason, count in rows[:MAX_REASONS]:
        terminal.print(*wrapped("note:", f"left out {counted(count, 'frame')}: {reason}", indent=6))
    if others := sum(count for _, count in rows[MAX_REASONS:]):
        terminal.print(f"note: left out {counted(others, 'frame')} for reasons like these")
    terminal.print(f"next: {after_import(done.drive)}")
