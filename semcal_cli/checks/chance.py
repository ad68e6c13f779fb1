"""Whether points and images agree better than unrelated ones would."""

from __future__ import annotations

from semcal_cli import core
from semcal_cli.errors import format_against_limit
from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding

CHANCE = Check(
    topic="chance",
    advice="check that the labels belong to these sweeps and images",
    entry=Entry(
        title="No better than chance",
        section=PageSection.DETERMINATION,
        quotes=(
            (
                "points and images agree 80% as well as unrelated ones would by chance (limit "
                "100%): check that the labels belong to these sweeps and images"
            ),
        ),
        meaning="At this pose, point labels say nothing about image labels.",
        cause="The labels belong to another drive or are shuffled, or the pose is completely wrong.",
        remedy="Check the file names in the drive, frame by frame, with `semcal overlay`.",
        figure="Mutual information relative to that of unrelated labels.",
    ),
)
MIN_BIAS = 1e-12
"""Lower bound of the information by chance as a divisor, nats."""


def check_chance(agreement: core.Agreement) -> tuple[Finding, ...]:
    """Check that the labels share more information than unrelated ones would by chance."""
    by_chance = agreement.mutual_information / max(agreement.bias, MIN_BIAS)
    as_well, least = format_against_limit(by_chance, CHANCE.limit(), unit="%")
    sentence = f"points and images agree {as_well} as well as unrelated ones would by chance (limit {least})"
    return CHANCE.measured(by_chance, sentence).findings
