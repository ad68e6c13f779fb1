"""Stated standard errors beside those of a bootstrap: over frames, or for a single frame over parts of its picture.

    python tests/benchmarks/bootstrap.py --pool DIR [--seeds 6] [--resamples 40]

Each resample is polished anew. Frames are drawn with replacement (Efron, *Bootstrap methods*, 1979); of a single frame,
random halves of its parts are taken, whose estimates scatter about the whole's as much as the whole's does about the
truth (Politis and Romano, *Large sample confidence regions based on subsamples*, 1994). What all frames of a drive
share no resample shows, so the ratio of several frames is given without it.
"""

import argparse
from pathlib import Path

import numpy as np

from semcal_cli.assessment.sensitivity import sensitivity
from semcal_cli.config import EDGE_BAND_PX, PolishConfig, SensitivityConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.drive.observations import NO_CLASS, Observations
from semcal_cli.drive.reading import load_observations
from semcal_cli.experiments.accuracy import RIGS
from semcal_cli.experiments.page_tables import run_script
from semcal_cli.experiments.pool import NUM_FRAMES, Pool
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import Pose, compare_poses
from semcal_cli.refinement.polish import newton

CONFIG = PolishConfig()


def resampled(observations: Observations, rng: np.random.Generator) -> Observations:
    """Frames drawn with replacement; of one frame, half of the squares of its picture."""
    num_frames = observations.num_frames
    if num_frames > 1:
        return observations.of_frames(rng.integers(num_frames, size=num_frames).tolist())
    (image,) = observations.images
    height, width = image.classes.shape
    side = width / SensitivityConfig.regions_across
    rows, columns = (np.arange(size) // side for size in (height, width))
    cells = (rows[:, None] * SensitivityConfig.regions_across + columns).astype(int)
    is_kept = rng.permutation(cells.max() + 1) % 2 == 0
    kept = np.where(is_kept[cells], image.classes, NO_CLASS).astype(np.uint8)
    return observations.with_images([image.with_classes(kept)])


def twist(T: Pose, T_reference: Pose) -> np.ndarray:
    """(6,) what separates two poses: metres of the camera's place, degrees of its rotation."""
    return compare_poses(T, T_reference).offsets


def ratios(
    observations: Observations, T_start: Pose, num_resamples: int, rng: np.random.Generator
) -> np.ndarray:
    """(6,) the stated standard error over that of the resamples, for each axis."""
    polished = newton(observations, T_start, CONFIG)
    T = polished.T_camera_lidar
    around = sensitivity(observations, T, SensitivityConfig(edge_band_px=EDGE_BAND_PX))
    if around is None or not around.is_determined:
        return np.full(6, np.nan)
    noise, _ = around.noise(around.influence)
    found = [
        twist(newton(resampled(observations, rng), T, CONFIG, polished.inverse_curvature).T_camera_lidar, T)
        for _ in range(num_resamples)
    ]
    sigmas = np.sqrt(np.diag(noise)) * [1.0, 1.0, 1.0, *[np.degrees(1.0)] * 3]
    return np.asarray(sigmas / np.std(found, axis=0))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--pool", type=Path, required=True)
    parser.add_argument("--first-seed", type=int, default=40_000)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--resamples", type=int, default=40)
    parser.add_argument("--pairs", type=int, nargs="+", default=[1, 5, 20])
    parser.add_argument("--frames", type=int, default=NUM_FRAMES, help="Frames of drives that are made.")
    parser.add_argument("--width", type=int, default=1280, help="Columns of their pictures.")
    parser.add_argument("--height", type=int, default=720, help="Rows of their pictures.")
    options = parser.parse_args()
    size = {"num_frames": options.frames, "width": options.width, "height": options.height}
    options.pool.mkdir(parents=True, exist_ok=True)
    pool = Pool(options.pool)
    found: dict[int, list[np.ndarray]] = {pairs: [] for pairs in options.pairs}
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        rig = list(RIGS)[seed % len(RIGS)]
        path = pool.drive(rig, size | RIGS[rig], seed)
        observations, truth = load_observations(read_drive(path)), read_transform(path)
        for pairs in options.pairs:
            rng = np.random.default_rng((seed, pairs))
            chosen = rng.choice(observations.num_frames, pairs, replace=False).tolist()
            found[pairs].append(ratios(observations.of_frames(chosen), truth, options.resamples, rng))
    print("| pairs | stated sigma over bootstrap: median of axes and drives | 10 to 90 % |")
    print("|---|---|---|")
    for pairs, listed in found.items():
        low, middle, high = np.nanquantile(listed, (0.1, 0.5, 0.9))
        print(f"| {pairs} | {middle:.2f} | {low:.2f} to {high:.2f} |")


if __name__ == "__main__":
    run_script(main)
