"""Whether the refinement, the polish and the fusion with priors moved the pose little at their end."""

from __future__ import annotations

import math

from semcal_cli.config import PolishConfig, PyramidConfig
from semcal_cli.errors import format_against_limit
from semcal_cli.estimation.adjust.priors import MAX_ROUNDS, Fused
from semcal_cli.estimation.refine.polish import Polish
from semcal_cli.estimation.refine.pyramid import Refinement
from semcal_cli.findings.check import Check, Limit
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.findings.phrases import NEARER

REFINEMENT_NOT_SETTLED = Check(
    topic="refinement-not-settled",
    advice=NEARER,
    entry=Entry(
        title="The refinement had not settled",
        section=PageSection.CONVERGENCE,
        quotes=(
            (
                "the refinement had not settled; the pose still moved points by 0.8 pixels at the end of "
                "the finest level (limit 0.5): add frames, or start nearer with --init"
            ),
        ),
        meaning="The ascent was still moving when it ended.",
        cause="There are few points or frames, or the start is too far off.",
        remedy="Add frames. With `--init`, start nearer; without it, do not narrow the search.",
        figure="Movement of the points at the end of the finest level.",
    ),
    settings={
        "": Limit(
            at_most=PyramidConfig.max_final_drift,
            unit="blocks",
            source="a choice, half a pixel at the finest level; it was not measured",
        )
    },
)
POLISH_NOT_SETTLED = Check(
    topic="polish-not-settled",
    advice=NEARER,
    entry=Entry(
        title="The polish had not settled",
        section=PageSection.CONVERGENCE,
        quotes=(
            (
                "the polish had not settled; its last round still moved points by 0.21 pixels "
                "(limit 0.1): add frames, or start nearer with --init"
            ),
        ),
        meaning="Newton's method on all points jumped between poses that are about equally good.",
        cause="There are few frames, or the borders of labels are ragged.",
        remedy="Add frames; for ragged borders, `--edge-band 2` or more.",
        figure="Movement of the points in the last round of the polish.",
    ),
    settings={
        "": Limit(
            at_most=PolishConfig.settled_px,
            unit="pixels",
            source="a choice, ten times the movement at which the rounds of the polish end; it was not measured",
        )
    },
)
FUSION_NOT_SETTLED = Check(
    topic="fusion-not-settled",
    advice=NEARER,
    entry=Entry(
        title="Data and priors had not settled",
        section=PageSection.CONVERGENCE,
        quotes=(
            (
                "the pose from data and priors had not settled after 20 rounds: add frames, or start "
                "nearer with --init"
            ),
        ),
        meaning="The pose that combines data and priors was still moving.",
        cause="A prior is far from the pose of the data.",
        remedy="Check the prior, then add frames or start nearer.",
    ),
)


def check_refinement(refined: Refinement) -> tuple[Finding, ...]:
    """Check that the pose moved little at the end of the finest level."""
    if refined.converged:
        return ()
    moved_px, most_px = format_against_limit(refined.levels[-1].drift, refined.max_drift, 1)
    sentence = (
        f"the refinement had not settled; the pose still moved points by {moved_px} pixels at the end of the finest "
        f"level (limit {most_px})"
    )
    return (REFINEMENT_NOT_SETTLED.finding(sentence),)


def check_polish(polished: Polish) -> tuple[Finding, ...]:
    """Check that the last round of an accepted polish moved points little."""
    if not polished.is_accepted or polished.is_settled or not math.isfinite(polished.moved_px):
        return ()
    moved, most = format_against_limit(polished.moved_px, polished.max_moved_px, 2)
    sentence = (
        f"the polish had not settled; its last round still moved points by {moved} pixels (limit {most})"
    )
    return (POLISH_NOT_SETTLED.finding(sentence),)


def check_fusion(fused: Fused) -> tuple[Finding, ...]:
    """Check that data and priors agreed on a pose."""
    if fused.is_settled:
        return ()
    sentence = f"the pose from data and priors had not settled after {MAX_ROUNDS} rounds"
    return (FUSION_NOT_SETTLED.finding(sentence),)
