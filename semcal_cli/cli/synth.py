"""`semcal synth`: a synthetic drive with a known transform."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, TypeAlias, get_args

import click

from semcal_cli.cli.options import PATH, number_option, quiet_option, seed_option, threads_option
from semcal_cli.config import (
    MAX_SEED,
    SYNTH_MAX_BASELINE_M,
    SYNTH_MAX_DELAY_MS,
    SYNTH_MAX_READOUT_MS,
    Lens,
    Ontology,
    Pattern,
    ReadoutDirection,
    RigMotion,
    SynthConfig,
)
from semcal_cli.errors import InputError

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

Decorator: TypeAlias = Callable[[Callable[..., Any]], Callable[..., Any]]


class SettingOption(click.Option):
    """An option for one field of `SynthConfig`, with the default of the field."""

    def __init__(self, *args: Any, section: str, **kwargs: Any) -> None:
        if isinstance(kwargs.get("type"), click.IntRange | click.FloatRange):
            kwargs["metavar"] = "N"
        super().__init__(*args, **kwargs)
        self.section = section
        self.default = getattr(SynthConfig, str(self.name))
        self.show_default = self.default is not None


class SectionedCommand(click.Command):
    """A command whose help lists its settings by section."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options that every command has at the end."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None and isinstance(parameter, click.Option):
                sections.setdefault(getattr(parameter, "section", "Options"), []).append(record)
        for title in sorted(sections, key="Options".__eq__):
            with formatter.section(title):
                formatter.write_dl(sections[title])


def _section(title: str) -> Callable[..., Decorator]:
    """Make a decorator like `click.option` for the settings of one section."""
    return partial(click.option, cls=SettingOption, section=title)


drive_option, lidar_option, camera_option = _section("Drive"), _section("LiDAR"), _section("Camera")
mounting_option, label_option = _section("Mounting"), _section("Labels")
motion_option = _section("Motion")

ANGLE = click.FloatRange(-180.0, 180.0)
ELEVATION = click.FloatRange(-90.0, 90.0)
LENGTH = click.FloatRange(min=0.0)
SHARE = click.FloatRange(0.0, 1.0, max_open=True)


