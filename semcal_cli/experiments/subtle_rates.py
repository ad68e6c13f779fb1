"""Frequency with which calibrations of drives with subtle faults are trusted, and state intervals without the truth."""

from __future__ import annotations

from collections.abc import Sequence

from semcal_cli.experiments.outcome import Outcome
from semcal_cli.experiments.rate import Rate, axes_inside, rate_of
from semcal_cli.experiments.result_files import markdown_table
from semcal_cli.experiments.spoiled import KINDS, LEAKED, SEGMENTS, SINGLE
from semcal_cli.experiments.spoiled_rates import worst_trusted

HEADER = (
    "| subtle | drives | trusted | not trusted | failed | told | trusted, outside the interval | of these, not told | "
    "of these, beyond 0.3 deg or 6 cm | worst trusted error | axes in the interval, trusted |"
)


def subtle_rates(findings: Sequence[Outcome]) -> list[Rate]:
    """Rates of what calibrations of drives with subtle faults state."""
    by_group: dict[str, list[Outcome]] = {}
    for f in findings:
        if f.kind in KINDS and KINDS[f.kind].is_subtle:
            by_group.setdefault(KINDS[f.kind].group, []).append(f)
    found = []
    for group, outcomes in by_group.items():
        found += [
            rate_of(f"{group}: trusted, outside the interval", outcomes, _is_outside),
            rate_of(f"{group}: the same, not told", outcomes, _is_untold),
            rate_of(f"{group}: the same, beyond 0.3 degrees or 6 cm", outcomes, _is_missed),
        ]
        if group == LEAKED:
            found.append(rate_of(f"{group} are told", outcomes, lambda f: f.is_told is True))
        if group in (SINGLE, SEGMENTS):
            right = [f for f in outcomes if f.errors and not f.is_wrong]
            found += [
                rate_of(f"{group} are trusted", outcomes, _is_trusted),
                rate_of(f"{group} are trusted, of those within 0.3 degrees and 6 cm", right, _is_trusted),
                axes_inside(f"{group}, trusted: axes in the 95 % interval", filter(_is_trusted, outcomes)),
            ]
    return found


def subtle_markdown(findings: Sequence[Outcome]) -> str:
    """Format a table with a row for each subtle fault; empty without findings of one."""
    kinds = [kind for kind in KINDS if KINDS[kind].is_subtle and any(f.kind == kind for f in findings)]
    rows = (_row(kind, [f for f in findings if f.kind == kind]) for kind in kinds)
    return markdown_table(HEADER, rows) if kinds else ""


def _row(kind: str, findings: Sequence[Outcome]) -> tuple[object, ...]:
    statuses = [f.status for f in findings]
    counts = (statuses.count(status) for status in ("trusted", "not_trusted", "failed"))
    told = sum(f.is_told is True for f in findings) if KINDS[kind].tell is not None else "-"
    missed = (sum(map(is_so, findings)) for is_so in (_is_outside, _is_untold, _is_missed))
    inside = axes_inside("", filter(_is_trusted, findings))
    shares = f"{inside.count} of {inside.n}" if inside.n else "-"
    return kind, len(findings), *counts, told, *missed, worst_trusted(findings), shares


def _is_trusted(outcome: Outcome) -> bool:
    return outcome.status == "trusted"


def _is_outside(outcome: Outcome) -> bool:
    """Whether a pose is trusted though the truth is outside its interval, along or about any axis."""
    return _is_trusted(outcome) and not outcome.is_inside


def _is_untold(outcome: Outcome) -> bool:
    """Whether that is so, and the result does not say why."""
    return _is_outside(outcome) and outcome.is_told is not True


def _is_missed(outcome: Outcome) -> bool:
    """Whether that is so, and the pose is farther than 0.3 degrees or 6 cm from the truth."""
    return _is_untold(outcome) and outcome.is_wrong
