"""Prints a Markdown table: from how many poses beside the best one searches lead to it, on drives with many maxima.

    python tests/benchmarks/higher_maxima.py ../shared/data

A street of KITTI-360 is taken as it is recorded, and deskewed by its speed, 10 m/s. Poses around the published one are
polished, so that each is a maximum, and then searches start from each: see `estimation/refine/higher_maxima.py`. The
best pose is the highest that any of them found.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np
from benchmark import script, table
from real_data import real_drives

from semcal_cli.config import CalibrationConfig, PolishConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.estimation.refine.higher_maxima import ClimbConfig, climb
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.loading import load
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.skew import Skew

SPEEDS_M_S = (0.0, 10.0)
AWAY_DEG, AWAY_M = 0.25, 0.15
"""Distance of the poses from the published one."""
SAME = 0.99
"""An end is at the best maximum if it has at least this share of its information: polishes end a little lower."""
WAYS = {
    "one, ends polished to their end": ClimbConfig(1, PolishConfig.max_rounds),
    "one": ClimbConfig(1),
    "two": ClimbConfig(2),
    "two, ends polished for two rounds": ClimbConfig(2, rounds=2),
    "until two are in vain": ClimbConfig(),
}


def search_all(seen: Observations, starts: list[Pose]) -> Iterator[tuple[str, list[Pose], float]]:
    """Search from all poses (4, 4) in each way, and time it."""
    for way, config in WAYS.items():
        begun = perf_counter()
        ends = [climb(seen, T, np.random.default_rng(seed), config) for seed, T in enumerate(starts)]
        yield way, ends, (perf_counter() - begun) / len(starts)


def main(data: Path, *, only: str = "KITTI-360", poses: int = 16) -> Iterator[str]:
    """Search from so many poses on drives whose names contain `only`."""

    def rows(folder: Path) -> Iterator[tuple[str, ...]]:
        for real in real_drives(data.resolve(), folder):
            if only not in real.name:
                continue
            drive, T = read_drive(real.path), read_transform(real.path)
            loaded = load(drive, CalibrationConfig(cues=("edges",)))
            skew = Skew.of(drive, T)
            for speed_m_s in SPEEDS_M_S if skew is not None else ():
                seen = skew.deskewed(loaded.observations, speed_m_s)
                beside = [displace(T, AWAY_DEG, AWAY_M, np.random.default_rng(seed)) for seed in range(poses)]
                starts = [newton(seen, each, PolishConfig()).T_camera_lidar for each in beside]
                found = [("none", starts, 0.0), *search_all(seen, starts)]
                best = max((T for _, ends, _ in found for T in ends), key=seen.information)
                error = compare_poses(best, T)
                for way, ends, seconds in found:
                    reached = [seen.information(end) >= SAME * seen.information(best) for end in ends]
                    mean = np.mean([seen.information(end) for end in ends])
                    yield (
                        real.name,
                        f"{speed_m_s:g} m/s",
                        f"{error.rotation_deg:.2f} deg, {error.camera_center_cm:.1f} cm",
                        way,
                        f"{sum(reached)} of {poses}",
                        f"{mean:.4f}",
                        f"{seconds:.1f}",
                    )

    header = (
        "drive | deskewed by | best maximum | searches | reach it | information, nats: mean | seconds each"
    )
    with TemporaryDirectory() as folder:
        yield from table(header, rows(Path(folder)))


if __name__ == "__main__":
    script(main)
