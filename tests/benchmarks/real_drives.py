"""Where real drives without labels of points end, as a Markdown table: a row for each drive and cue.

    python tests/benchmarks/real_drives.py ../shared/data
    python tests/benchmarks/real_drives.py ../shared/data --start nothing --cue segments,edges --only KITTI
    python tests/benchmarks/real_drives.py ../shared/data --start close --pairs 1 --only "KITTI object"

Each run starts near the published pose, in a direction of its own, as with `semcal calibrate --init`, or from nothing
with a seed of its own. With `--pairs N` each takes N frames of the drive: one after the other, or at random.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import NamedTuple, TextIO

import click
import numpy as np
from real_data import RealDrive, real_drives

from semcal_cli.cli.options import CUES as CUE_NAMES
from semcal_cli.config import CalibrationConfig, CueName
from semcal_cli.drive.document import read_drive
from semcal_cli.drive.loading import LoadedDrive, load
from semcal_cli.errors import SemcalError
from semcal_cli.experiments.page_tables import run_script
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import Pose, compare_poses
from semcal_cli.geometry.twists import displaced
from semcal_cli.initialization.initial_pose import InitialPose
from semcal_cli.pipeline import calibrate

STARTS = {"near": (2.0, 0.2), "far": (5.0, 0.3), "close": (1.0, 0.1), "nothing": None}
"""Distance of a start from the published pose, degrees and metres."""
RIGHT_DEG, RIGHT_CM = 0.2, 5.0
"""Errors within which a run is right."""
NEAR_DEG, NEAR_CM = 0.5, 20.0
"""Errors within which a run is near, and beyond which none may be trusted."""
CUES = ("labels", "edges", "segments,edges", "segments", "segments,intensity", "intensity")
HEADER = (
    *("real drive", "start", "cue", "n", "rotation, deg: median, worst", "camera centre, cm: median, worst"),
    *("ends apart", f"within {RIGHT_DEG:g} deg, {RIGHT_CM:g} cm", f"within {NEAR_DEG:g} deg, {NEAR_CM:g} cm"),
    *("trusted", "wrong and trusted", "outside and trusted", "seconds"),
)


class End(NamedTuple):
    """Where a run ended."""

    T_camera_lidar: Pose | None
    rotation_deg: float
    center_cm: float
    status: str
    """The verdict, or the error that ended the run."""
    reasons: Sequence[str]
    """What was found against the pose."""
    offsets: Sequence[float]
    """From the published pose, along the camera's axes: metres of its centre, and degrees."""
    half_widths: Sequence[float]
    """Of the 95 % intervals along these axes; none without an uncertainty."""
    seconds: float

    @property
    def is_trusted(self) -> bool:
        """Whether the verdict is that the pose can be trusted."""
        return self.status == "trusted"

    def is_outside(self, published: Sequence[float]) -> bool:
        """Whether the published pose is outside the interval, widened by its own errors (6,)."""
        widths = np.array(self.half_widths) + published
        return bool((np.abs(self.offsets) > widths).any())


def run(data: LoadedDrive, T_published: Pose, start: str, seed: int) -> End:
    """Calibrate once, and compare the end with the published pose."""
    config = CalibrationConfig(cues=data.cues, seed=seed)
    distance, initial_pose = STARTS[start], None
    if distance is not None:
        T_start = displaced(T_published, *distance, np.random.default_rng(seed))
        initial_pose = InitialPose(T_start, f"{start} start")
    begun = perf_counter()
    try:
        calibration = calibrate(data, config, initial_pose=initial_pose)
    except SemcalError as failed:
        return End(None, np.inf, np.inf, str(failed), (), (), (), perf_counter() - begun)
    error, uncertainty = compare_poses(calibration.pose, T_published), calibration.uncertainty
    return End(
        calibration.pose,
        error.rotation_deg,
        error.camera_center_cm,
        calibration.status,
        calibration.reasons,
        error.offsets.tolist(),
        uncertainty.half_widths if uncertainty else (),
        perf_counter() - begun,
    )


