"""Whether labels agree better after a refinement with images at other times."""

from __future__ import annotations

from collections.abc import Mapping

from semcal_cli.checks.pose_fit import PoseFit
from semcal_cli.estimation.uncertainty.information import information_by_squares, paired_gain
from semcal_cli.findings.check import Check, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.symptoms import CLOCKS, OF_A_WRONG_CLOCK
from semcal_cli.observations.motion import delayed, differs, twists_per_s
from semcal_cli.observations.observations import Observations

WRONG_CLOCKS = Check(
    topic=CLOCKS,
    advice=(
        "calibrate with --estimate-delay, or check the clocks of camera and LiDAR and correct image_stamp"
    ),
    explains=OF_A_WRONG_CLOCK,
    options=("--estimate-delay",),
    entry=Entry(
        title="The clocks look wrong",
        section=PageSection.CAMERA,
        quotes=(
            (
                "the clocks look wrong, since points and images agree 2.4 standard errors better if "
                "images are 15 ms later than image_stamp says: calibrate with --estimate-delay, or check the "
                "clocks of camera and LiDAR and correct image_stamp"
            ),
            (
                "the clocks look wrong: images seem to be 19.7 ms later than image_stamp says, and points and "
                "images agree 2.4 standard errors better at a later time: calibrate with --estimate-delay, or "
                "check the clocks of camera and LiDAR and correct image_stamp"
            ),
        ),
        meaning="Images fit better at another time.",
        cause="The stamp is the time of reception, or the start or end of the exposure or of the sweep.",
        remedy=(
            "Calibrate with `--estimate-delay`, or correct the stamps by the delay and calibrate "
            "again: [when K or the clock is wrong](calibrating.md#when-k-or-the-clock-is-wrong). "
            "`semcal verify --max-delay-ms` checks it from then on."
        ),
        figure=(
            "Gain in information with images 15 or 50 ms earlier or later. The check needs `motion:` "
            "that differs between frames."
        ),
    ),
)
CLOCK_DELAYS_S = (-0.05, -0.015, 0.015, 0.05)
"""Delays of the images to try, in seconds."""


def delayed_observations(observations: Observations) -> dict[float, Observations]:
    """Make observations with images at other times, by the delay in seconds; none if all frames move alike."""
    twists = twists_per_s(observations)
    if twists is None or not differs(twists):
        return {}
    return {delay_s: delayed(observations, delay_s) for delay_s in CLOCK_DELAYS_S}


def check_clocks(
    observations: Observations,
    own: PoseFit,
    others: Mapping[float, tuple[Observations, PoseFit]],
    estimated_s: float,
) -> list[Measured]:
    """Compare the fit at the drive's times with those at others, by the delay in seconds.

    Args:
        observations: Points and pixels.
        own: The fit at the drive's times.
        others: The same at other times.
        estimated_s: Estimate of the delay, which is stated in place of the tried one that fits best.
    """
    if not others:
        return []
    before, sigmas = information_by_squares(observations, own.T_camera_lidar), {}
    for delay_s, (late, fit) in others.items():
        after = information_by_squares(late, fit.T_camera_lidar)
        sigmas[delay_s] = paired_gain(before, after).significance
    best_s = max(sigmas, key=lambda delay_s: sigmas[delay_s])
    better = f"points and images agree {sigmas[best_s]:.1f} standard errors better"
    side = "later" if best_s > 0.0 else "earlier"
    how = f", since {better} if images are {1e3 * abs(best_s):.0f} ms {side} than image_stamp says"
    if estimated_s * best_s > 0.0:
        how = (
            f": images seem to be {1e3 * abs(estimated_s):.1f} ms {side} than image_stamp says, and {better} "
            f"at {'a later' if best_s > 0.0 else 'an earlier'} time"
        )
    sentence = f"the clocks look wrong{how}"
    return [WRONG_CLOCKS.measured(sigmas[best_s], sentence)]
