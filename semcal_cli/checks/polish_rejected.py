"""Whether held-out data accept the polish."""

from __future__ import annotations

from semcal_cli.config import PolishConfig
from semcal_cli.errors import format_against_limit
from semcal_cli.estimation.refine.polish import Polish
from semcal_cli.findings.check import Check, Limit
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding

POLISH_REJECTED = Check(
    topic="polish-rejected",
    advice="check with `semcal inspect` that sweeps, images and labels belong together, or add frames",
    entry=Entry(
        title="The polish was rejected",
        section=PageSection.CONVERGENCE,
        quotes=(
            (
                "the polish was rejected; held-out data agree 4.2 standard errors worse after it "
                "(limit 3): check with `semcal inspect` that sweeps, images and labels belong together, "
                "or add frames"
            ),
        ),
        meaning=(
            "The polish improved the agreement of the data that it used, but reduced that of held-out "
            "data. The pose before the polish is kept, without an interval."
        ),
        cause="Frames contradict one another, or there are too few of them.",
        remedy="Run `semcal inspect DRIVE`, then add frames.",
        figure="Information that held-out data lose in the polish.",
    ),
    settings={
        "": Limit(
            at_most=PolishConfig.max_loss,
            unit="standard errors",
            source="36 good calibrations of development drives had at most 2.6, those with K wrong by 10 % up to 3.8",
        ),
        "several starts": Limit(
            at_most=PolishConfig.max_loss_of_tops,
            unit="standard errors",
            source=(
                "held-out data took part in the choice of the best maximum, and lose by any other; by segments, 11 "
                "good synthetic drives had 0 to 3.2, 1.9 on average"
            ),
        ),
    },
)
POLISH_NOT_TESTED = Check(
    topic="polish-not-tested",
    advice="add frames, or label more pixels",
    entry=Entry(
        title="The polish could not be tested",
        section=PageSection.CONVERGENCE,
        quotes=(
            (
                "the polish was rejected; too few pixels were held out to test it: add frames, or label "
                "more pixels"
            ),
        ),
        meaning="There is too little data to hold some out.",
        cause="There is a single small image, or one with few labels.",
        remedy="Add frames, or label more pixels.",
    ),
)
MIN_SIGMA = 1e-12
"""Minimum standard error that a loss is divided by, nats."""


def check_held_out(polished: Polish) -> tuple[Finding, ...]:
    """Check that the polish was tested on held-out data, and that these accept it."""
    test = polished.held_out
    if test.accepted:
        return ()
    if test.held_out_sigma_nats is None:
        return (
            POLISH_NOT_TESTED.finding("the polish was rejected; too few pixels were held out to test it"),
        )
    loss = -test.held_out_gain_nats / max(test.held_out_sigma_nats, MIN_SIGMA)
    less, most = format_against_limit(loss, polished.max_loss, 1)
    sentence = (
        f"the polish was rejected; held-out data agree {less} standard errors worse after it (limit {most})"
    )
    return (POLISH_REJECTED.finding(sentence),)
