"""`semcal synth`: a synthetic drive with a known transform."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import click

from semcal_cli.cli.options import ThreadSettings
from semcal_cli.cli.settings import argument, made_of, option, setting_of
from semcal_cli.cli.settings_command import command
from semcal_cli.config import CalibrationConfig
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.errors import InputError
from semcal_cli.events import Progress


@dataclass(frozen=True, kw_only=True)
class SynthSettings(SynthConfig, ThreadSettings):
    """Settings of `synth`, including all settings of a synthetic drive."""

    out: Path = argument()
    num_drives: int | None = option(
        "Write N drives of one rig, OUT/000000 and so on, each with its own seed.",
        "--drives",
        minimum=1,
        maximum=999_999,
    )
    num_cameras: int | None = option(
        "Mount N cameras evenly around the LiDAR, the first at --camera-azimuth-deg or straight ahead. Writes "
        "OUT/rig.yaml and one drive per camera, OUT/camera_0 and so on, which share their clouds.",
        "--cameras",
        minimum=2,
        maximum=99,
    )
    num_lidars: int | None = option(
        "Mount N LiDARs, each camera with each of them as a drive of its own, such as OUT/camera_0_on_lidar_1. Needs "
        "--cameras.",
        "--lidars",
        minimum=2,
        maximum=9,
    )
    seed: int = setting_of(CalibrationConfig, "seed")
    force: bool = option("Write into a folder that is not empty; other files in it stay.", default=False)

    def drives(self) -> list[tuple[SynthConfig, Path]]:
        """List the drives to write, with their folders.

        Raises:
            click.UsageError: settings contradict each other.
        """
        from semcal_cli.synthetic.street_motion import check_motion

        config = made_of(SynthConfig, self)
        if config.fov_down_deg >= config.fov_up_deg:
            needed = f"needed less than --fov-up-deg, {config.fov_up_deg}"
            raise click.UsageError(f"--fov-down-deg: found {config.fov_down_deg}, {needed}")
        if self.num_lidars is not None and self.num_cameras is None:
            raise click.UsageError("--lidars: found no --cameras, whose drives tie the LiDARs.")
        try:
            check_motion(config)
        except InputError as error:
            raise click.UsageError(str(error)) from None
        if self.num_drives is None:
            return [(config, self.out)]
        rig_seed = config.seed if config.rig_seed is None else config.rig_seed
        return [
            (replace(config, seed=config.seed + number, rig_seed=rig_seed), self.out / f"{number:06d}")
            for number in range(self.num_drives)
        ]


@command(SynthSettings)
def synth(settings: SynthSettings) -> None:
    """Write a synthetic drive, with labels, images and its true T_camera_lidar, to the folder OUT.

    The seed determines the streets and everything about the mounting that no option sets. The 20 classes have CARLA's
    names and ids. The sensors see true parallax.
    """
    from semcal_cli.synthetic.synthesis import synthesize, synthesize_rig
    from semcal_cli.threads import set_num_threads

    drives, num_cameras, num_lidars = settings.drives(), settings.num_cameras, settings.num_lidars
    force = settings.force
    set_num_threads(settings.threads)
    start = perf_counter()
    with settings.terminal() as terminal:
        for config, folder in drives:
            total = (num_cameras or 1) * (num_lidars or 1) * config.num_frames

            def tell(done: int, doing: str = f"rendering {folder}", total: int = total) -> None:
                terminal.on_event(Progress(doing, done, total))

            if num_cameras is None:
                summary = synthesize(config, folder, tell, force=force)
            else:
                summary = synthesize_rig(
                    config, num_cameras, folder, tell, force=force, num_lidars=num_lidars or 1
                )
            terminal.print(f"wrote {folder}")
    prefix = "" if settings.num_drives is None else "last drive: "
    terminal.print(
        f"{prefix}{summary.num_frames:,} frames, {summary.num_points:,} points, {summary.num_classes} classes in "
        f"{perf_counter() - start:.1f} s",
    )
