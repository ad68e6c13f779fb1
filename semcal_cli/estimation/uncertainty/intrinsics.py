"""Effect of errors of the intrinsics on the pose.

A change `dk` of the intrinsics moves the optimum of the pose by `-H_pp^-1 H_pk dk`, where `H_pp` and `H_pk` are blocks
of the curvature of the mutual information over pose and intrinsics. All frames share the intrinsics, so more frames do
not reduce the effect of their errors.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from semcal_cli.config import SensitivityConfig
from semcal_cli.drive.camera import Camera, default_sigma, sigma_of
from semcal_cli.estimation.uncertainty.sensitivity import Sensitivity, bending, sensitivity
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.observations.observations import Observations
from semcal_cli.result.uncertainty import IntrinsicsCost, PoseChange

INTRINSICS = ("fx", "fy", "cx", "cy", "k1")
VARIABLES = ("fx", "fy", "cx", "cy", "radial")
"""The same for the core; k1 is that of a small radial distortion on top of the lens."""
AROUND_INTRINSICS = SensitivityConfig(factor=4, max_points=30_000)
"""Settings of the sensitivity to the intrinsics, in blocks of pixels because errors of intrinsics exceed one pixel, and
to be used without an edge band. On two development drives, poses polished with K off by 4 pixels or 0.5 % moved by what
the blocks predict within 2 to 14 % of the displacement of the points, as in full resolution; the small effect of fy
with 4 frames was 29 % off."""
AROUND_INTRINSICS_OF_EDGES = SensitivityConfig(factor=2)
"""The same for edges and intensity, whose levels blocks of four pixels wash out. With these, one good calibration of
five on a real jam was reported to have wrong intrinsics; with blocks of two pixels, none of nine on three drives."""


def around_intrinsics(
    observations: Observations,
    T_camera_lidar: Pose,
    variables: Sequence[str] = VARIABLES,
    twists_per_s: Sequence[Sequence[float]] | None = None,
) -> Sensitivity | None:
    """Compute the curvature and scores of the mutual information over the pose and other variables.

    Args:
        observations: Points and pixels.
        T_camera_lidar: (4, 4) pose, metres.
        variables: Intrinsics, by their names in the core.
        twists_per_s: (F, 6) motion of the LiDAR in each frame, metres and radians per second, if the time offset is a
            variable, too.
    """
    config = AROUND_INTRINSICS_OF_EDGES if observations.is_local else AROUND_INTRINSICS
    return sensitivity(observations.without_edge_band, T_camera_lidar, config, variables, twists_per_s)


def shift_by(around: Sensitivity | None) -> Matrix | None:
    """Compute how much the optimum of the pose moves per unit of the variables after it.

    The pose does not move in directions in which the mutual information does not fall.

    Args:
        around: The sensitivity to the pose and n variables, such as intrinsics.

    Returns:
        (6, n) twist in metres and radians on the left of the pose, by a unit of each variable; None if the mutual
        information falls in no direction.
    """
    if around is None:
        return None
    scale, bends, directions = bending(around.curvature[:6, :6], around.motions[:6, :6])
    if len(bends) == 0:
        return None
    basis = scale[:, None] * directions
    return np.asarray(-(basis / bends) @ basis.T @ around.curvature[:6, 6:])


def twist_by_intrinsics(shift: Matrix | None, camera: Camera) -> Matrix | None:
    """Compute the twist (6, 4) of the pose by an error of one standard deviation of fx, fy, cx and cy.

    Times its transpose, it is the covariance of the pose from errors of the intrinsics.

    Args:
        shift: (6, n) result of `shift_by`, first by fx, fy, cx and cy.
        camera: The camera, which may state the errors.

    Returns:
        None if the intrinsics are exact, or their effect is unknown.
    """
    if shift is None:
        return None
    stated = sigma_of(camera)
    by_sigma = shift[:, :4] * [stated.fx, stated.fy, stated.cx, stated.cy]
    return np.asarray(by_sigma) if by_sigma.any() else None


def intrinsics_cost(shift: Matrix, camera: Camera) -> IntrinsicsCost:
    """State how far slightly wrong intrinsics move the pose.

    Args:
        shift: (6, n) result of `shift_by`, first by fx, fy, cx and cy.
        camera: The camera.
    """
    assumed = default_sigma(camera)
    moved = np.abs(shift[:, :4]) * [assumed.fx, assumed.fy, assumed.cx, assumed.cy]
    changes = [
        PoseChange(camera_center_m=change[:3].tolist(), rotation_deg=np.degrees(change[3:]).tolist())
        for change in moved.T
    ]
    return IntrinsicsCost(**dict(zip(INTRINSICS, changes, strict=False)))
