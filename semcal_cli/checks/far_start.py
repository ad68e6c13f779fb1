"""Whether the start that was given may be too far from the right pose, where other checks contradict the result."""

from __future__ import annotations

from collections.abc import Sequence

from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.findings.symptoms import OF_A_WRONG_POSE
from semcal_cli.geometry.poses import PoseError

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
OF_A_NEAR_START = {"other-pose", "wrong-pairing"}
"""Those of them that come up alone at poses near a good start, too: other maxima beside the right one, and wrong pairs.
From starts 8 to 40 degrees off, by edges, `other-azimuth` or a pose out of reach came with them."""
REACH_DEG, REACH_M = 5.0, 0.3
"""How far off a start may be for cues that need a near one."""


def check_start(
    start: str, cues: Sequence[str], findings: Sequence[Finding], moved: PoseError | None
) -> tuple[Finding, ...]:
    """Name a given start as the likeliest cause of findings that contradict the pose as a whole.

    Args:
        start: Name of the start that was given.
        cues: Cues that need a start near the right pose.
        findings: Everything else that speaks against the pose.
        moved: Difference of the pose from the start; None if it is not known.
    """
    is_within = moved is not None and moved.is_within(REACH_DEG, REACH_M)
    speaking = OF_A_FAR_START - OF_A_NEAR_START if is_within else OF_A_FAR_START
    if not cues or not speaking & {finding.topic for finding in findings}:
        return ()
    within = f"since {' and '.join(cues)} need a start within {REACH_DEG:.0f} degrees and {REACH_M:.1f} m"
    return (FAR_START.finding(f"{start} may be too far off, {within}"),)
