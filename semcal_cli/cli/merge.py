"""`semcal merge`: several drives of one rig as one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click

from semcal_cli.cli.options import QuietSettings, max_points
from semcal_cli.cli.settings import argument, option
from semcal_cli.cli.settings_command import command


@dataclass(frozen=True, kw_only=True)
class MergeSettings(QuietSettings):
    """Settings of `merge`."""

    drives: tuple[Path, ...] = argument(metavar="DRIVE...")
    output: Path = option(
        "Folder for the merged drive, or its drive.yaml.", "-o", "--output", required=True, metavar="DRIVE"
    )
    force: bool = option("Replace a drive.yaml, even of other data.", default=False)
    max_points: int = max_points()


@command(MergeSettings)
def merge(settings: MergeSettings) -> None:
    """Make one drive of several DRIVEs of one rig, such as sequences of one day.

    The frames of all drives, in the given order, become those of the new drive, which names their files where they
    are. The drives must have the same camera and classes. Poses are joined. Drives whose clocks begin anew are placed
    one after another.
    """
    from semcal_cli.cli.tables import wrapped
    from semcal_cli.drive.document import read_drive
    from semcal_cli.errors import counted
    from semcal_cli.importing.merged_drive import merge_drives

    drives = [read_drive(path, settings.max_points) for path in settings.drives]
    merged = merge_drives(drives, settings.output, force=settings.force)
    if settings.quiet:
        return
    notes = (line for remark in merged.remarks for line in wrapped("note:", remark, indent=6))
    num_frames, num_drives = counted(merged.num_frames, "frame"), counted(len(drives), "drive")
    for line in (f"wrote {merged.path}: {num_frames} of {num_drives}", *notes):
        click.echo(line, err=True)
