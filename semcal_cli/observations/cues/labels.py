"""The labels cue: the labels of points against those of pixels, as in the paper."""

from __future__ import annotations

from semcal_cli.drive.document import Drive
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.observations.cues.cue import Cue
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.reading import load_observations, read_observations


def observe_labels(drive: Drive, sweeps: SweepCache | None = None, is_raw: bool = False) -> Observations:
    """Load every frame of a drive with its labels; isolated pixels of raw label images stay.

    Raises:
        InputError: a file is missing or wrong, or one side carries no class.
        CalibrationError: one side carries a single class.
    """
    return read_observations(drive, sweeps) if is_raw else load_observations(drive, sweeps)


CUE = Cue(
    observe=observe_labels,
    files=("image_labels",),
    finds_mounting_alone=True,
    has_point_labels=True,
    has_image_labels=True,
)
