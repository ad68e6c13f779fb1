"""`semcal base`: the pose of the LiDAR on its vehicle, from the ground and from straight driving."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.options import DriveSettings, result_file
from semcal_cli.cli.parameter_types import FiniteNumber
from semcal_cli.cli.settings import option
from semcal_cli.cli.settings_command import command
from semcal_cli.errors import CalibrationError, counted, shell

if TYPE_CHECKING:
    from semcal_cli.estimation.vehicle.mounting_on_base import VehicleMounting
    from semcal_cli.formats.base_link import BaseDocument

LABEL_WIDTH = 11


@dataclass(frozen=True, kw_only=True)
class BaseSettings(DriveSettings):
    """Settings of `base`."""

    output: Path | None = result_file()
    yaw_deg: float | None = option(
        "Yaw of the LiDAR's x axis on the vehicle, positive to the left of forward, in place of that of straight "
        "driving.",
        minimum=-360.0,
        maximum=360.0,
        metavar="DEG",
    )
    xy_m: tuple[float, float] | None = option(
        "Where the LiDAR is on the vehicle: how far ahead of the origin of base_link, and how far to the left.  "
        "[default: 0 0]",
        nargs=2,
        type=FiniteNumber(),
        metavar="X Y",
    )
    base_frame: str | None = option("Name of the vehicle's frame.  [default: base_link]", metavar="NAME")


@command(BaseSettings)
def base(settings: BaseSettings) -> None:
    """Estimate the pose of the LiDAR on its vehicle, T_base_lidar, from the sweeps of DRIVE.

    The ground under the vehicle shows roll, pitch and height of the LiDAR, and straight driving shows its yaw, if DRIVE
    states its motion. No drive shows where on the vehicle base_link is: state that by --xy-m. base_link has x forward,
    y left and z up, and its origin on the ground. `semcal convert --base` uses the result.
    """
    from semcal_cli.cli.output_checks import check_outputs, files_read
    from semcal_cli.drive.document import read_drive
    from semcal_cli.estimation.vehicle.mounting_on_base import estimate_mounting
    from semcal_cli.files.documents import document_text, output_format
    from semcal_cli.files.output_files import write_text

    drive = read_drive(settings.drive, settings.max_points)
    check_outputs(files_read(drive), settings.output)
    form = "yaml" if settings.output is None else output_format(settings.output)
    with settings.terminal() as terminal:
        terminal.show("finding the ground")
        mounting = estimate_mounting(drive)
    terminal.print(*_rows(mounting, settings))
    if mounting.travel is None and settings.yaw_deg is None:
        raise CalibrationError(
            f"{drive.path}: yaw is not known, because {mounting.no_yaw}; add --yaw-deg with that of the LiDAR's x "
            "axis, such as 0 if it points forward"
        )
    lidar = None if drive.frame_ids is None else drive.frame_ids.lidar
    text = document_text(
        _document(mounting, settings, lidar).model_dump(mode="json", exclude_none=True), form
    )
    if settings.output is None:
        click.echo(text, nl=False)
        return
    write_text(text, settings.output)
    terminal.print(f"wrote {settings.output}")
    use = shell("convert", "calibration.yaml", "--to", "urdf", "--base", settings.output, "-o", "camera.urdf")
    terminal.print(f"next: {use}")


def _document(mounting: VehicleMounting, settings: BaseSettings, lidar: str | None) -> BaseDocument:
    from semcal_cli.files.validation import validate
    from semcal_cli.formats.base_link import BASE_LINK, BaseDocument
    from semcal_cli.geometry.poses import rpy

    yaw_rad, half_width_rad = _yaw(mounting, settings)
    T = mounting.T_base_lidar(yaw_rad, *(settings.xy_m or (0.0, 0.0)))
    widths_rad = {
        "roll_deg": mounting.roll_rad.half_width_95,
        "pitch_deg": mounting.pitch_rad.half_width_95,
        "yaw_deg": half_width_rad,
    }
    widths = {name: None if width is None else math.degrees(width) for name, width in widths_rad.items()}
    document = {
        "semcal_base": 1,
        "T_base_lidar": T.tolist(),
        "base_frame": BASE_LINK if settings.base_frame is None else settings.base_frame,
        "lidar_frame": lidar,
        "rpy_deg": [math.degrees(angle) for angle in rpy(T)],
        "half_width_95": widths | {"height_m": mounting.height_m.half_width_95},
        "yaw_from": "motion" if settings.yaw_deg is None else "option",
        "num_frames": mounting.num_frames,
        "num_scenes": mounting.num_scenes,
    }
    return validate(BaseDocument, document, Path("--base-frame, --xy-m"))


def _yaw(mounting: VehicleMounting, settings: BaseSettings) -> tuple[float, float | None]:
    """Return yaw and the half width of its interval, radians: that of the user comes first."""
    if settings.yaw_deg is not None:
        return math.radians(settings.yaw_deg), None
    assert mounting.travel is not None
    return mounting.travel.yaw_rad


def _rows(mounting: VehicleMounting, settings: BaseSettings) -> list[str]:
    """Describe what was found, with intervals, and what stays the user's."""
    from semcal_cli.cli.tables import wrapped

    frames = counted(mounting.num_frames, "frame")
    if mounting.num_frames < mounting.num_tried:
        frames = f"{mounting.num_frames} of {counted(mounting.num_tried, 'frame')}"
    scenes = counted(mounting.num_scenes, "scene")
    rows = [
        ("ground", f"in {frames} of {scenes}"),
        ("roll", _degrees(*mounting.roll_rad)),
        ("pitch", _degrees(*mounting.pitch_rad)),
        ("height", _centimetres(*mounting.height_m)),
        ("yaw", _yaw_words(mounting, settings)),
        ("x, y", _place_words(settings)),
    ]
    if mounting.num_scenes == 1:
        note = "one scene has no scatter: a drive over more ground gives intervals"
    else:
        note = (
            "intervals (95 %) are the scatter between scenes; the load of the vehicle and roads that all fall to one "
            "side are not in them"
        )
    rows.append(("note", note))
    return [line for label, text in rows for line in wrapped(label, text, LABEL_WIDTH)]


