"""Stated standard errors beside those of a bootstrap: over frames, or for a single frame over parts of its image.

    python tests/benchmarks/bootstrap.py --pool DIR [--seeds 6] [--resamples 40]

Each resample is polished anew. Frames are drawn with replacement (Efron, *Bootstrap methods*, 1979); of a single frame,
random halves of its parts are taken, whose estimates scatter about the whole's as much as the whole's does about the
truth (Politis and Romano, *Large sample confidence regions based on subsamples*, 1994). What all frames of a drive
share no resample shows, so the ratio of several frames is given without it.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from benchmark import script, table
from laboratory.rigs import RIGS, rig_of

from semcal_cli.config import PolishConfig, SensitivityConfig
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.estimation.uncertainty.sensitivity import sensitivity
from semcal_cli.experiments.drives import NUM_FRAMES, Pool
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.observations import NO_CLASS, Observations
from semcal_cli.observations.reading import load_observations

CONFIG = PolishConfig()


def resampled(observations: Observations, rng: np.random.Generator) -> Observations:
    """Frames drawn with replacement; of one frame, half of the squares of its image."""
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


def ratios(
    observations: Observations, T_start: Pose, num_resamples: int, rng: np.random.Generator
) -> np.ndarray:
    """(6,) the stated standard error over that of the resamples, for each axis."""
    polished = newton(observations, T_start, CONFIG)
    T = polished.T_camera_lidar
    around = sensitivity(observations, T, SensitivityConfig())
    if around is None or not around.is_determined:
        return np.full(6, np.nan)
    noise, _ = around.noise(around.influence)
    found = []
    for _ in range(num_resamples):
        again = newton(resampled(observations, rng), T, CONFIG, polished.inverse_curvature)
        found.append(compare_poses(again.T_camera_lidar, T).offsets)
    sigmas = np.sqrt(np.diag(noise)) * [1.0, 1.0, 1.0, *[np.degrees(1.0)] * 3]
    return np.asarray(sigmas / np.std(found, axis=0))


def main(
    *,
    pool: Path,
    first_seed: int = 40_000,
    seeds: int = 6,
    resamples: int = 40,
    pairs: tuple[int, ...] = (1, 5, 20),
    frames: int = NUM_FRAMES,
    width: int = 1280,
) -> Iterator[str]:
    size = {"num_frames": frames, "width": width, "height": width * 9 // 16}
    found: dict[int, list[np.ndarray]] = {count: [] for count in pairs}
    for seed in range(first_seed, first_seed + seeds):
        rig = rig_of(seed)
        drive, truth = Pool(pool).read(rig, size | RIGS[rig], seed)
        observations = load_observations(drive)
        for count, listed in found.items():
            rng = np.random.default_rng((seed, count))
            chosen = rng.choice(observations.num_frames, count, replace=False).tolist()
            listed.append(ratios(observations.of_frames(chosen), truth, resamples, rng))
    quantiles = {count: np.nanquantile(listed, (0.1, 0.5, 0.9)) for count, listed in found.items()}
    rows = [
        (count, f"{mid:.2f}", f"{low:.2f} to {high:.2f}") for count, (low, mid, high) in quantiles.items()
    ]
    yield from table("pairs | stated sigma over bootstrap: median of axes and drives | 10 to 90 %", rows)


if __name__ == "__main__":
    script(main)
