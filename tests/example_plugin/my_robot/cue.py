"""How far points are, against how bright pixels are."""

import numpy as np

from semcal_cli.config import StartsConfig
from semcal_cli.drive.document import Drive
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.observations.cues.cue import Cue
from semcal_cli.observations.cues.intensity import grey_values
from semcal_cli.observations.motion import compensated
from semcal_cli.observations.observations import LabelledCloud, LabelledImage, Observations
from semcal_cli.observations.reading import make_observations, read_clouds


def observe(drive: Drive, sweeps: SweepCache | None, is_raw: bool) -> Observations:
    """Classify points as near or far, and pixels as dark or bright."""
    clouds = read_clouds(drive, sweeps)
    moved = compensated(drive, clouds)
    is_far = [np.linalg.norm(cloud.points, axis=1) > 15.0 for cloud in moved]
    points = [LabelledCloud(cloud.points, np.uint8(far)) for cloud, far in zip(moved, is_far, strict=True)]
    images = [LabelledImage(np.uint8(grey_values(drive, frame) > 128.0)) for frame in drive.frames]
    return make_observations(drive, clouds, moved, points, images, (["near", "far"], ["dark", "bright"]))


STARTS = StartsConfig(
    coarsest_block_deg=2.0,
    min_blocks=8,
    num_starts=(8, 4, 2),
    spread_deg=(0.5, 2.0),
    spread_m=(0.05, 0.2),
    farthest_deg=5.0,
)
CUE = Cue(
    observe=observe,
    files=("image",),
    config=None,  # there are no settings
    starts=STARTS,  # the information has many maxima
    starts_alone=None,  # its starts are the same without other cues
    can_find_mounting=False,  # it works only near the right pose
    finds_mounting_alone=False,
    is_coarse=False,  # it refines the pose
    weight_beside_local=1.0,  # its points count in full
    min_scenes=3,  # a pose from fewer scenes is not trusted
    has_point_labels=False,  # near, far, dark and bright are no labels
    has_image_labels=False,
    has_partitions=False,
    has_vectors=False,
)
