"""What overlapping images show of two cameras of a rig, beside their calibrations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated

import numpy as np
from pydantic import Field

from semcal_cli.config.file_limits import MAX_CAMERAS
from semcal_cli.errors import counted
from semcal_cli.files.validation import Count, StatedTransform, StrictModel, Width
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import PoseError, compare_poses, inverse
from semcal_cli.readable import figure, lengths
from semcal_cli.result.uncertainty import Covariance

AGREE_DEG = 1.0
"""Largest angle between what images show of two cameras and their calibrations, in degrees. What images show is up to
0.8 degrees from the published poses of DDAD (`tests/benchmarks/image_matching.py`)."""
AGREE_SIGMAS = 3.0
"""The same in standard errors, where these are larger."""
MAX_IMAGE_PAIRS = MAX_CAMERAS * (MAX_CAMERAS - 1) // 2
"""Largest number of pairs of cameras."""
MIN_MATCHES = 15
"""Smallest number of features that show a transform."""


class MatchedImages(StrictModel):
    """Transform between two cameras that their images show."""

    to: str
    """Camera to whose frame the transform leads."""
    source: str
    """Camera from whose frame it leads."""
    T_to_source: StatedTransform
    """The transform in metres, p_to = T_to_source * p_source."""
    num_matches: Annotated[int, Field(ge=MIN_MATCHES)]
    """Number of matched features that fit it."""
    num_frames: Count
    """Number of frames that they are in."""
    covariance: Covariance
    """Covariance of a twist on its left, square metres and radians, in the frame of `to`: by the scatter of the
    matches, and by what a rig may move between the images."""

    @property
    def pose(self) -> Pose:
        """The transform (4, 4)."""
        return np.array(self.T_to_source)

    @property
    def spread_deg(self) -> float:
        """Standard error of the rotation, over three axes, in degrees."""
        return math.degrees(math.sqrt(np.trace(np.array(self.covariance)[3:, 3:])))

    @property
    def most_apart_deg(self) -> float:
        """Largest angle between the transform and that of calibrations that agree with it, in degrees."""
        return max(AGREE_DEG, AGREE_SIGMAS * self.spread_deg)

    def is_contradicted_by(self, poses: Mapping[str, Pose]) -> bool:
        """Whether the poses T_camera_lidar (4, 4) of both cameras contradict it."""
        return self.differs_from(poses).rotation_deg > self.most_apart_deg

    def differs_from(self, poses: Mapping[str, Pose]) -> PoseError:
        """Compare the transform with the poses T_camera_lidar (4, 4) of both cameras."""
        return compare_poses(poses[self.to] @ inverse(poses[self.source]), self.pose)


class ComparedImages(MatchedImages):
    """The same beside the calibrations of both cameras."""

    rotation_deg: Width
    """Angle between the transform and that of the calibrations, in degrees."""
    distance_m: Width
    """Distance between the positions that they give `to`, in metres."""

    @classmethod
    def beside(cls, shown: MatchedImages, poses: Mapping[str, Pose]) -> ComparedImages:
        """Compare what images show with the poses T_camera_lidar (4, 4) of both cameras."""
        error, own = shown.differs_from(poses), shown.model_dump(include={*MatchedImages.model_fields})
        return cls(**own, rotation_deg=error.rotation_deg, distance_m=error.camera_center_m)

    @property
    def is_contradicted(self) -> bool:
        """Whether the calibrations contradict it."""
        return self.rotation_deg > self.most_apart_deg

    @property
    def sentence(self) -> str:
        """Describe the difference."""
        return (
            f"{counted(self.num_matches, 'feature')} in images of {self.source} and {self.to} show a transform "
            f"{figure(self.rotation_deg)} degrees and {lengths([self.distance_m])} from that of their calibrations"
        )

    @property
    def reason(self) -> str:
        """Describe a difference that is too large, and what to do."""
        limit = "a degree" if self.most_apart_deg == AGREE_DEG else f"{figure(self.most_apart_deg)} degrees"
        return (
            f"{self.sentence}, more than {limit}: check the drives of both, that their "
            "images are of one moment, and K"
        )
