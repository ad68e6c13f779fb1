"""Whether the start that was given may be too far from the right pose, where other checks contradict the result."""

from __future__ import annotations

from collections.abc import Sequence

from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.findings.symptoms import OF_A_WRONG_POSE

FAR_START = Check(
    topic="far-start",
    advice="start nearer (`semcal view` makes a start by hand), or, with image labels, leave the start out",
    explains=OF_A_WRONG_POSE - {"clocks", "intrinsics", "odd-frames", "wrong-pairing"},
    entry=Entry(
        title="The start may be too far off",
        section=PageSection.MOUNTING,
        quotes=(
            (
                "--init-rpy-xyz may be too far off, since edges need a start within 5 degrees and 0.3 m: start "
                "nearer (`semcal view` makes a start by hand), or, with image labels, leave the start out"
            ),
        ),
        meaning=(
            "The pose was found from a given start, and other reasons say that it is wrong. A start out of reach "
            "is the likeliest cause."
        ),
        cause="The start has another direction or other axes than it should have, or it was measured roughly.",
        remedy=(
            "Look at the start with `semcal overlay` or `semcal view`. If it is right, the other reasons say what "
            "is wrong. With labels, semcal finds the mounting without a start."
        ),
    ),
)
OF_A_FAR_START = {"chance", "cues-disagree", "other-azimuth", "other-pose", "overlap", "wrong-pairing"}
"""Topics that contradict a pose as a whole, as one from a start out of reach is."""


def check_start(start: str, cues: Sequence[str], findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Name a given start as the likeliest cause of findings that contradict the pose as a whole.

    Args:
        start: Name of the start that was given.
        cues: Cues that need a start near the right pose.
        findings: Everything else that speaks against the pose.
    """
    if not cues or not OF_A_FAR_START & {finding.topic for finding in findings}:
        return ()
    within = f"since {' and '.join(cues)} need a start within 5 degrees and 0.3 m"
    return (FAR_START.finding(f"{start} may be too far off, {within}"),)
