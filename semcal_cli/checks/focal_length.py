"""Whether labels agree better after a refinement with another focal length."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from semcal_cli.checks.pose_fit import PoseFit, relative_information
from semcal_cli.findings.check import Check, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.phrases import OR_ESTIMATE_K
from semcal_cli.observations.observations import Observations

WRONG_FOCAL_LENGTH = Check(
    topic="focal-length",
    advice=f"check fx and fy in K, and that K belongs to images of this size, {OR_ESTIMATE_K}",
    entry=Entry(
        title="The focal length looks wrong",
        section=PageSection.CAMERA,
        quotes=(
            (
                "the focal length looks wrong, since points and images agree 4.2% better with fx and fy "
                "7% shorter: check fx and fy in K, and that K belongs to images of this size, or "
                "calibrate with --refine-intrinsics fx,fy,cx,cy"
            ),
        ),
        meaning="The labels agree better after a refinement with another focal length.",
        cause="K belongs to images of another size, crop or camera. With one frame, it may be chance.",
        remedy=(
            "Compare K with `camera_info` and the size of the images. If they agree, calibrate with "
            "the option in the advice: [when K or the clock is "
            "wrong](calibrating.md#when-k-or-the-clock-is-wrong)."
        ),
        figure="Gain of information with fx and fy 7 % longer or shorter.",
    ),
)
FOCAL_CHANGE = 0.07
"""Relative change by which the focal length is made longer and shorter. Labels must agree less well with either."""


def zoomed_observations(observations: Observations) -> dict[float, Observations]:
    """Make observations by cameras with a shorter and a longer focal length, by the relative change."""
    return {
        change: replace(observations, camera=observations.camera.zoomed(1.0 + change))
        for change in (-FOCAL_CHANGE, FOCAL_CHANGE)
    }


def check_focal_length(own: PoseFit, others: Mapping[float, PoseFit]) -> list[Measured]:
    """Compare the fit at the drive's focal length with those at others, by the relative change."""
    if not others:
        return []
    change = max(others, key=lambda change: others[change].information)
    gain = relative_information(others[change].information, own.information) - 1.0
    better = f"{gain:.1%} better" if own.information > 0.0 else "better"
    sentence = (
        f"the focal length looks wrong, since points and images agree {better} with fx and fy {abs(change):.0%} "
        f"{'longer' if change > 0.0 else 'shorter'}"
    )
    return [WRONG_FOCAL_LENGTH.measured(gain, sentence)]
