"""Whether the frames contradict fx, fy, cx, cy or k1 of the drive, and how large an error of K they would show."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from semcal_cli.drive.camera import K_ENTRIES, Camera
from semcal_cli.errors import format_against_limit
from semcal_cli.estimation.adjust.intrinsics_estimate import IntrinsicsEstimate
from semcal_cli.findings.check import Check, Limit, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.phrases import OR_ESTIMATE_K
from semcal_cli.findings.symptoms import OF_A_WRONG_K
from semcal_cli.geometry.arrays import Numbers
from semcal_cli.readable import figure
from semcal_cli.result.refined_camera import CheckedIntrinsics, Intrinsic
from semcal_cli.result.uncertainty import NORMAL_95

WRONG_INTRINSICS = Check(
    topic="intrinsics",
    explains=OF_A_WRONG_K,
    advice=(
        "check that the images were not cropped or resized after K was measured, that K is the camera_info of this "
        f"camera and mode, and that rectified images state no distortion, {OR_ESTIMATE_K}"
    ),
    entry=Entry(
        title="The intrinsics look wrong",
        section=PageSection.CAMERA,
        quotes=(
            (
                "the frames contradict the intrinsics: cx should be 614 +- 7.5 instead of 639.6, 6.8 standard "
                "errors away (limit 3): check that the images were not cropped or resized after K was "
                "measured, that K is the camera_info of this camera and mode, and that rectified images state no "
                "distortion, or calibrate with --refine-intrinsics fx,fy,cx,cy"
            ),
        ),
        meaning=(
            "If fx, fy, cx, cy and k1 are free together with the pose, points and images agree best far from the "
            "values of the drive. The worst one is named first."
        ),
        cause=(
            "Images were cropped, resized or binned and K was not, K belongs to another camera or mode, or the "
            "distortion of the raw images is stated for rectified ones."
        ),
        remedy=(
            "Compare K with the size of the images, and find out whether they are raw or rectified. If K and "
            "`distortion` belong to them, calibrate with the option in the advice, with `k1` and other "
            "coefficients where distortion may be wrong: [when K or the clock is "
            "wrong](calibrating.md#when-k-or-the-clock-is-wrong)."
        ),
        figure=(
            "Difference of the estimate from the drive's value. Its standard error includes what drives with a right "
            "K ask for: 0.35 pixels that all scenes share and, by edges, 1.5 pixels of each scene. The check needs a "
            "pose that fits, and by edges four scenes."
        ),
    ),
    settings={
        "rotation": Limit(
            at_most=1.5,
            unit="degrees",
            source=(
                "K is not confirmed if an error of it within the limit turns the camera farther; 20 pixels turn "
                "KITTI's by 1.6"
            ),
        ),
        "position": Limit(
            at_most=0.3,
            unit="m",
            source="K is not confirmed if an error of it within the limit moves the camera farther",
        ),
    },
)


class TestedIntrinsics(NamedTuple):
    """What a check of the intrinsics found."""

    measured: tuple[Measured, ...]
    checked: CheckedIntrinsics | None
    """What the frames say of each intrinsic; None if they determine none."""
    notes: tuple[str, ...]
    """How well the frames confirm K; empty where K follows from the size of the image."""


def check_intrinsics(estimate: IntrinsicsEstimate | None, camera: Camera) -> TestedIntrinsics:
    """Compare the intrinsics that the frames ask for with those of the drive; the farthest off is named first."""
    if estimate is None:
        note = "K was not checked: these frames do not determine it"
        return TestedIntrinsics((), None, () if camera.is_exact else (note,))
    checked = _checked(estimate)
    return TestedIntrinsics((_compare(estimate),), checked, (_note(checked),))


def _compare(estimate: IntrinsicsEstimate) -> Measured:
    limit, deviations = WRONG_INTRINSICS.limit(), estimate.deviations
    words, lens_names = list[str](), ""
    for index in np.argsort(-deviations):
        if deviations[index] > limit:
            name = [*estimate.given][index]
            lens_names += "" if name in K_ENTRIES else f",{name}"
            given, half = estimate.given[name], figure(NORMAL_95 * float(estimate.sigmas[index]))
            digits = len(half.partition(".")[2])
            away, _ = format_against_limit(float(deviations[index]), limit, 1)
            words.append(
                f"{name} should be {given + estimate.changes[index]:.{digits}f} +- {half} instead of "
                f"{given:.{max(digits, 1)}f}, {away} standard errors away"
            )
    sentence = f"the frames contradict the intrinsics: {', '.join(words)} (limit {limit:g})" if words else ""
    measured = WRONG_INTRINSICS.measured(float(deviations.max()), sentence)
    if measured.finding is None:
        return measured
    # An estimate without what is accused would leave the same doubt.
    advised = measured.finding._replace(advice=f"{measured.finding.advice}{lens_names}")
    return measured._replace(finding=advised)


def _checked(estimate: IntrinsicsEstimate) -> CheckedIntrinsics:
    """State what the frames say of each intrinsic, and whether they would show an error that matters."""
    intrinsics = {}
    for (name, given), change, sigma in zip(
        estimate.given.items(), estimate.changes.tolist(), estimate.sigmas.tolist(), strict=True
    ):
        is_determined = bool(np.isfinite(sigma))
        intrinsics[name] = Intrinsic(
            given=given,
            found=given + change if is_determined else given,
            sigma=sigma if is_determined else None,
            half_width_95=NORMAL_95 * sigma if is_determined else None,
            is_determined=is_determined,
        )
    return CheckedIntrinsics(intrinsics=intrinsics, is_confirmed=_is_confirmed(estimate))


def _is_confirmed(estimate: IntrinsicsEstimate) -> bool:
    """Whether every error of the intrinsics that moves the pose far would be beyond the limit."""
    if not (estimate.is_settled and np.isfinite(estimate.sigmas).all()):
        return False
    unseen = estimate.compensation * (WRONG_INTRINSICS.limit() * estimate.sigmas)
    position_m, rotation_deg = _lengths(unseen[:3]), np.degrees(_lengths(unseen[3:]))
    return bool(
        position_m.max() <= WRONG_INTRINSICS.limit("position")
        and rotation_deg.max() <= WRONG_INTRINSICS.limit("rotation")
    )


def _lengths(vectors: Numbers) -> Numbers:
    return np.asarray(np.linalg.norm(vectors, axis=0))


def _note(checked: CheckedIntrinsics) -> str:
    """Describe to how many pixels and percent the frames confirm K, or that they do not."""
    if not checked.is_confirmed:
        return "K was checked, but these frames would not show every error of it that moves the pose far"
    shares = {name: 100.0 / checked.intrinsics[name].given for name in ("fx", "fy")}
    widths = [
        f"{name} to +- {figure(shares.get(name, 1.0) * half)} {'%' if name in shares else 'px'}"
        for name in ("cx", "cy", "fx", "fy")
        if (half := checked.intrinsics[name].half_width_95) is not None
    ]
    return f"these frames confirm {', '.join(widths)}"
