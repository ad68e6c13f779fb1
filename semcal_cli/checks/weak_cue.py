"""Whether a pose that other checks contradict rests on weak cues alone."""

from __future__ import annotations

from collections.abc import Sequence

from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.findings.symptoms import OF_A_WRONG_POSE

WEAK_CUE = Check(
    topic="weak-cue",
    advice="compare edges (--cue edges, or segments,edges with image labels), or label the points",
    explains=OF_A_WRONG_POSE | {"far-start"},
    entry=Entry(
        title="The cue is weak",
        section=PageSection.MOUNTING,
        quotes=(
            (
                "intensity alone is a weak cue, whose best pose is often wrong: compare edges (--cue edges, or "
                "segments,edges with image labels), or label the points"
            ),
        ),
        meaning=(
            "The pose rests on intensity or segments alone, and other reasons contradict it. What they measured at "
            "this pose says little about the drive."
        ),
        cause="Intensity and segments have many maxima, or one that is degrees wide.",
        remedy="Compare edges, which need a start or image labels, or label the points.",
    ),
)


def check_strength(cues: Sequence[str], findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Name weak cues as the likeliest cause of other findings.

    Args:
        cues: Cues that the pose rests on, if all of them are weak; else none.
        findings: Everything else that speaks against the pose.
    """
    if not cues or not WEAK_CUE.explains & {finding.topic for finding in findings}:
        return ()
    are = "alone is a weak cue" if len(cues) == 1 else "are weak cues"
    return (WEAK_CUE.finding(f"{' and '.join(cues)} {are}, whose best pose is often wrong"),)
