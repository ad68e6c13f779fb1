"""How rarely a random pose has more contrast than the published one, by the weights of the steps, as a Markdown table.

    python tests/benchmarks/contrast.py ../shared/data

Poses are up to 5 degrees and 0.3 m away from starts that are 2 degrees and 0.2 m off, as a search by edges draws them,
and are compared on its coarsest blocks. The figures are percentages of the poses around all starts of a drive.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmark import script, table
from real_data import real_drives

from semcal_cli import core
from semcal_cli.config import ExactConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.estimation.refine.pyramid import pyramid_factors
from semcal_cli.estimation.refine.several_starts import pyramid_of
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.cues.edges import STARTS_ALONE, observe_edges
from semcal_cli.observations.observations import Observations

FIRST_SEED = 90
NUM_LEVELS = 3
"""Number of levels of steps in range, and in intensity."""
WEIGHTS: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "all steps alike": ((1.0, 1.0, 1.0), (1.0, 1.0, 1.0)),
    "all steps, by level": ((1.0, 2.0, 3.0), (1.0, 2.0, 3.0)),
    "steps in range alike": ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
    "steps in range, by level": ((0.0, 0.0, 0.0), (1.0, 2.0, 3.0)),
}
"""Weights of the levels of steps in intensity and in range."""


def drawn_around(T_published: Pose, seed: int, count: int) -> list[Pose]:
    """Draw poses (4, 4) around a start that is off."""
    rng = np.random.default_rng(seed)
    start = displace(T_published, 2.0, 0.2, rng)
    distances = zip(
        np.linspace(*STARTS_ALONE.spread_deg, count), np.linspace(*STARTS_ALONE.spread_m, count), strict=True
    )
    return [displace(start, *distance, rng) for distance in distances]


def contrasts(seen: Observations, poses: list[Pose], weights: list[float], factor: int) -> np.ndarray:
    """Compute the contrast (N,) at poses (4, 4), levels."""
    assert STARTS_ALONE.contrast is not None
    config = replace(ExactConfig(), steps=0, max_points=STARTS_ALONE.contrast.max_points)
    compared = core.align(
        seen.core, poses, config, factor=factor, visible_only=False, seed=0, contrast_weights=weights
    )
    return np.array([pose.value for pose in compared])


def main(data: Path, *, only: str = "", starts: int = 5, poses: int = 300) -> Iterator[str]:
    def rows(folder: Path) -> Iterator[tuple[str, ...]]:
        for real in real_drives(data.resolve(), folder):
            if only not in real.name or "DiCENet" in real.name:
                continue
            T, seen = read_transform(real.path), observe_edges(read_drive(real.path))
            factor = pyramid_factors(seen.camera, pyramid_of(STARTS_ALONE))[0]
            drawn = [
                pose
                for seed in range(FIRST_SEED, FIRST_SEED + starts)
                for pose in drawn_around(T, seed, poses)
            ]
            num_intensity = len(seen.point_class_names) - 1 - NUM_LEVELS
            shares = []
            for of_intensity, of_range in WEIGHTS.values():
                weights = [0.0, *of_intensity[:num_intensity], *of_range]
                own, *others = contrasts(seen, [T, *drawn], weights, factor)
                shares.append(f"{100.0 * np.mean(np.array(others) > own):.1f}")
            yield real.name, *shares

    with TemporaryDirectory() as folder:
        yield from table(" | ".join(("real drive", *WEIGHTS)), rows(Path(folder)))


if __name__ == "__main__":
    script(main)