@click.command(cls=SectionedCommand)
@click.argument("out", type=PATH)
@drive_option("--frames", "num_frames", type=click.IntRange(1, 999_999), help="Frames, each another street.")
@lidar_option(
    "--pattern",
    type=click.Choice(get_args(Pattern)),
    help="A spinning LiDAR's grid, or a rosette all around that is no grid.",
)
@lidar_option("--channels", type=click.IntRange(1, 512), help="Beams, evenly spaced in elevation.")
@lidar_option(
    "--columns",
    type=click.IntRange(1, 65_536),
    help="Firings a turn. A rosette has channels x columns rays a frame.",
)
@lidar_option("--fov-up-deg", type=ELEVATION, help="Elevation of the highest ray.")
@lidar_option("--fov-down-deg", type=ELEVATION, help="Elevation of the lowest ray.")
@lidar_option("--range-noise-m", type=LENGTH, help="Standard deviation of a range.")
@lidar_option("--dropout", type=SHARE, help="Share of the returns that are lost.")
@lidar_option("--max-range-m", type=LENGTH, help="Largest range of a return.")
@lidar_option(
    "--lidar-tilt-deg", type=ELEVATION, help="Downward tilt of the LiDAR's x axis, and of the camera with it."
)
@camera_option("--width", type=click.IntRange(16, 8192), help="Columns of the image.")
@camera_option("--height", type=click.IntRange(16, 8192), help="Rows of the image.")
@camera_option(
    "--lens",
    type=click.Choice(get_args(Lens)),
    help="standard: 90 degrees without distortion; narrow: 35 degrees, plumb_bob; "
    "wide: 100 degrees, rational_polynomial; fisheye: 200 degrees; omnidirectional: 190 degrees, xi 1.2; "
    "equirectangular: all round.",
)
@camera_option(
    "--hfov-deg", type=click.FloatRange(5.0, 360.0), help="Horizontal field of view, if not that of the lens."
)
@mounting_option(
    "--camera-azimuth-deg",
    type=ANGLE,
    help="Azimuth of the camera: 0 along the LiDAR's x axis, positive to the left. "
    "Any direction if not given.",
)
@mounting_option(
    "--camera-pitch-deg",
    type=ELEVATION,
    help="Upward pitch of the camera. Within 8 degrees of level if not given.",
)
@mounting_option(
    "--camera-roll-deg",
    type=ANGLE,
    help="Roll of the camera to its right. Within 4 degrees of upright if not given.",
)
@mounting_option(
    "--baseline-m",
    type=click.FloatRange(0.0, SYNTH_MAX_BASELINE_M, max_open=True),
    help="Distance between the two sensors. At least 0.1 if not given.",
)
@mounting_option(
    "--rig-seed",
    type=click.IntRange(0, MAX_SEED),
    help="Draw what these options leave open from this seed: drives of one rig share it.",
)
@mounting_option(
    "--max-baseline-m",
    type=click.FloatRange(0.2, SYNTH_MAX_BASELINE_M),
    help="Largest distance that is drawn.",
)
@label_option("--label-noise", type=SHARE, help="Share of wrong labels, on both sides.")
@label_option(
    "--ontology",
    type=click.Choice(get_args(Ontology)),
    help="Label points and images with the same named ids, or with ids that have nothing in common.",
)
@motion_option(
    "--motion",
    type=click.Choice(get_args(RigMotion)),
    help="steady: straight on at 12 m/s in every frame; mixed: in each frame another speed up to 20 m/s, and another "
    "turn up to 0.4 rad/s. Points and lines of pictures are measured from where the rig is then.",
)
@motion_option(
    "--delay-ms",
    type=click.FloatRange(-SYNTH_MAX_DELAY_MS, SYNTH_MAX_DELAY_MS),
    help="Take the pictures this much later than image_stamp says, which drive.yaml does not tell; negative: earlier.",
)
@motion_option(
    "--readout-ms",
    type=click.FloatRange(0.0, SYNTH_MAX_READOUT_MS),
    help="Time that a rolling shutter takes from the first line of a picture to the last; 0: a global shutter.",
)
@motion_option(
    "--readout-direction",
    type=click.Choice(get_args(ReadoutDirection)),
    help="Way in which a rolling shutter reads the lines; down begins with the uppermost row.",
)
@number_option(
    "--drives",
    "num_drives",
    most=999_999,
    help="Write N drives of one rig, OUT/000000 and so on, each of a seed of its own.",
)
@number_option(
    "--cameras",
    "num_cameras",
    least=2,
    most=99,
    help="Mount N cameras evenly around the LiDAR, the first at --camera-azimuth-deg or ahead: a drive each, "
    "OUT/camera_0 and so on, which share their clouds, and OUT/rig.yaml.",
)
@seed_option
@threads_option
@click.option("--force", is_flag=True, help="Write into a folder that is not empty; other files in it stay.")
@quiet_option
def synth(
    out: Path,
    num_drives: int | None,
    num_cameras: int | None,
    threads: int | None,
    force: bool,
    quiet: bool,
    **settings: Any,
) -> None:
    """Write a synthetic drive, with labels, pictures and its true T_camera_lidar, to the folder OUT.

    Streets are drawn from the seed, with 20 classes under CARLA's names and ids. Both sensors see true
    parallax. What the mounting options leave open is drawn from the seed, too.
    """
    config = SynthConfig(**settings)
    if config.fov_down_deg >= config.fov_up_deg:
        raise click.UsageError(
            f"--fov-down-deg: found {config.fov_down_deg}, needed less than --fov-up-deg, {config.fov_up_deg}"
        )
    from rich.console import Console
    from rich.progress import Progress

    from semcal_cli.synthetic.motion import check_motion
    from semcal_cli.synthetic.synthesis import synthesize, synthesize_rig
    from semcal_cli.threads import set_num_threads

    try:
        check_motion(config)
    except InputError as error:
        raise click.UsageError(str(error)) from None
    set_num_threads(threads)
    start = perf_counter()
    shown = not quiet and sys.stderr.isatty()
    with Progress(console=Console(stderr=True), transient=True, disable=not shown) as bar:
        for one, folder in _drives(config, out, num_drives):
            task = bar.add_task(f"rendering {folder}", total=(num_cameras or 1) * one.num_frames)
            if num_cameras is None:
                summary = synthesize(one, folder, _teller(bar, task), force=force)
            else:
                summary = synthesize_rig(one, num_cameras, folder, _teller(bar, task), force=force)
            bar.remove_task(task)
            if not quiet:
                click.echo(f"wrote {folder}", err=True)
    if not quiet:
        each = "" if num_drives is None else "of the last drive: "
        click.echo(
            f"{each}{summary.num_frames:,} frames, {summary.num_points:,} points, {summary.num_classes} classes in "
            f"{perf_counter() - start:.1f} s",
            err=True,
        )


def _teller(bar: Progress, task: TaskID) -> Callable[[int], None]:
    return lambda done: bar.update(task, completed=done)


def _drives(config: SynthConfig, out: Path, num_drives: int | None) -> list[tuple[SynthConfig, Path]]:
    """List the drives to write, with their folders."""
    if num_drives is None:
        return [(config, out)]
    rig_seed = config.seed if config.rig_seed is None else config.rig_seed
    return [
        (replace(config, seed=config.seed + number, rig_seed=rig_seed), out / f"{number:06d}")
        for number in range(num_drives)
    ]
