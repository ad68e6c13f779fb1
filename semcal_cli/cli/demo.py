"""`semcal demo`: the whole calibration of a synthetic drive or of KITTI, compared with the known transform."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from semcal_cli.cli.options import RunSettings, ThreadSettings
from semcal_cli.cli.settings import argument, option, setting_of
from semcal_cli.cli.settings_command import command
from semcal_cli.config import CalibrationConfig
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.errors import InputError, is_installed

if TYPE_CHECKING:
    from semcal_cli.geometry.arrays import Pose
    from semcal_cli.importing.recording import Request
    from semcal_cli.observations.loading import LoadedDrive
    from semcal_cli.result.calibration_document import CalibrationDocument

NUM_FRAMES, NUM_REAL_FRAMES = 8, 20
OFF_DEG, OFF_M = 2.0, 0.1
"""How far off the camera is in the left half of the image, which shows what a wrong transform looks like."""
START_DEG, START_M = 2.0, 0.2
"""How far off a real drive starts: edges alone need to know the mounting to 5 degrees and 0.3 m."""


@dataclass(frozen=True, kw_only=True)
class DemoSettings(ThreadSettings):
    """Settings of `demo`."""

    out: Path = argument(Path("semcal_demo"))
    real: Path | None = option(
        "Calibrate your copy of KITTI object or KITTI raw in this folder instead, from edges, without labels.",
        metavar="FOLDER",
    )
    seed: int = setting_of(CalibrationConfig, "seed")


@command(DemoSettings)
def demo(settings: DemoSettings) -> None:
    """Calibrate a synthetic street drive without an initial guess, and compare the result with the truth.

    Writes the drive, calibration.yaml, report.html and overlay.png to the folder OUT (semcal_demo). Running it again
    overwrites them. If PyTorch is installed, the error of the paper's MINE is printed, too.

    With --real, the drive is from KITTI. Its calibration starts 2 degrees and 0.2 m from the published transform, and
    is compared with that.
    """
    import numpy as np

    from semcal_cli.cli.outputs import Outputs, loaded_drive
    from semcal_cli.cli.tables import error_lines
    from semcal_cli.cli.terminal import make_console
    from semcal_cli.estimation.search.initial_pose import InitialPose
    from semcal_cli.formats import read_transform
    from semcal_cli.geometry.poses import compare_poses
    from semcal_cli.geometry.twists import displace
    from semcal_cli.pipeline import calibrate
    from semcal_cli.report.overlays import Overlays
    from semcal_cli.threads import set_num_threads

    out, seed, is_real = settings.out, settings.seed, settings.real is not None
    console = make_console(settings.quiet)
    set_num_threads(settings.threads)
    drive, page, image = out / "drive", out / "report.html", out / "overlay.png"
    console.print(_make(settings, drive), markup=False)
    T_true, rng = read_transform(drive), np.random.default_rng(seed)
    start = InitialPose(displace(T_true, START_DEG, START_M, rng), "a rough start") if is_real else None
    config = CalibrationConfig(seed, ("edges",)) if is_real else CalibrationConfig(seed)
    outputs = Outputs(out / "calibration.yaml", page=page, has_next_steps=is_real)
    run = RunSettings(drive=drive, threads=settings.threads, quiet=settings.quiet)
    with loaded_drive(run, config, outputs, start) as (data, terminal):
        calibration = calibrate(data, config, initial_pose=start, on_event=terminal.on_event)
        calibration = outputs.with_provenance(calibration, data, start)
    if start is None:
        off = displace(calibration.pose, OFF_DEG, OFF_M, rng)
        poses = {f"a camera {OFF_DEG:g} degrees off": off, "found without a start": calibration.pose}
    else:
        poses = {f"{START_DEG:g} degrees off": start.T_camera_lidar, "refined from there": calibration.pose}
    Overlays(data.drive, data.observations, poses, "edge" if is_real else "agreement").write(0, image)
    code = outputs.write(calibration, terminal, settings.threads, data.drive)
    whose = "the transform that KITTI publishes" if is_real else "the truth, which the calibration never saw"
    console.print(f"\nerror against {whose}:")
    for line in error_lines(compare_poses(calibration.pose, T_true)):
        console.print(line)
    if not settings.quiet and not is_real and is_installed("torch"):
        console.print(_by_mine(data, calibration, T_true), markup=False)
    console.print(f"look at {page} and {image}")
    sys.exit(code)


def _make(settings: DemoSettings, drive: Path) -> str:
    """Write the drive, and describe it in one line."""
    if settings.real is None:
        from semcal_cli.synthetic.synthesis import synthesize

        synthesize(SynthConfig(num_frames=NUM_FRAMES, seed=settings.seed), drive, force=True)
        return f"made {NUM_FRAMES} frames of a synthetic street in {drive}"
    from semcal_cli.importing import read_dataset
    from semcal_cli.importing.choice import FrameChoice
    from semcal_cli.importing.drive_folder import write_drive

    name, request = _find_sequence(settings.real)
    options = FrameChoice(max_frames=NUM_REAL_FRAMES)
    written = write_drive(read_dataset(name, request), options, drive, force=True)
    return f"imported {written.num_frames} frames of {name} from {settings.real} into {drive}"


def _find_sequence(folder: Path) -> tuple[str, Request]:
    """Find which data set a folder holds, and which sequence to use: for KITTI raw, the one with the most sweeps.

    Raises:
        InputError: it is neither KITTI object nor KITTI raw.
    """
    from semcal_cli.importing.recording import Request

    if any((folder / name).is_dir() for name in ("velodyne", "training/velodyne")):
        return "kitti-object", Request(folder)
    sequences = sorted(folder.glob("*/*_sync/velodyne_points/data"))
    if not sequences:
        raise InputError(
            f"--real: found no velodyne, training/velodyne or 2011_09_26/2011_09_26_drive_0001_sync in {folder}, "
            "expected a folder of KITTI object or KITTI raw"
        )
    longest = max(sequences, key=lambda sweeps: sum(1 for _ in sweeps.iterdir()))
    sequence = longest.parents[1]
    cameras = {path.name for path in sequence.glob("image_*")}
    camera = None if "image_02" in cameras else min(cameras, default=None)
    return "kitti-raw", Request(folder, sequence.name, camera)


def _by_mine(data: LoadedDrive, calibration: CalibrationDocument, T_true: Pose) -> str:
    """Refine from the same start with MINE, the paper's estimator, and describe its error and time in one line."""
    import numpy as np

    from semcal_cli.config import RefinementConfig
    from semcal_cli.estimation.search.initial_pose import InitialPose
    from semcal_cli.geometry.poses import compare_poses
    from semcal_cli.pipeline import refine_and_polish, start_at

    start, seed = perf_counter(), calibration.settings.seed
    initial = start_at(data, InitialPose(np.array(calibration.stages["initial"].T_camera_lidar), "initial"))
    stages = refine_and_polish(data, initial, RefinementConfig("mine"), seed)
    error = compare_poses(stages.T_camera_lidar, T_true)
    off = f"{error.rotation_deg:.4f} deg and {error.camera_center_cm:.3f} cm off"
    return f"with MINE        {off}, in {perf_counter() - start:.1f} s, from the same start"
