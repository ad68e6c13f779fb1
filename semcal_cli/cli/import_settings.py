"""What all imports of `semcal import` share: their options, and what they print about the drive that they wrote."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.import_values import OwnPointsOfLidar, SpinOfLidar
from semcal_cli.cli.options import FrameSlice, QuietSettings
from semcal_cli.cli.parameter_types import FiniteRange
from semcal_cli.cli.settings import made_of, option
from semcal_cli.config.point_files import MAX_ORIGIN_M
from semcal_cli.errors import check_installed, counted

if TYPE_CHECKING:
    from semcal_cli.importing.drive_folder import WrittenDrive
    from semcal_cli.importing.recording import Recording


def max_gap(default: float | None = None, **maximum: float) -> Any:
    """Declare the option of the largest time difference between a sweep and its image."""
    text = "Largest time difference between a sweep and its image, in seconds."
    return option(text, default=default, above=0.0, metavar="S", **maximum)


def resized() -> Any:
    """Declare the option that converts K to the size of the images."""
    text = "Images were resized after the camera was calibrated: convert K to their size, of the same aspect."
    return option(text, "--resized", default=False)


def lidar_spin() -> Any:
    """Declare the option of how the LiDAR turns."""
    return option(
        "How a LiDAR turns whose points have no times: turns per second, cw or ccw as seen from above, the azimuth "
        "at which sweeps begin, and which moment of a sweep its stamp states: start, middle or end "
        "(middle if not given).",
        "--spin",
        type=SpinOfLidar(),
        metavar="HZ:cw|ccw:SEAM_DEG[:STAMP]",
    )


def ray_origin() -> Any:
    """Declare the option of where the rays of the LiDAR start."""
    return option(
        "Where the rays of the LiDAR start, in metres, where points are in another frame, such as a vehicle's; "
        "`semcal inspect --find-origin` finds it from the points.",
        "--origin",
        type=FiniteRange(-MAX_ORIGIN_M, MAX_ORIGIN_M),
        nargs=3,
        metavar="X Y Z",
    )


def lidar_own_points() -> Any:
    """Declare the option of which points are the LiDAR's own."""
    return option(
        "The LiDAR's own points, where clouds hold those of several LiDARs: a field of the files, and its value or its "
        "smallest and largest value there, such as ring=0:31 or lidar=2. Others are not read.",
        "--own-points",
        type=OwnPointsOfLidar(),
        metavar="FIELD=FIRST[:LAST]",
    )


def stated_lidar(
    spin: dict[str, Any] | None,
    origin_m: tuple[float, ...] | None,
    own_points: dict[str, Any] | None = None,
) -> dict[str, Any] | None:
    """Make the `lidar:` block of a drive of what these options state; None if they state nothing."""
    origin = None if origin_m is None else list(origin_m)
    keys = {"origin_m": origin, "own_points": own_points, "spin": spin}
    return {key: value for key, value in keys.items() if value is not None} or None


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
    max_gap_s: float | None = max_gap()
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
        from semcal_cli.importing.choice import FrameChoice
        from semcal_cli.importing.drive_folder import write_drive

        options = made_of(FrameChoice, self, frames=self.frames or slice(None), **others)
        written = write_drive(recording, options, sweeps or self.output, force=self.force)
        if not self.quiet:
            copies = f", {counted(written.num_converted, 'cloud')} converted" if written.num_converted else ""
            tell_written(written, copies, is_last=is_last and sweeps is None, read=read)
        return written


def sweeps_drive(output: Path) -> Path:
    """Locate the drive of all sweeps, of which an accumulated one is made at `output`."""
    from semcal_cli.drive.document import output_drive_file

    path = output_drive_file(output)
    return path.parent / "sweeps" / path.name


def tell_written(
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
    from semcal_cli.cli.start import after_import
    from semcal_cli.cli.tables import wrapped

    remarks = (line for remark in written.remarks for line in wrapped("note:", remark, indent=6))
    wrote = f"wrote {written.path}" if read is None else f"read {read}"
    wrote += f": {counted(written.num_frames, 'frame')}{details}"
    next_command = (f"next: {after_import(written.drive)}",) if is_last else ()
    for line in (wrote, *lines, *remarks, *next_command):
        click.echo(line, err=True)
