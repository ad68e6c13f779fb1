"""`semcal synth`: a synthetic drive with a known transform."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.options import (
    PATH,
    Command,
    number_option,
    quiet_option,
    seed_option,
    setting_option,
    threads_option,
    with_options,
)
from semcal_cli.config.setting import settings_of
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.errors import InputError

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

SETTINGS = settings_of(SynthConfig)


class SectionedCommand(click.Command):
    """A command whose help lists its settings by section."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options that every command has at the end."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None and isinstance(parameter, click.Option):
                known = SETTINGS.get(str(parameter.name))
                sections.setdefault("Options" if known is None else known.section, []).append(record)
        for title in sorted(sections, key="Options".__eq__):
            with formatter.section(title):
                formatter.write_dl(sections[title])


def setting_options(command: Command) -> Command:
    """Add an option for each setting of a synthetic drive."""
    return with_options(command, [setting_option(SynthConfig, name) for name in SETTINGS])


@click.command(cls=SectionedCommand)
@click.argument("out", type=PATH)
@setting_options
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
