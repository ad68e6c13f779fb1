"""Hypotheses of the initial calibration."""

import math

import numpy as np

from semcal_cli.files.validation import Count, Figure, Share, StrictModel, Transform, Width
from semcal_cli.geometry.poses import Pose


class Hypothesis(StrictModel):
    """Pose that the initial calibration found."""

    T_camera_lidar: Transform
    """Transform of the hypothesis, p_camera = T_camera_lidar * p_lidar, in metres."""
    mutual_information_nats: Figure
    """Mutual information at this transform over all frames in full resolution, as the plug-in estimate."""
    bias_nats: Figure
    """Miller and Madow's estimate of the bias by which the mutual information is too high. Hypotheses are ranked by the
    mutual information minus the bias."""
    sigma_nats: Width | None
    """Standard error of the mutual information, over parts of the images; null if all points lie in one part."""
    overlap: Share
    """Share of the image's area that visible points cover."""
    num_pairs: Count | None
    """Number of labelled returns that the registration placed on labelled pixels, among those that it looked at; null
    without a registration."""
    num_inliers: Count | None
    """Number of inliers of PnP among the pairs of a point and a pixel; null without PnP."""
    rotation_from_best_deg: Width
    """Angle of the rotation between this hypothesis and the first, in degrees."""

    @property
    def pose(self) -> Pose:
        """T_camera_lidar as an array (4, 4) of float64, in metres."""
        return np.array(self.T_camera_lidar)

    @property
    def corrected_nats(self) -> float:
        """Mutual information minus its bias, by which hypotheses are ranked."""
        return self.mutual_information_nats - self.bias_nats

    def margin(self, other: "Hypothesis") -> float:
        """Compute how far another hypothesis is behind, in standard errors of the difference of mutual information.

        The two errors are taken as independent. They are not if the views overlap, and then the margin is too small,
        which is the safe side.
        """
        if self.sigma_nats is None or other.sigma_nats is None:
            return 0.0
        sigma = math.hypot(self.sigma_nats, other.sigma_nats)
        # Without scatter the error is unknown, which counts as no margin.
        return (self.corrected_nats - other.corrected_nats) / sigma if sigma > 0.0 else 0.0
