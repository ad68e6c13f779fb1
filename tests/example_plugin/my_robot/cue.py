"""How far points are, against how bright pixels are."""

import numpy as np

from semcal_cli.drive.document import Drive
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.observations.cues.cue import Cue
from semcal_cli.observations.cues.intensity import grey_values
from semcal_cli.observations.motion import compensated
from semcal_cli.observations.observations import LabelledCloud, LabelledImage, Observations
from semcal_cli.observations.reading import make_observations, read_clouds


def observe(drive: Drive, sweeps: SweepCache | None, is_raw: bool) -> Observations:
    """Give points the classes near and far, and pixels the classes dark and bright."""
    clouds = read_clouds(drive, sweeps)
    moved = compensated(drive, clouds)
    is_far = [np.linalg.norm(cloud.points, axis=1) > 15.0 for cloud in moved]
    points = [LabelledCloud(cloud.points, np.uint8(far)) for cloud, far in zip(moved, is_far, strict=True)]
    images = [LabelledImage(np.uint8(grey_values(drive, frame) > 128.0)) for frame in drive.frames]
    return make_observations(drive, clouds, moved, points, images, (["near", "far"], ["dark", "bright"]))


CUE = Cue(observe=observe, files=("image",))
