"""Whether the search leaves another mounting that explains the labels as well as the best one, or none to compare."""

from __future__ import annotations

from semcal_cli.estimation.search.mounting import Mounting
from semcal_cli.estimation.search.mounting_search import Initialization
from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.findings.phrases import BY_HAND, ELSEWHERE, describe_rival_fit

OTHER_MOUNTING = Check(
    topic="other-mounting",
    advice=BY_HAND,
    advice_beside_start=ELSEWHERE,
    entry=Entry(
        title="Another mounting explains the labels",
        section=PageSection.MOUNTING,
        quotes=(
            (
                "a mounting 31 degrees away explains the labels only 1.62 standard errors worse; a trusted "
                "pose must beat every other by 2: add frames from other places, or measure the mounting by hand "
                "and give it with --init-rpy-xyz"
            ),
        ),
        meaning=(
            "The search over all directions found a second one that cannot be distinguished from the best."
        ),
        cause="There are one or two frames, the lens is narrow, or all frames show the same scene.",
        remedy=(
            "Use four frames or more from different places. If you know the mounting to a few "
            "degrees, give it with `--init-rpy-xyz` and `--search-deg 30`: nothing farther away is "
            "then considered."
        ),
        figure="How much less information the best mounting in another direction has.",
    ),
)
NOTHING_TO_COMPARE = Check(
    topic="nothing-to-compare",
    advice=BY_HAND,
    advice_beside_start=ELSEWHERE,
    entry=Entry(
        title="Nothing to compare with",
        section=PageSection.MOUNTING,
        quotes=(
            (
                "the search left no other mounting to compare with: add frames from "
                "other places, or measure the mounting by hand and give it with --init-rpy-xyz"
            ),
        ),
        meaning="Only one mounting came out of the search, so its lead cannot be measured.",
        cause="Sweeps and images overlap in few directions, or few points have labels.",
        remedy="Add frames from other places, or measure the mounting and give it with `--init-rpy-xyz`.",
    ),
)
MIN_RUNNER_UP_MARGIN = OTHER_MOUNTING.limit()
"""Standard errors of mutual information by which other mountings must be behind a trusted answer."""


def check_mountings(search: Initialization, refined: Mounting | None = None) -> tuple[Finding, ...]:
    """Check that a search has found another mounting, and that it is far enough behind the best one.

    Priors, or a search around a given pose, may leave no other mounting, which is no finding.

    Args:
        search: The mountings that were compared.
        refined: The best one after its refinement, if the runner-up is compared with that.
    """
    if (other := search.runner_up) is None:
        is_alone = search.is_exhaustive or refined is not None
        sentence = "the search left no other mounting to compare with"
        return (NOTHING_TO_COMPARE.finding(sentence),) if is_alone else ()
    margin = (refined or search.hypotheses[0]).margin(other)
    sentence = (
        f"a mounting {other.rotation_from_best_deg:.0f} degrees away explains the labels "
        f"{describe_rival_fit(margin, MIN_RUNNER_UP_MARGIN, 2)}"
    )
    return OTHER_MOUNTING.measured(margin, sentence).findings


def describe_mountings(search: Initialization) -> str:
    """Describe how many mountings were compared, and whether the best one is clear."""
    margin, count = search.runner_up_margin, len(search.hypotheses)
    if margin is None:
        return "mounting found, no other one to compare with"
    if margin >= MIN_RUNNER_UP_MARGIN:
        return f"{count} candidate mountings compared, the best one is clear"
    return f"{count} candidate mountings compared; two fit about equally well, so the refined poses decide"
