"""Uncertainty of a pose in six degrees of freedom, from the mutual information around it.

Each part of the images contributes its share, the score, to the gradient, and at the pose the scores add up to zero.
The covariance of the pose is the sandwich `H^-1 (sum_c s_c s_c^T) H^-1` of the scores `s_c` and the curvature `H`
(Huber, *The behavior of maximum likelihood estimates under nonstandard conditions*, 1967; parts as clusters: Liang and
Zeger, *Longitudinal data analysis using generalized linear models*, 1986). The parts are squares of each image, which
see different edges. If few parts determine an axis, Student's t with Satterthwaite's degrees of freedom widens its
interval.

More frames do not reduce errors that all frames share: see `Sensitivity.scatter`, `label_bleed` and
`intrinsics`. Stated errors of the intrinsics add a covariance that is known, with infinite degrees of freedom (Welch
and Satterthwaite).
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli.config import PolishConfig, SensitivityConfig
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.estimation.uncertainty.sensitivity import MANY, determined_sensitivity, sensitivity
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.frame_selection import few_frames
from semcal_cli.observations.observations import NO_CLASS, Observations
from semcal_cli.result.uncertainty import LabelBleed, Uncertainty

BLEED_FRAMES = 2
"""Number of frames from which the effect of bleeding labels is computed; all frames show the same effect."""
CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.uint8)
"""Structuring element: a pixel and its four neighbours."""


def estimate_uncertainty(
    observations: Observations,
    T_camera_lidar: Pose,
    *,
    of_others: Matrix | None = None,
) -> Uncertainty | None:
    """Estimate the uncertainty of a polished pose.

    Args:
        observations: The observations that the pose was polished on.
        T_camera_lidar: (4, 4), metres.
        of_others: (6, 6) covariance of the pose from what keeps the drive's values: stated errors of the intrinsics,
            and errors of intrinsics or the clock that the estimate leaves open.

    Returns:
        The uncertainty; None if the labels do not determine the pose.
    """
    # Cues with many maxima are rough at full resolution, where maxima are as wide as a pixel.
    measure = determined_sensitivity if observations.is_multimodal else sensitivity
    around = measure(observations, T_camera_lidar, SensitivityConfig())
    if around is None or not around.is_determined:
        return None
    scatter = around.scatter(around.influence)
    uncertainty = Uncertainty.from_covariance(T_camera_lidar, scatter.covariance, scatter.degrees_of_freedom)
    return with_others(uncertainty, T_camera_lidar, of_others)


def with_others(uncertainty: Uncertainty, T_camera_lidar: Pose, of_others: Matrix | None) -> Uncertainty:
    """Add the covariance (6, 6) of the pose (4, 4) from errors of what keeps the drive's values.

    Weak directions stay those that more frames would improve.
    """
    if of_others is None or not of_others.any():
        return uncertainty
    covariance, freedom = np.array(uncertainty.covariance), np.array(uncertainty.degrees_of_freedom)
    wider = 1.0 + np.diag(of_others) / np.diag(covariance)
    together = Uncertainty.from_covariance(
        T_camera_lidar, covariance + of_others, np.minimum(freedom * wider**2, MANY)
    )
    return together.model_copy(update={"weak_directions": uncertainty.weak_directions})


def label_bleed(
    observations: Observations, T_camera_lidar: Pose, config: PolishConfig, label_gain: Matrix | None = None
) -> LabelBleed | None:
    """Compute how far the pose moves if the labels of all images bleed by one pixel.

    A few frames are polished twice, with their own labels and with rare classes grown.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4) polished pose, metres.
        config: Settings of the polish.
        label_gain: (6, 6) gain from a twist of the labels' optimum to a twist of the pose; identity if not given.

    Returns:
        The movement of the camera; None if one of the two polishes does not settle.
    """
    few = few_frames(observations, BLEED_FRAMES)
    as_they_are = newton(few, T_camera_lidar, config)
    labels = grow_rare_classes([image.classes for image in few.images])
    bleeding = few.with_images(
        image.without_shares().with_classes(classes)
        for image, classes in zip(few.images, labels, strict=True)
    )
    after = newton(bleeding, as_they_are.T_camera_lidar, config, as_they_are.inverse_curvature)
    if max(as_they_are.moved_px, after.moved_px) > config.settled_px:
        return None
    difference = compare_poses(after.T_camera_lidar, as_they_are.T_camera_lidar)
    # A translation in the camera frame moves the camera's centre in the opposite direction.
    twist = np.concatenate([-np.array(difference.camera_center_xyz_m), np.array(difference.rotation_xyz_rad)])
    moved = np.abs(twist if label_gain is None else label_gain @ twist)
    return LabelBleed(camera_center_m=moved[:3].tolist(), rotation_deg=np.degrees(moved[3:]).tolist())


def grow_rare_classes(images: Sequence[npt.NDArray[np.uint8]]) -> list[npt.NDArray[np.uint8]]:
    """Let the rarer of two neighbouring classes grow over the commoner one by one pixel.

    Args:
        images: (H, W) classes of each label image.

    Returns:
        (H, W) classes of each label image, grown.
    """
    sizes = np.sum([np.bincount(image.ravel(), minlength=NO_CLASS + 1) for image in images], axis=0)
    sizes[NO_CLASS] = np.iinfo(sizes.dtype).max  # NO_CLASS counts as the commonest, so it grows over nothing.
    classes = np.argsort(sizes, kind="stable").astype(np.uint8)
    ranks = np.argsort(classes).astype(np.uint8)
    grown = [classes[cv2.erode(ranks[image], CROSS)] for image in images]
    return [
        np.where(image == NO_CLASS, NO_CLASS, after).astype(np.uint8)
        for image, after in zip(images, grown, strict=True)
    ]
