"""Rows of a table that is measured row by row, each on several seeds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from semcal_cli.assessment.stages import Stages
from semcal_cli.config import CalibrationConfig, RefinementConfig
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.drive.observations import Observations
from semcal_cli.pipeline import assess, make_calibration, refine_and_polish
from semcal_cli.result.calibration import Calibration
from semcal_cli.result.stage import StageResult
from semcal_cli.synthetic.label_noise import with_wrong_labels

Degrade = Callable[[Observations, np.random.Generator], Observations]
"""Changes the labels of a drive."""


@dataclass(frozen=True)
class Case:
    """A row on one seed."""

    row: str
    """Key of `ROWS`."""
    seed: int
    """Seed of the drive."""

    def rng(self, rows: Mapping[str, object]) -> np.random.Generator:
        """Make the random generator of the case, which depends on the place of its row among all rows."""
        return np.random.default_rng((self.seed, list(rows).index(self.row)))


def cases(rows: Iterable[str], seeds: range) -> list[Case]:
    """List the cases of some rows, seed by seed, so that a stopped run has results of all rows."""
    listed = tuple(rows)
    return [Case(row, seed) for seed in seeds for row in listed]


def wrong(share: float) -> Degrade:
    """Give a share of the labels of both sides another class."""
    return lambda observations, rng: with_wrong_labels(observations, share, rng)


def calibrate_from(
    initial: StageResult, data: LoadedDrive, config: RefinementConfig
) -> tuple[Stages, Calibration]:
    """Calibrate as `calibrate` does after its initial calibration.

    The pose of the stages is as it was found; that of the calibration is the nearest rigid one.

    Raises:
        SemcalError: as `calibrate`.
    """
    stages = assess(data, refine_and_polish(data, initial, config), config)
    return stages, make_calibration(data, stages, CalibrationConfig(refinement=config))
