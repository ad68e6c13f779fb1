"""Whether priors contradict the data, or the pose that data and priors give together."""

from __future__ import annotations

import numpy as np

from semcal_cli import core
from semcal_cli.errors import counted, format_against_limit
from semcal_cli.estimation.adjust.priors import Fused, OffsetFromLabels, PriorOffset
from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding

PRIOR = Check(
    topic="prior",
    advice="measure it again, or give a larger SIGMA",
    entry=Entry(
        title="A prior contradicts the data",
        section=PageSection.STATED,
        quotes=(
            (
                "--prior-translation-m 1.2 0 0.4 0.02 is 12.3 cm from the pose that the data alone "
                "give, chi-square 88 with 3 degrees of freedom (limit 31): measure it again, "
                "or give a larger SIGMA"
            ),
            (
                "--prior-rotation-deg 0 0 90 0.3 is 2.10 degrees from the pose that everything else "
                "gives, 6.3 standard deviations (limit 4): measure it again, or give a larger "
                "SIGMA"
            ),
        ),
        meaning="The prior and the data are farther apart than their standard deviations explain.",
        cause=(
            "Frames were mixed up (body or optical, LiDAR or robot base), a sign is wrong, or SIGMA "
            "is too small. `--fix` keeps axes of the start, which may be wrong."
        ),
        remedy=(
            "Calibrate without the prior and compare: `semcal compare` shows which axis differs. For `--fix`, give a "
            "start that is right along its axes, or leave it out."
        ),
        figure=(
            "Distance of a prior from the pose of the data, as its probability by chance, and from "
            "the final pose along one axis. The check needs a prior."
        ),
    ),
)
ADVICE_FIX = "give a start that is right along these axes, or leave --fix out"
"""Advice about axes of the start that `--fix` keeps."""


def check_priors(fused: Fused) -> tuple[Finding, ...]:
    """Check each prior against the pose of the data alone, and where the two agree, against the final pose."""
    return tuple(finding for offset in fused.prior_offsets for finding in _check_prior(offset))


def _check_prior(offset: PriorOffset) -> tuple[Finding, ...]:
    contradiction = () if offset.from_labels is None else _contradiction(offset.name, offset.from_labels)
    return contradiction or _distance(offset)


def _contradiction(name: str, offset: OffsetFromLabels) -> tuple[Finding, ...]:
    """Compare a prior with the optimum of the data alone, over all known axes at once."""
    # With few parts of the images, chance explains almost any distance, so the distance is limited as well.
    by_chance = core.fisher_limit(PRIOR.limit("chance"), offset.num_axes, offset.degrees_of_freedom)
    max_chi2 = offset.num_axes * min(by_chance, PRIOR.limit("one axis") ** 2)
    if offset.chi2 <= max_chi2:
        return ()
    chi2, most = format_against_limit(offset.chi2, max_chi2)
    sentence = (
        f"{name} is {_length(offset.axis, offset.offset)} from the pose that the data alone give, chi-square {chi2} "
        f"with {counted(offset.num_axes, 'degree')} of freedom (limit {most})"
    )
    return (_advised(name, PRIOR.finding(sentence)),)


def _distance(offset: PriorOffset) -> tuple[Finding, ...]:
    """Compare a prior with the final pose, along the axis that is farthest off."""
    off, most = format_against_limit(offset.deviations, PRIOR.limit("one axis"), 1)
    sentence = (
        f"{offset.name} is {_length(offset.axis, offset.offset)} from the pose that everything else gives, {off} "
        f"standard deviations (limit {most})"
    )
    return tuple(
        _advised(offset.name, finding)
        for finding in PRIOR.measured(offset.deviations, sentence, "one axis").findings
    )


def _advised(name: str, finding: Finding) -> Finding:
    """Advise what the option of a prior allows: `--fix` takes no SIGMA."""
    return finding._replace(advice=ADVICE_FIX) if name.startswith("--fix") else finding


def _length(axis: int, offset: float) -> str:
    return f"{100.0 * abs(offset):.1f} cm" if axis < 3 else f"{np.degrees(abs(offset)):.2f} degrees"
