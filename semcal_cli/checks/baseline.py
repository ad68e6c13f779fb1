"""Whether a pose was held at the largest distance between camera and LiDAR that is allowed."""

from __future__ import annotations

from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import baseline_m

FAR_CAMERA = Check(
    topic="baseline",
    advice="give a larger --max-baseline-m if the camera is farther away",
    entry=Entry(
        title="The camera is at its largest allowed distance",
        section=PageSection.CAMERA,
        quotes=(
            (
                "the camera reached 3 m from the LiDAR, the limit of --max-baseline-m: give a larger "
                "--max-baseline-m if the camera is farther away"
            ),
        ),
        meaning="The labels pull the camera farther away than allowed.",
        cause=(
            "The camera is farther away (on a lorry), the point clouds are in another unit, or the "
            "position is not determined."
        ),
        remedy=(
            "Raise `--max-baseline-m` if the camera is farther away; otherwise check the unit of the "
            "point clouds, and add frames."
        ),
    ),
)
AT_LIMIT = 0.999
"""Fraction of the largest allowed distance from which a camera counts as clamped to it."""


def check_baseline(T_camera_lidar: Pose, max_baseline_m: float) -> tuple[Finding, ...]:
    """Check that a pose (4, 4) is nearer than the limit that the refinement respected."""
    distance_m = baseline_m(T_camera_lidar)
    if distance_m < AT_LIMIT * max_baseline_m:
        return ()
    sentence = f"the camera reached {distance_m:.3g} m from the LiDAR, the limit of --max-baseline-m"
    return (FAR_CAMERA.finding(sentence),)
