"""Whether the 95 % interval of a pose is narrow enough to trust the pose."""

from __future__ import annotations

from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.result.uncertainty import Uncertainty, wide_directions

WIDE_INTERVAL = Check(
    topic="wide-interval",
    advice="add frames with near and far objects, recorded while driving",
    entry=Entry(
        title="The interval is too wide",
        section=PageSection.DETERMINATION,
        quotes=(
            (
                "the interval is too wide, +- 0.41 m along the optical axis (95 %; "
                "limits 0.25 m and 1 degree): add frames with near and far objects, recorded while driving"
            ),
        ),
        meaning="There is an interval, but it is wider than that of a trusted pose may be.",
        cause=(
            "Only near objects determine the position along the optical axis. Or K or a time offset "
            "was to be estimated, but the frames do not determine it. Or all frames have the same "
            "motion, so that nothing determines [the time offset](trust.md#the-interval), which may "
            "cost as much."
        ),
        remedy=(
            "Add frames with near objects, or a prior. For the clock, give `motion.poses` from a "
            "drive at different speeds. If the axis does not matter to you, the others are in "
            "`uncertainty:`."
        ),
        figure=(
            "Largest half width of the 95 % interval along any axis. The check needs a pose that is "
            "determined."
        ),
    ),
)
MAX_HALF_WIDTH_M = WIDE_INTERVAL.limit("position")
"""Largest half width of a 95 % interval of the camera's position of a trusted pose, in metres."""
MAX_HALF_WIDTH_DEG = WIDE_INTERVAL.limit("rotation")
"""Largest half width of a 95 % interval of the rotation of a trusted pose, in degrees."""


def check_interval(uncertainty: Uncertainty, advice: str | None = None) -> tuple[Finding, ...]:
    """Report the directions that the data do not determine well enough, with advice if it is not more frames."""
    center, rotation = wide_directions(uncertainty.half_widths, MAX_HALF_WIDTH_M, MAX_HALF_WIDTH_DEG)
    widths = [f"{half:.2f} m {name}" for name, half in center]
    widths += [f"{half:.1f} degrees {name}" for name, half in rotation]
    if not widths:
        return ()
    limits = f"limits {MAX_HALF_WIDTH_M:g} m and {MAX_HALF_WIDTH_DEG:g} degree"
    sentence = f"the interval is too wide, +- {', +- '.join(widths)} (95 %; {limits})"
    finding = WIDE_INTERVAL.finding(sentence)
    return (finding if advice is None else finding._replace(advice=advice),)
