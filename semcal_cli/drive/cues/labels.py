"""The labels cue: semantic labels of points against those of pixels. The two sets of classes need not be the same."""

from __future__ import annotations

from semcal_cli.drive.cues.cue import Cue
from semcal_cli.drive.document import Drive
from semcal_cli.drive.observations import Observations
from semcal_cli.drive.reading import load_observations, read_observations
from semcal_cli.files.point_clouds import Sweeps


def _observe(drive: Drive, sweeps: Sweeps | None, is_raw: bool) -> Observations:
    return read_observations(drive, sweeps) if is_raw else load_observations(drive, sweeps)


CUE = Cue(observe=_observe, files=("image_labels",))
