"""Whether the motion of a drive is the one that skewed its sweeps."""

from __future__ import annotations

import math

from semcal_cli.findings.check import Check, Limit, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.result.sections import MeasuredSpeed

WRONG_MOTION = Check(
    topic="wrong-motion",
    advice=(
        "check the axes, signs and units of `motion:`, which is that of the LiDAR in its own frame, and "
        "`lidar.spin`; without `motion:`, sweeps are deskewed by the speed that they show"
    ),
    entry=Entry(
        title="The motion is not the one that skewed the sweeps",
        section=PageSection.STATED,
        quotes=(
            (
                "with the stated `motion:`, the sweeps still show 14.8 +- 1.1 m/s along the view, 13.9 standard errors "
                "(limit 4): check the axes, signs and units of `motion:`, which is that of the LiDAR in its own frame, "
                "and `lidar.spin`; without `motion:`, sweeps are deskewed by the speed that they show"
            ),
        ),
        meaning=(
            "A LiDAR that turns while it moves skews its sweeps, and images show by how much. Once sweeps are "
            "deskewed by `motion:`, or where it says that the rig stood, they should show no speed any more."
        ),
        cause=(
            "The twist has a wrong sign or the axes of the camera or the vehicle, the poses are of another time, or "
            "`lidar.spin` states a wrong rate or direction."
        ),
        remedy="Correct the motion, or leave it out.",
        figure=(
            "Speed that is left, in its standard errors, with the principal point free so that a wrong K does not look "
            "like a speed. "
            "The check needs `lidar.spin`, a triggered camera and four scenes."
        ),
    ),
    explains=frozenset({"intrinsics"}),
    settings={
        "": Limit(
            at_most=4.0,
            unit="standard errors",
            source=(
                "fifteen frames of KITTI at 7 to 9 m/s are 0.7 off by a twist of 8 m/s, and 6.6 to 14.1 by twists with "
                "a wrong sign or wrong axes"
            ),
        )
    },
)


def check_stated_motion(left: MeasuredSpeed, sigma_m_s: float) -> Measured:
    """Check that sweeps show no speed after they were deskewed by the stated motion.

    Args:
        left: Speed along the view that the deskewed sweeps still show.
        sigma_m_s: Standard deviation of the stated speed, metres per second.
    """
    sigmas = abs(left.along_view_m_s) / math.hypot(left.sigma_m_s, sigma_m_s)
    sentence = (
        f"with the stated `motion:`, the sweeps still show {left.along_view_m_s:.1f} +- {left.sigma_m_s:.1f} m/s along "
        f"the view, {sigmas:.1f} standard errors (limit {WRONG_MOTION.limit():g})"
    )
    return WRONG_MOTION.measured(sigmas, sentence)