def _degrees(value_rad: float, half_width_rad: float | None) -> str:
    width = "interval not known" if half_width_rad is None else f"±{_figure(math.degrees(half_width_rad))}"
    value_deg = math.degrees(value_rad)
    if half_width_rad is None:
        return f"{value_deg:.2f} degrees, {width}"
    return f"{value_deg:.2f} {width} degrees"


def _centimetres(value_m: float, half_width_m: float | None) -> str:
    if half_width_m is None:
        return f"{value_m:.3f} m above the ground, interval not known"
    return f"{value_m:.3f} ±{_figure(half_width_m)} m above the ground"


def _figure(width: float) -> str:
    return f"{width:.2f}" if width >= 0.1 else f"{width:.3f}"


def _yaw_words(mounting: VehicleMounting, settings: BaseSettings) -> str:
    travel = mounting.travel
    if travel is None:
        words = mounting.no_yaw
    elif travel.length_m is None:
        words = f"{_degrees(*travel.yaw_rad)}, by the twist of the drive"
    else:
        by = f"{counted(travel.num_intervals, 'interval')} of straight driving over {travel.length_m:,.0f} m"
        words = f"{_degrees(*travel.yaw_rad)}, by {by}"
        if travel.share_backward > 0.0:
            words += f", {travel.share_backward:.0%} of them backward"
    if settings.yaw_deg is None:
        return f"not known: {words}" if travel is None else words
    beside = words if travel is None else f"the drive shows {words}"
    return f"{settings.yaw_deg:g} degrees, as you state; {beside}"


def _place_words(settings: BaseSettings) -> str:
    if settings.xy_m is None:
        return (
            "0, 0 m: no drive shows them; state where the LiDAR is ahead and left of base_link by --xy-m X Y"
        )
    return "{:g}, {:g} m, as you state".format(*settings.xy_m)
