"""The rigs of the laboratory's drives, and the rows of its tables, each a rig with something changed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from semcal_cli.drive.document import Drive
from semcal_cli.observations.frame_selection import with_frames
from semcal_cli.observations.observations import Observations
from semcal_cli.synthetic.label_noise import with_wrong_labels

RIGS: dict[str, dict[str, object]] = {
    "default": {},
    "backward": {"camera_azimuth_deg": 180.0},
    "16_channels": {"channels": 16},
    "rosette": {"pattern": "rosette"},
    "narrow": {"lens": "narrow"},
    "wide": {"lens": "wide"},
}
"""Changes to the `SynthConfig`, by rig."""
Degrade = Callable[[Observations, np.random.Generator], Observations]
"""A function that changes the labels of a drive."""


def rig_of(seed: int) -> str:
    """Choose the rig of a seed; consecutive seeds cycle through all rigs."""
    return list(RIGS)[seed % len(RIGS)]


@dataclass(frozen=True)
class Case:
    """One row of a table on one seed."""

    row: str
    """Key of `ROWS`."""
    seed: int
    """Seed of the drive."""

    def rng(self, rows: Mapping[str, object]) -> np.random.Generator:
        """Make the random generator of the case, which depends on the index of its row."""
        return np.random.default_rng((self.seed, list(rows).index(self.row)))


def row_cases(rows: Iterable[str], seeds: range) -> list[Case]:
    """List the cases of some rows, seed by seed, so that a stopped run has results for all rows."""
    listed = tuple(rows)
    return [Case(row, seed) for seed in seeds for row in listed]


def wrong(share: float) -> Degrade:
    """Give a fraction of the labels on both sides another class."""
    return lambda observations, rng: with_wrong_labels(observations, share, rng)


def consecutive(drive: Drive, num_frames: int, seed: int) -> Drive:
    """Copy a drive with consecutive frames, from one that the seed chooses; all frames if it has no more."""
    first = seed % max(len(drive.frames) - num_frames + 1, 1)
    return with_frames(drive, range(first, min(first + num_frames, len(drive.frames))))
