"""How far the sets of one rig, and the halves of each set, differ, against what their intervals state.

    python tests/benchmarks/closure.py ../shared/data
    python tests/benchmarks/closure.py ../shared/data --only object --halvings 40
    python tests/benchmarks/closure.py ../shared/data --only object --cue segments,edges

Every set of KITTI of 2011-09-26 estimates one transform. Each pose is compared with the published one of its own
camera: the two rectified cameras look in one direction, so that the published stereo calibration moves both to one
camera, and its axes are theirs. What the published pose itself is off is common to all sets of a camera and cancels in
their differences. The tables show the sets, the differences of all pairs, and the scatter of random halves of the
scenes of each set, scaled to 14 scenes. A pull is a difference in standard errors: 1 where intervals are right.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from benchmark import script, table
from real_data import RealDrive, real_drives

from semcal_cli.cli.options import CUES as CUE_NAMES
from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.cues.cue_table import files_of
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.observations.skew import Skew
from semcal_cli.pipeline import calibrate
from semcal_cli.pipeline.cross_validation import estimate_folds

CAMERAS = {"KITTI object, 14 pairs": "left", "KITTI jam": "left", "KITTI raw, right camera": "right"}
"""The camera of each set of the rig, by how its name begins."""
START_DEG, START_M = 2.0, 0.2
SCENES = 14
"""Number of scenes to which the scatter of halves is scaled, that of KITTI object."""


class ClosedSet(NamedTuple):
    """What one set says of the rig."""

    name: str
    camera: str
    data: LoadedDrive
    T_camera_lidar: Pose
    """(4, 4) its pose, metres."""
    T_published: Pose
    """(4, 4) published pose of its camera, metres."""
    offsets: Matrix
    """(6,) its pose from the published one, metres and degrees, along and about the camera's axes."""
    sigmas: Matrix
    """(6,) standard errors without the part by errors of K, which sets share, metres and degrees."""
    status: str


def calibrated(real: RealDrive, cue: str, seed: int) -> ClosedSet:
    """Calibrate a set from near its published pose, and deskew it as the calibration did."""
    config = CalibrationConfig(cues=tuple(CUE_NAMES.convert(cue, None, None)), seed=seed)
    T = read_transform(real.path)
    start = InitialPose(displace(T, START_DEG, START_M, np.random.default_rng(seed)), "start")
    data = load(read_drive(real.path), config)
    found = calibrate(data, config, initial_pose=start)
    seen = Skew.undone(data.observations, data.drive, found.pose, found.deskewed_m_s)
    data = replace(data, observations=seen)
    sigmas = np.full(6, np.inf)
    if (stated := found.uncertainty) is not None:
        of_K = stated.covariance_of_intrinsics or np.zeros((6, 6))
        sigmas = np.sqrt(np.maximum(np.diag(stated.covariance) - np.diag(of_K), 0.0))
        sigmas[3:] = np.degrees(sigmas[3:])
    camera = next(camera for name, camera in CAMERAS.items() if real.name.startswith(name))
    offsets = np.array(compare_poses(found.pose, T).offsets)
    return ClosedSet(real.name, camera, data, found.pose, T, offsets, sigmas, found.status)


def halves(of: ClosedSet, halvings: int, seed: int) -> tuple[Matrix, Matrix, int]:
    """Differences (n, 6) of poses by random halves of the scenes of a set, their standard errors, and the scenes."""
    observations, rng = of.data.observations, np.random.default_rng(seed)
    scenes = np.array(observations.scenes)
    numbers, differences, sigmas = np.unique(scenes), [], []
    for _ in range(halvings):
        chosen = rng.permutation(numbers)[: len(numbers) // 2]
        is_first = np.isin(scenes, chosen)
        parts = [np.flatnonzero(side).tolist() for side in (is_first, ~is_first)]
        folds = estimate_folds(observations, of.T_camera_lidar, CalibrationConfig().refinement.polish, parts)
        of_folds = [fold.sigmas for fold in folds if fold.sigmas is not None]
        if len(of_folds) < 2:
            continue
        first, second = (fold.offsets_from(of.T_published) for fold in folds)
        differences.append(first - second)
        sigmas.append(np.linalg.norm(of_folds, axis=0))
    return np.array(differences), np.array(sigmas), len(numbers)


def _row(name: str, offsets: Sequence[float], *more: str) -> list[str]:
    """Write a name and offsets (6,), metres and degrees, as centimetres and degrees with their lengths."""
    center, rotation = 100.0 * np.array(offsets[:3]), np.array(offsets[3:])
    return [
        name,
        " ".join(f"{x:+.3f}" for x in rotation),
        f"{np.linalg.norm(rotation):.3f}",
        " ".join(f"{x:+.1f}" for x in center),
        f"{np.linalg.norm(center):.1f}",
        *more,
    ]


def _pulls(pulls: Matrix) -> str:
    return " ".join(f"{pull:.1f}" for pull in np.roll(pulls, 3))


OFFSETS = "rotation x y z, deg | deg | camera centre x y z, cm | cm"
"""Heads of the columns of `_row` after the first."""


def main(
    data: Path, *, cue: str = "edges", only: str = "", halvings: int = 24, seed: int = 90
) -> Iterator[str]:
    """Calibrate the sets of the rig, and compare them and their halves; by labels, those of each network."""
    uses_labels = "image_labels" in files_of(CUE_NAMES.convert(cue, None, None))
    with TemporaryDirectory() as folder:
        drives = [
            real
            for real in real_drives(data, Path(folder))
            if any(real.name.startswith(name) for name in CAMERAS) and only in real.name
            if uses_labels or "DiCENet" not in real.name
        ]
        sets = [calibrated(real, cue, seed) for real in drives]
        rows = [_row(of.name, of.offsets, of.camera, of.status) for of in sets]
        yield from table(f"set, from the published pose | {OFFSETS} | camera | status", rows)
        yield ""
        rows = []
        for a, b in combinations(sets, 2):
            pulls = np.abs(a.offsets - b.offsets) / np.hypot(a.sigmas, b.sigmas)
            within = "one camera" if a.camera == b.camera else "two cameras"
            rows.append(_row(f"{a.name} - {b.name}", (a.offsets - b.offsets).tolist(), _pulls(pulls), within))
        if rows:
            yield from table(f"difference | {OFFSETS} | pulls, rotation, centre | of", rows)
            yield ""
        rows = []
        for of in sets:
            differences, sigmas, num_scenes = halves(of, halvings, seed)
            if not len(differences):
                continue
            scale = np.sqrt(num_scenes / 2.0 / SCENES)
            scatter = scale * np.sqrt((differences**2).mean(axis=0) / 2.0)
            pulls = np.sqrt(((differences / sigmas) ** 2).mean(axis=0))
            rows.append(_row(of.name, scatter.tolist(), str(num_scenes), _pulls(pulls)))
        yield from table(f"halves, at {SCENES} scenes | {OFFSETS} | scenes | pulls, rotation, centre", rows)


if __name__ == "__main__":
    script(main)
