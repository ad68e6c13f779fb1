"""A mounting as the search found it, and how it compares with others."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from semcal_cli import core
from semcal_cli.estimation.search.registration import Candidate
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import orthonormal, rotation_error_deg


@dataclass(frozen=True, eq=False)
class Mounting:
    """A pose of the search, with the agreement of the labels there over all frames in full resolution."""

    T_camera_lidar: Pose
    """(4, 4), p_camera = T_camera_lidar @ p_lidar, metres."""
    mutual_information_nats: float
    """Mutual information, as the plug-in estimate."""
    bias_nats: float
    """Miller and Madow's estimate of the bias by which the mutual information is too high."""
    sigma_nats: float | None
    """Standard error of the mutual information, over parts of the images; None if all points lie in one part."""
    overlap: float
    """Share of the image's area that visible points cover."""
    num_pairs: int | None
    """Number of returns that the registration placed on pixels; None without a registration."""
    num_inliers: int | None
    """Number of inliers of PnP; None without PnP."""
    rotation_from_best_deg: float
    """Angle of the rotation between this mounting and the best one."""

    @property
    def corrected_nats(self) -> float:
        """Mutual information minus its bias, by which mountings are ranked."""
        return self.mutual_information_nats - self.bias_nats

    def margin(self, other: Mounting) -> float:
        """Compute how much worse another mounting is, in standard errors of the difference of mutual information.

        The two errors are assumed to be independent. If the views overlap, they are not, and the margin is too small,
        which is on the safe side.
        """
        if self.sigma_nats is None or other.sigma_nats is None:
            return 0.0
        sigma = math.hypot(self.sigma_nats, other.sigma_nats)
        # Without scatter the error is unknown, so there is no margin.
        return (self.corrected_nats - other.corrected_nats) / sigma if sigma > 0.0 else 0.0


def describe(candidate: Candidate, agreement: core.Agreement, T_best: Pose) -> Mounting:
    """Describe a candidate by the agreement of the labels at its pose, and by its rotation from the best pose."""
    return Mounting(
        T_camera_lidar=orthonormal(candidate.T_camera_lidar),
        mutual_information_nats=agreement.mutual_information,
        bias_nats=agreement.bias,
        sigma_nats=agreement.sigma if math.isfinite(agreement.sigma) else None,
        overlap=agreement.overlap,
        num_pairs=candidate.num_pairs,
        num_inliers=candidate.num_inliers,
        rotation_from_best_deg=rotation_error_deg(candidate.T_camera_lidar, T_best),
    )


def runner_up(mountings: Sequence[Mounting], min_deg: float) -> Mounting | None:
    """Find the best mounting that is rotated by at least `min_deg` from the first; None if there is none."""
    return next((other for other in mountings if other.rotation_from_best_deg >= min_deg), None)


def measured_from(T_best: Pose, mountings: Iterable[Mounting]) -> tuple[Mounting, ...]:
    """Measure the rotations of mountings from another best pose (4, 4)."""
    return tuple(
        replace(other, rotation_from_best_deg=rotation_error_deg(other.T_camera_lidar, T_best))
        for other in mountings
    )
