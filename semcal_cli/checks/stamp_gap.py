"""Whether sweep and image of a frame are from the same time."""

from __future__ import annotations

from semcal_cli.findings.check import Check, Limit, Measured
from semcal_cli.findings.entry import Entry, PageSection

STAMP_GAP = Check(
    topic="stamp-gap",
    entry=Entry(
        title="Sweep and image are apart in time",
        section=PageSection.INSPECTION,
        quotes=("sweep and image are 0.120 s apart",),
        meaning="The rig moved between the sweep and the image, and the drive does not say how.",
        cause="The sensors are not triggered together, the clocks differ, or frames were paired by number.",
        remedy="Give poses or a twist in `motion:`, which moves the points to the time of the image, or pair by time.",
        figure="Time between sweep and image. The check needs both stamps, and no direction of motion.",
    ),
    settings={"": Limit(at_most=0.05, unit="s", source="at 10 m/s it is half a metre")},
)


def check_gap(gap_s: float) -> Measured:
    """Check the time between sweep and image of a frame without a motion that moves the points."""
    return STAMP_GAP.measured(gap_s, f"sweep and image are {gap_s:.3f} s apart")