def table_row(what: str, start: str, cue: str, ends: Sequence[End], published: Sequence[float]) -> str:
    """Format the runs of a drive by a cue."""
    deg, cm = (np.array([getattr(end, name) for end in ends]) for name in ("rotation_deg", "center_cm"))
    trusted = np.array([end.is_trusted for end in ends])
    right, near = (deg <= RIGHT_DEG) & (cm <= RIGHT_CM), (deg <= NEAR_DEG) & (cm <= NEAR_CM)
    cells = (
        what,
        start,
        cue,
        len(ends),
        f"{np.median(deg):.2f}, {deg.max():.2f}",
        f"{np.median(cm):.1f}, {cm.max():.1f}",
        _spread(ends),
        right.sum(),
        near.sum(),
        trusted.sum(),
        (trusted & ~near).sum(),
        sum(end.is_trusted and end.is_outside(published) for end in ends),
        f"{np.median([end.seconds for end in ends]):.1f}",
    )
    return f"| {' | '.join(map(str, cells))} |"


def _spread(ends: Sequence[End]) -> str:
    """Tell the largest distance between two ends, degrees and centimetres."""
    poses = [end.T_camera_lidar for end in ends if end.T_camera_lidar is not None]
    apart = [compare_poses(a, b) for index, a in enumerate(poses) for b in poses[:index]]
    if not apart:
        return "-"
    deg, cm = max(each.rotation_deg for each in apart), max(each.camera_center_cm for each in apart)
    return f"{deg:.2f} deg, {cm:.1f} cm"


def evaluate(
    found: RealDrive, cue: str, start: str, seeds: Sequence[int], num_pairs: int | None
) -> list[End]:
    """Make all runs of a drive by a cue; with `num_pairs`, each by other frames."""
    cues: tuple[CueName, ...] = tuple(CUE_NAMES.convert(cue, None, None))
    drive, T = read_drive(found.path), read_transform(found.path)
    data, num_frames = load(drive, CalibrationConfig(cues=cues)), len(drive.frames)
    if num_pairs is None or num_pairs >= num_frames:
        return [run(data, T, start, seed) for seed in seeds]
    if num_pairs == 1:
        return [run(data.of_frames([frame]), T, start, frame) for frame in range(num_frames)]
    chosen = [np.random.default_rng(seed).permutation(num_frames)[:num_pairs] for seed in seeds]
    frames = [sorted(each.tolist()) for each in chosen]
    return [run(data.of_frames(each), T, start, seed) for each, seed in zip(frames, seeds, strict=True)]


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True))
@click.option("--start", type=click.Choice(list(STARTS)), default="near", show_default=True)
@click.option("--cue", "cues", multiple=True, default=CUES, help="Cues, each with rows of its own.")
@click.option("--starts", default=10, show_default=True, help="Number of runs.")
@click.option("--first-seed", default=90, show_default=True)
@click.option("--pairs", "numbers", multiple=True, type=int, help="Frames of each run; all if not given.")
@click.option("--only", default="", help="Only drives whose names contain this.")
@click.option("--runs", type=click.File("a"), help="Add a line of JSON for each run to this file.")
def main(
    data: Path,
    start: str,
    cues: Sequence[str],
    starts: int,
    first_seed: int,
    numbers: Sequence[int],
    only: str,
    runs: TextIO | None,
) -> None:
    """Print the table."""
    print(f"| {' | '.join(HEADER)} |\n|{'---|' * len(HEADER)}")
    with TemporaryDirectory() as folder:
        for found in real_drives(data.resolve(), Path(folder)):
            for cue in cues:
                if only not in found.name or not found.files_allow(cue.split(",")):
                    continue
                for num_pairs in numbers or (None,):
                    seeds = range(first_seed, first_seed + starts)
                    ends = evaluate(found, cue, start, seeds, num_pairs)
                    which = f"{found.name}, {num_pairs} of them" if num_pairs else found.name
                    print(table_row(which, start, cue, ends, found.published), flush=True)
                    for end in ends if runs else ():
                        named = {"drive": which, "start": start, "cue": cue, **end._asdict()}
                        print(json.dumps(named | {"T_camera_lidar": None}), file=runs, flush=True)


if __name__ == "__main__":
    run_script(main)
