"""Effect of errors of the intrinsics on the pose, evidence of the labels against them, and their plausibility.

A change `dk` of the intrinsics moves the optimum of the pose by `-H_pp^-1 H_pk dk`, where `H_pp` and `H_pk` are blocks
of the curvature of the mutual information over pose and intrinsics. All frames share the intrinsics, so more frames do
not reduce the effect of their errors.
"""

from __future__ import annotations

import numpy as np

from semcal_cli.config import SensitivityConfig
from semcal_cli.drive.camera import DEFAULT_FOCAL_SIGMA, Camera, IntrinsicsSigma, default_sigma, sigma_of
from semcal_cli.errors import told_apart
from semcal_cli.estimation.uncertainty.sensitivity import Sensitivity, bending, sensitivity
from semcal_cli.findings.check import WRONG_INTRINSICS, Measured
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.observations.observations import Observations
from semcal_cli.result.uncertainty import IntrinsicsCost, PoseChange

INTRINSICS = ("fx", "fy", "cx", "cy", "k1")
VARIABLES = ("fx", "fy", "cx", "cy", "radial")
"""The same for the core; k1 is that of a small radial distortion on top of the lens."""
AROUND_INTRINSICS = SensitivityConfig(factor=4, edge_band_px=0, max_points=150_000)
"""Settings of the sensitivity to the intrinsics, in blocks of pixels because errors of intrinsics exceed one pixel. On
two development drives, poses polished with K off by 4 pixels or 0.5 % moved by what the blocks predict within 2 to 14 %
of the displacement of the points, as in full resolution; the small effect of fy with 4 frames was 29 % off."""
AROUND_INTRINSICS_OF_EDGES = SensitivityConfig(factor=2, edge_band_px=0)
"""The same for edges and intensity, whose levels blocks of four pixels wash out. With these, one good calibration of
five on a real jam was reported to have wrong intrinsics; with blocks of two pixels, none of nine on three drives."""
MIN_FALL = 0.2
"""Curvature floor along a change of the intrinsics in pixels, relative to the median of the pose's six curvatures.
Along some changes the information hardly falls, or even rises, and an undamped step would be arbitrarily long."""
FEW_FRAMES = 4
"""Number of frames, or fewer, with which the limit is twice that of many. The score scatters more widely than
chi-square with five degrees of freedom: squares of one image depend on one another, so few frames are few independent
parts (Hotelling), and blocks of pixels leave a bias of fy."""
SHARED_FRAMES = 24.0
"""Effective number of independent frames in infinitely many frames of one drive, because they share errors. With what
the points of a class share in its place, and with errors that K may have, a limit that none of 72 good runs exceeds
found a focal length that is 1 % off in 0 and 6 % of the runs of 5 and 20 frames, instead of 19 and 11 %: few classes
bound the score."""
MIN_PX = 3.0
"""Smallest limit of the movement of the points by freed intrinsics, in pixels, because blocks of pixels leave a bias of
about one pixel."""
MAX_DECENTRED = 0.04
"""Largest distance of the principal point from the image centre without a note, relative to the longer side.
Lenses are off by the same length in both directions. Published cameras (KITTI, nuScenes, RELLIS-3D, OpenCalib) are off
by at most 0.03, and images of which a tenth was cut off at one side of the longer sides by 0.05."""
MAX_ASPECT = 0.02
"""Largest difference of fx / fy from 1 without a note. Pixels are square to 0.2 % in the same cameras; images that
were resized without keeping their shape, as 1920 x 1200 to 1280 x 720, differ by 10 %."""


def around_intrinsics(observations: Observations, T_camera_lidar: Pose) -> Sensitivity | None:
    """Compute the curvature and scores of the mutual information over pose, fx, fy, cx, cy and k1."""
    config = AROUND_INTRINSICS_OF_EDGES if observations.is_local else AROUND_INTRINSICS
    return sensitivity(observations, T_camera_lidar, config, VARIABLES)


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


def covariance_of_intrinsics(shift: Matrix | None, camera: Camera) -> Matrix | None:
    """Compute the covariance (6, 6) of the pose from errors of the intrinsics; None if they are exact or unknown.

    Args:
        shift: (6, n) result of `shift_by`, first by fx, fy, cx and cy.
        camera: The camera, which may state the errors.
    """
    if shift is None:
        return None
    stated = sigma_of(camera)
    by_sigma = shift[:, :4] * [stated.fx, stated.fy, stated.cx, stated.cy]
    return np.asarray(by_sigma @ by_sigma.T) if by_sigma.any() else None


def intrinsics_cost(shift: Matrix, camera: Camera) -> IntrinsicsCost:
    """State how far slightly wrong intrinsics move the pose.

    Args:
        shift: (6, n) result of `shift_by`, first by fx, fy, cx and cy.
        camera: The camera.
    """
    assumed = default_sigma(camera)
    moved = np.abs(shift[:, :4]) * [assumed.fx, assumed.fy, assumed.cx, assumed.cy]
    changes = [
        PoseChange(camera_center_m=each[:3].tolist(), rotation_deg=np.degrees(each[3:]).tolist())
        for each in moved.T
    ]
    return IntrinsicsCost(**dict(zip(INTRINSICS, changes, strict=False)))


