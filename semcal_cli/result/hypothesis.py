"""A pose that the initial calibration arrived at."""

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from semcal_cli.files.validation import Count, Share, StrictModel, Transform, Width
from semcal_cli.geometry.poses import Pose


class Hypothesis(StrictModel):
    """A pose that the initial calibration arrived at."""

    T_camera_lidar: Transform
    """p_camera = T_camera_lidar * p_lidar."""
    mutual_information_nats: float
    """Mutual information there, of the projected points in full resolution, over all frames: the plug-in estimate."""
    bias_nats: float
    """Miller and Madow's estimate of how far it is too high. Hypotheses are ranked by what is left."""
    sigma_nats: Width | None
    """Its standard error, over parts of the pictures; null if all points lie in one part."""
    overlap: Share
    """Share of the picture's area that visible points cover."""
    num_pairs: Count | None
    """Number of labelled returns that the registration put on labelled pixels, of those that it looked at; null without
    a registration."""
    num_inliers: Count | None
    """Number of pairs of a point and a pixel that PnP agreed on; null without PnP."""
    rotation_from_best_deg: Annotated[float, Field(ge=0.0)]
    """Rotation between this hypothesis and the first."""

    @property
    def pose(self) -> Pose:
        """T_camera_lidar as (4, 4) float64."""
        return np.array(self.T_camera_lidar)

    @property
    def corrected_nats(self) -> float:
        """Mutual information less its bias, by which hypotheses are ranked."""
        return self.mutual_information_nats - self.bias_nats

    def margin(self, other: "Hypothesis") -> float:
        """Tell how far another hypothesis is behind, in standard errors of the difference of mutual information.

        The errors are taken for independent. Where the two share a part of their view they are not, and the margin
        comes out too small: on the safe side.
        """
        if self.sigma_nats is None or other.sigma_nats is None:
            return 0.0
        sigma = math.hypot(self.sigma_nats, other.sigma_nats)
        # Without any scatter nothing is known of the error: that is no margin.
        return (self.corrected_nats - other.corrected_nats) / sigma if sigma > 0.0 else 0.0
