"""Whether the points of a frame show segments of all kinds that the cue needs."""

from __future__ import annotations

from collections.abc import Sequence

from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.observations.cues.segments import KINDS

FEW_SEGMENTS = Check(
    topic="few-segments",
    entry=Entry(
        title="Points show too few segments",
        section=PageSection.INSPECTION,
        quotes=("no ground found in this sweep, which --cue segments needs",),
        meaning="Without point labels, ground and objects are found in the points, and one of them is missing here.",
        cause="The sweep shows an empty place, the LiDAR has few channels, or it is not level.",
        remedy="Use frames with objects on the ground, or label the points.",
    ),
)


def check_segments(kinds: Sequence[str]) -> tuple[Finding, ...]:
    """Check that the points of a frame show all kinds of segments."""
    if len(kinds) == len(KINDS):
        return ()
    missing = " and no ".join(kind for kind in KINDS.values() if kind not in kinds)
    return (FEW_SEGMENTS.finding(f"no {missing} found in this sweep, which --cue segments needs"),)
