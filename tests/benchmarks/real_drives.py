"""Where real drives without point labels end, as a Markdown table: a row for each drive and cue.

    python tests/benchmarks/real_drives.py ../shared/data
    python tests/benchmarks/real_drives.py ../shared/data --start nothing --cue segments,edges --only KITTI
    python tests/benchmarks/real_drives.py ../shared/data --start close --pairs 1 --only "KITTI object"
    python tests/benchmarks/real_drives.py ../shared/data --cue edges --rings 16 --starts 2 --only KITTI
    python tests/benchmarks/real_drives.py ../shared/data --cue edges --starts 3 --changed portrait --only "KITTI "

Each run starts near the published pose, in a direction of its own, as with `semcal calibrate --init`, or from nothing
with a seed of its own. With `--pairs N` each takes N frames of the drive: one after the other, or at random. With
`--rings 16`, sweeps of KITTI are cut to 16 of their 64 rings, in all four ways. With `--changed turned`, their points
are in a frame that is upside down, on its side, or nose down; with `portrait` the camera is on its side; and with
`processed` clouds are in random order, thinned, rounded and so on. Only drives whose names contain `--only` are run.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, Literal, NamedTuple

import numpy as np
from benchmark import script, summary
from laboratory.rates import median_and_worst
from real_data import (
    RealDrive,
    real_drives,
    with_fewer_rings,
    with_portrait_camera,
    with_processed_clouds,
    with_turned_lidar,
)

from semcal_cli.cli.options import CUES as CUE_NAMES
from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.errors import InputError, SemcalError
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.experiments.summary import (
    NUMBER,
    Column,
    cell,
    common,
    count,
    digits,
    error_columns,
    measure_of,
    median,
)
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.pipeline import calibrate

Start = Literal["near", "far", "close", "nothing"]
Changed = Literal["turned", "portrait", "processed"]
STARTS = {"near": (2.0, 0.2), "far": (5.0, 0.3), "close": (1.0, 0.1), "nothing": None}
"""Distance of a start from the published pose, degrees and metres."""
RIGHT, NEAR = (0.2, 5.0), (0.5, 20.0)
"""Errors in degrees and centimetres within which a run is right or near; beyond these none may be trusted."""
CUES = ("labels", "edges", "segments,edges", "segments", "segments,intensity", "intensity")


class End(NamedTuple):
    """Where a run ended."""

    drive: str
    start: str
    cue: str
    T_camera_lidar: Pose | None = None
    rotation_deg: float = np.inf
    camera_center_cm: float = np.inf
    is_trusted: bool = False
    is_outside: bool = False
    """Whether the published pose is outside the 95 % interval, widened by its own errors."""
    seconds: float = 0.0

    def is_within(self, errors: tuple[float, float]) -> bool:
        """Whether both errors are small enough."""
        return self.rotation_deg <= errors[0] and self.camera_center_cm <= errors[1]


def run(end: End, data: LoadedDrive, T_published: Pose, published: Sequence[float], seed: int) -> End:
    """Calibrate once, and compare the end with the published pose, which itself may be off by some errors (6,)."""
    config = CalibrationConfig(cues=data.cues, seed=seed)
    distance, initial_pose = STARTS[end.start], None
    if distance is not None:
        T_start = displace(T_published, *distance, np.random.default_rng(seed))
        initial_pose = InitialPose(T_start, f"{end.start} start")
    begun = perf_counter()
    try:
        found = calibrate(data, config, initial_pose=initial_pose)
    except SemcalError:
        return end._replace(seconds=perf_counter() - begun)
    error, uncertainty = compare_poses(found.pose, T_published), found.uncertainty
    widths = np.array(uncertainty.half_widths if uncertainty else np.zeros(6)) + published
    return end._replace(
        T_camera_lidar=found.pose,
        rotation_deg=error.rotation_deg,
        camera_center_cm=error.camera_center_cm,
        is_trusted=found.status == "trusted",
        is_outside=bool((np.abs(error.offsets) > widths).any()),
        seconds=perf_counter() - begun,
    )


def evaluate(real: RealDrive, cue: str, start: str, seeds: Sequence[int], num_pairs: int | None) -> list[End]:
    """Make all runs of a drive by a cue; with `num_pairs`, each by other frames."""
    config = CalibrationConfig(cues=tuple(CUE_NAMES.convert(cue, None, None)))
    drive, T = read_drive(real.path), read_transform(real.path)
    data, num_frames = load(drive, config), len(drive.frames)
    end = End(f"{real.name}, {num_pairs} of them" if num_pairs else real.name, start, cue)
    if num_pairs is None or num_pairs >= num_frames:
        chosen = {seed: range(num_frames) for seed in seeds}
    elif num_pairs == 1:
        chosen = {frame: range(frame, frame + 1) for frame in range(num_frames)}
    else:
        orders = {seed: np.random.default_rng(seed).permutation(num_frames) for seed in seeds}
        chosen = {seed: sorted(order[:num_pairs].tolist()) for seed, order in orders.items()}
    return [run(end, data.of_frames(frames), T, real.published, seed) for seed, frames in chosen.items()]


def _spread(ends: Sequence[End]) -> str:
    """Tell the largest distance between two ends, degrees and centimetres."""
    poses = [end.T_camera_lidar for end in ends if end.T_camera_lidar is not None]
    apart = [compare_poses(a, b) for index, a in enumerate(poses) for b in poses[:index]]
    if not apart:
        return "-"
    deg, cm = max(each.rotation_deg for each in apart), max(each.camera_center_cm for each in apart)
    return f"{deg:.2f} deg, {cm:.1f} cm"


def _within(errors: tuple[float, float]) -> Column:
    return count(f"within {errors[0]:g} deg, {errors[1]:g} cm", lambda end: end.is_within(errors))


COLUMNS = (
    common("drive", "real drive"),
    common("start", "start"),
    common("cue", "cue"),
    NUMBER,
    *error_columns("median, worst", median_and_worst, 2, 1),
    cell("ends apart", _spread),
    _within(RIGHT),
    _within(NEAR),
    count("trusted", lambda end: end.is_trusted),
    count("wrong and trusted", lambda end: end.is_trusted and not end.is_within(NEAR)),
    count("outside and trusted", lambda end: end.is_trusted and end.is_outside),
    Column("seconds", {"seconds": measure_of("seconds", median)}, digits(1)),
)


def _chosen(data: Path, folder: Path, only: str, changed: Changed | None, rings: int) -> Iterator[RealDrive]:
    for real in real_drives(data, folder):
        if only in real.name:
            match changed:
                case "turned":
                    yield from with_turned_lidar(real, folder)
                case "portrait":
                    yield with_portrait_camera(real, folder)
                case "processed":
                    yield from with_processed_clouds(real, folder)
                case None:
                    yield from [real] if rings == 64 else with_fewer_rings(real, rings, folder)


def main(
    data: Path,
    *,
    start: Start = "near",
    cue: tuple[str, ...] = CUES,
    starts: int = 10,
    first_seed: int = 90,
    pairs: tuple[int, ...] = (),
    rings: int = 64,
    changed: Changed | None = None,
    only: str = "",
) -> Iterator[str]:
    seeds = range(first_seed, first_seed + starts)
    if changed is not None and rings != 64:
        raise InputError("--rings: found --changed as well, needed one of the two")
    numbers: Sequence[Any] = pairs or (None,)
    with TemporaryDirectory() as folder:
        found = (
            evaluate(real, each, start, seeds, num_pairs)
            for real in _chosen(data.resolve(), Path(folder), only, changed, rings)
            for each in cue
            if real.files_allow(each.split(","))
            for num_pairs in numbers
        )
        yield from summary(found, COLUMNS)


if __name__ == "__main__":
    script(main)
