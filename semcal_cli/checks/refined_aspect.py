"""Whether estimated focal lengths contradict the square pixels that the drive states."""

from __future__ import annotations

from semcal_cli.findings.check import Check, Limit
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.result.refined_camera import RefinedCamera

REFINED_ASPECT = Check(
    topic="refined-aspect",
    advice=(
        "calibrate without --refine-intrinsics if K is right, or calibrate the intrinsics of the camera anew, with a "
        "board"
    ),
    entry=Entry(
        title="Estimated focal lengths contradict square pixels",
        section=PageSection.CAMERA,
        quotes=(
            (
                "the estimated fx is 1.020 times fy, where square pixels of the drive's K need 1 within 1%: "
                "calibrate without --refine-intrinsics if K is right, or calibrate the intrinsics of the camera anew, "
                "with a board"
            ),
        ),
        meaning="The drive's K has the same focal length along rows and columns, and its estimate has not.",
        cause=(
            "The frames tell one of the two focal lengths badly, as edges do fy, and the rotation of the pose is as "
            "far off. Or the images were resized without keeping their shape, and K does not say so."
        ),
        remedy="Compare K with `camera_info`. If the images were resized, correct K, and estimate it again.",
        figure="Difference of the estimated fx / fy from 1. The check needs an estimate that is kept.",
    ),
    settings={
        "": Limit(
            at_most=0.01,
            unit="%",
            source=(
                "by labels, fx and fy of 120 synthetic drives are off by at most 0.28 %; by edges, two KITTI drives "
                "with the right K end at 1.7 and 2.0 %, 0.5 and 0.6 degrees off"
            ),
        )
    },
)
SQUARE = 0.001
"""Largest difference of fx / fy from 1 in a K that states square pixels."""


def check_aspect(camera: RefinedCamera) -> tuple[Finding, ...]:
    """Check that an estimate that is kept leaves pixels square where the drive's are."""
    (fx, _, _), (_, fy, _), _ = camera.found.K
    given = {"fx": fx, "fy": fy} | {name: each.given for name, each in camera.intrinsics.items()}
    if abs(given["fx"] / given["fy"] - 1.0) > SQUARE:
        return ()
    sentence = (
        f"the estimated fx is {fx / fy:.3f} times fy, where square pixels of the drive's K need 1 within "
        f"{REFINED_ASPECT.limit():.0%}"
    )
    return REFINED_ASPECT.measured(abs(fx / fy - 1.0), sentence).findings
