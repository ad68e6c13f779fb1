"""`semcal demo`: calibration of a synthetic drive without an initial guess, compared with the truth."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from semcal_cli.cli.options import RunSettings, ThreadSettings
from semcal_cli.cli.settings import argument, command, setting_of
from semcal_cli.config import CalibrationConfig
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.errors import described, is_installed

if TYPE_CHECKING:
    from semcal_cli.drive.loading import LoadedDrive
    from semcal_cli.geometry.poses import Pose
    from semcal_cli.result.calibration import Calibration

NUM_FRAMES = 8
OFF_DEG, OFF_M = 2.0, 0.1
"""How far the camera is off on the left half of the picture, which shows what a wrong transform looks like."""


@dataclass(frozen=True, kw_only=True)
class DemoSettings(ThreadSettings):
    """What the options of `demo` say."""

    out: Path = argument(Path("semcal_demo"))
    seed: int = setting_of(CalibrationConfig, "seed")


@command(DemoSettings)
def demo(settings: DemoSettings) -> None:
    """Calibrate a synthetic street drive from nothing, and compare with the truth.

    Makes the folder OUT (semcal_demo) with the drive, its calibration.yaml, and report.html and overlay.png to look at.
    Running it again overwrites them. Where PyTorch is installed, the error of the paper's MINE is told, too.
    """
    import numpy as np

    from semcal_cli.cli.outputs import Outputs, loaded_drive
    from semcal_cli.cli.tables import error_lines
    from semcal_cli.cli.terminal import make_console
    from semcal_cli.formats import read_transform
    from semcal_cli.geometry.poses import compare_poses
    from semcal_cli.geometry.twists import displaced
    from semcal_cli.pipeline import calibrate
    from semcal_cli.report.overlay import Overlays
    from semcal_cli.synthetic.synthesis import synthesize
    from semcal_cli.threads import set_num_threads

    out, seed, quiet = settings.out, settings.seed, settings.quiet
    console = make_console(quiet)
    set_num_threads(settings.threads)
    drive, result = out / "drive", out / "calibration.yaml"
    page, picture = out / "report.html", out / "overlay.png"
    console.print(f"making {NUM_FRAMES} frames of a synthetic street in {drive}")
    synthesize(SynthConfig(num_frames=NUM_FRAMES, seed=seed), drive, force=True)
    config, outputs = CalibrationConfig(seed), Outputs(result, page=page, has_next_steps=False)
    run = RunSettings(drive=drive, threads=settings.threads, quiet=quiet)
    with loaded_drive(run, config, outputs) as (data, terminal):
        calibration = calibrate(data, config, relative_to=outputs.folder, on_event=terminal.on_event)
    off = displaced(calibration.pose, OFF_DEG, OFF_M, np.random.default_rng(seed))
    poses = {f"a camera {OFF_DEG:g} degrees off": off, "found from nothing": calibration.pose}
    Overlays(data.drive, data.observations, poses, "agreement").write(0, picture)
    code = outputs.write(calibration, terminal, settings.threads, data.drive)
    console.print("\nerror against the truth, which the calibration never saw:")
    T_true = read_transform(drive)
    for line in error_lines(compare_poses(calibration.pose, T_true)):
        console.print(line)
    if not quiet:
        console.print(_by_mine(data, calibration, T_true), markup=False)
    console.print(f"look at {page} and {picture}")
    sys.exit(code)


def _by_mine(data: LoadedDrive, calibration: Calibration, T_true: Pose) -> str:
    """Refine from the same start by MINE, the paper's estimator, and describe its error and time in a line."""
    if not is_installed("torch"):
        return f"by MINE          left out, needs {described('mine')}"
    import numpy as np

    from semcal_cli.config import RefinementConfig
    from semcal_cli.geometry.poses import compare_poses
    from semcal_cli.initialization.initial_pose import InitialPose
    from semcal_cli.pipeline import refine_and_polish, start_at

    start, seed = perf_counter(), calibration.settings.seed
    initial = start_at(data, InitialPose(np.array(calibration.stages["initial"].T_camera_lidar), "initial"))
    stages = refine_and_polish(data, initial, RefinementConfig("mine"), seed)
    error = compare_poses(stages.T_camera_lidar, T_true)
    off = f"{error.rotation_deg:.4f} deg and {error.camera_center_cm:.3f} cm off"
    return f"by MINE          {off}, in {perf_counter() - start:.1f} s: the paper's estimator, from the same start"
