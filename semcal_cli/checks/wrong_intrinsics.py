"""Whether labels would change fx, fy, cx, cy and k1 if these were free."""

from __future__ import annotations

import numpy as np

from semcal_cli.drive.camera import Camera
from semcal_cli.errors import format_against_limit
from semcal_cli.estimation.uncertainty.intrinsics import INTRINSICS
from semcal_cli.estimation.uncertainty.sensitivity import Sensitivity
from semcal_cli.findings.check import Check, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.phrases import OR_ESTIMATE_K
from semcal_cli.geometry.arrays import Matrix

WRONG_INTRINSICS = Check(
    topic="intrinsics",
    advice=(
        "check K and the distortion, and that K belongs to images of this size, or calibrate the lens again, "
        f"{OR_ESTIMATE_K}"
    ),
    entry=Entry(
        title="The intrinsics look wrong",
        section=PageSection.CAMERA,
        quotes=(
            (
                "the intrinsics look wrong (cx by 6.1 standard errors), since freeing them would move "
                "points by 14 pixels or more, chi-square 61 with 5 degrees of freedom, needed at most 12: "
                "check K and the distortion, and that K belongs to images of this size, or calibrate the "
                "lens again, or calibrate with --refine-intrinsics fx,fy,cx,cy"
            ),
        ),
        meaning=(
            "If fx, fy, cx, cy and k1 were free together with the pose, the labels would change them a lot."
        ),
        cause=(
            "The principal point is wrong, distortion is missing or applied twice (rectified images), "
            "or images are cropped."
        ),
        remedy=(
            "Check whether the images are raw or rectified, and that K and `distortion` belong to "
            "them. If they do, calibrate with the option in the advice, with `k1` and other "
            "coefficients where distortion may be wrong: [when K or the clock is "
            "wrong](calibrating.md#when-k-or-the-clock-is-wrong)."
        ),
        figure=(
            "Score of the freed intrinsics (chi-square with 5 degrees of freedom, for many frames), "
            "and movement of the points relative to the image width. The check needs a pose that is "
            "determined."
        ),
    ),
)
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


def check_intrinsics(around: Sensitivity | None, camera: Camera, num_scenes: int) -> tuple[Measured, ...]:
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
    changes = [f"{name} by {off:.1f}" for name, off in zip(INTRINSICS, deviations, strict=True) if off > 2.0]
    which = f" ({', '.join(changes)} standard errors)" if changes else ""
    chi2_text, most = format_against_limit(chi2, limit)
    sentence = (
        f"the intrinsics look wrong{which}, since freeing them would move points by {moved_px:.0f} pixels or more, "
        f"chi-square {chi2_text} with 5 degrees of freedom, needed at most {most}"
    )
    return (WRONG_INTRINSICS.measured(min(chi2 / limit, moved_px / limit_px), sentence),)


def _damped_px(score: Matrix, curvature: Matrix, motions: Matrix, min_curvature: float) -> float:
    """Compute the length of a Newton step in pixels, with curvatures of at least `min_curvature` per square pixel."""
    root = np.linalg.inv(np.linalg.cholesky(motions))
    bends, directions = np.linalg.eigh(root @ curvature @ root.T)
    return float(np.linalg.norm(directions.T @ root @ score / np.maximum(bends, min_curvature)))