def implausible_intrinsics(camera: Camera) -> dict[str, str]:
    """Compare the principal point and the ratio of the focal lengths with those of real cameras.

    Returns:
        A sentence for each implausible intrinsic, by name.
    """
    if camera.model == "equirectangular":
        return {}  # Its principal point may be anywhere in a full turn.
    (fx, _, cx), (_, fy, cy), _ = camera.K
    sentences = {}
    for name, center, size in (("cx", cx, camera.width), ("cy", cy, camera.height)):
        share = abs(center - 0.5 * (size - 1)) / max(camera.width, camera.height)
        if share > MAX_DECENTRED:
            sentences[name] = (
                f"{name} in K is {center:g} in an image of {size}, {share:.0%} of the longer side from the "
                f"middle, usually at most {MAX_DECENTRED:.0%}: K may belong to images of another size, or "
                "the images are cropped"
            )
    if abs(fx / fy - 1.0) > MAX_ASPECT:
        sentences["fx"] = (
            f"fx in K is {fx / fy:.3f} times fy, usually 1 within {MAX_ASPECT:.0%}: K may belong to "
            "images that were resized differently"
        )
    return sentences


def notes_on_intrinsics(camera: Camera, cost: IntrinsicsCost | None) -> tuple[str, ...]:
    """Note implausible intrinsics with what their errors cost, and errors that no interval contains."""
    notes = []
    for name, sentence in implausible_intrinsics(camera).items():
        if cost is not None:
            change: PoseChange = getattr(cost, name)
            moved_cm = 100.0 * np.linalg.norm(change.camera_center_m)
            turned_deg = np.linalg.norm(change.rotation_deg)
            by = "each pixel" if name.startswith("c") else f"each {DEFAULT_FOCAL_SIGMA:.1%}"
            sentence += (
                f"; {by} of error in {name} moves the pose by {moved_cm:.2f} cm and {turned_deg:.3f} degrees"
            )
        notes.append(sentence)
    if cost is None and sigma_of(camera) != IntrinsicsSigma():
        notes.append("the interval does not include errors of K, because their effect could not be computed")
    return tuple(notes)


def wrong_intrinsics(around: Sensitivity | None, camera: Camera, num_scenes: int) -> tuple[Measured, ...]:
    """Test whether the mutual information rises with fx, fy, cx, cy and k1 free and the pose following them.

    It is Rao's score test, robust to points that depend on one another. Both limits must be exceeded: that of chance
    for the score, and that of ordinary cameras in pixels.
    """
    if around is None or not around.is_determined:
        return ()
    pose, free = slice(0, 6), slice(6, None)
    H, motions = around.curvature, around.motions
    following = -np.linalg.solve(H[pose, pose], H[pose, free])
    jacobian = np.vstack([following, np.eye(H.shape[0] - 6)])
    score = around.scores.sum(axis=0) @ jacobian
    covariance = around.noise(jacobian)[0] * (1.0 + num_scenes / SHARED_FRAMES)
    chi2 = float(score @ np.linalg.solve(covariance, score))
    curvature = H[free, free] + H[free, pose] @ following
    inverse = np.linalg.pinv(curvature)
    sigmas = np.sqrt(np.maximum(np.diag(inverse @ covariance @ inverse.T), np.finfo(float).tiny))
    deviations = np.abs(np.linalg.lstsq(curvature, score)[0]) / sigmas
    scale = 1.0 / np.sqrt(np.diag(motions)[pose])
    usual = float(np.median(np.linalg.eigvalsh(H[pose, pose] * np.outer(scale, scale))))
    moved_px = _damped_px(score, curvature, jacobian.T @ motions @ jacobian, MIN_FALL * usual)
    limit = WRONG_INTRINSICS.limit("chi-square") * (1.0 + FEW_FRAMES / max(num_scenes, FEW_FRAMES))
    limit_px = max(WRONG_INTRINSICS.limit("movement") * camera.width, MIN_PX)
    changes = [
        f"{name} by {each:.1f}" for name, each in zip(INTRINSICS, deviations, strict=True) if each > 2.0
    ]
    which = f" ({', '.join(changes)} standard errors)" if changes else ""
    chi2_text, most = told_apart(chi2, limit)
    sentence = (
        f"the intrinsics look wrong{which}, since freeing them would move points by {moved_px:.0f} pixels or more, "
        f"chi-square {chi2_text} with 5 degrees of freedom, needed at most {most}"
    )
    return (WRONG_INTRINSICS.measured(min(chi2 / limit, moved_px / limit_px), sentence),)


def _damped_px(score: Matrix, curvature: Matrix, motions: Matrix, least: float) -> float:
    """Compute the length in pixels of a Newton step in which no direction curves less than `least` per square pixel."""
    root = np.linalg.inv(np.linalg.cholesky(motions))
    bends, directions = np.linalg.eigh(root @ curvature @ root.T)
    return float(np.linalg.norm(directions.T @ root @ score / np.maximum(bends, least)))
