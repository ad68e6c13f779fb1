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
    for f in _subtle(findings):
        by_group.setdefault(KINDS[f.kind].group, []).append(f)
    found = []
    for group, outcomes in by_group.items():
        found += [
            rate_of(f"{group}: trusted, neither in the interval nor told", outcomes, _is_missed),
            rate_of("the same, beyond 0.3 degrees or 6 cm", outcomes, lambda f: _is_missed(f) and f.is_wrong),
        ]
        if group == LEAKED:
            found.append(rate_of(f"{group} are told", outcomes, lambda f: f.is_told is True))
        if group in (SINGLE, SEGMENTS):
            found += [
                rate_of(f"{group} are trusted", outcomes, _is_trusted),
                axes_inside(f"{group}, trusted: axes in the 95 % interval", filter(_is_trusted, outcomes)),
            ]
    return found


def subtle_markdown(findings: Sequence[Outcome]) -> str:
    """Format a table with a row for each subtle fault; empty without findings of one."""
    rows = []
    for kind in KINDS:
        of_kind = [f for f in _subtle(findings) if f.kind == kind]
        if not of_kind:
            continue
        statuses = [f.status for f in of_kind]
        trusted = [f for f in of_kind if _is_trusted(f)]
        outside = [f for f in trusted if not f.is_inside]
        missed = [f for f in outside if _is_missed(f)]
        told = sum(f.is_told is True for f in of_kind) if KINDS[kind].tell is not None else "-"
        counts = (statuses.count(status) for status in ("trusted", "not_trusted", "failed"))
        inside = axes_inside("", trusted)
        wrong = sum(f.is_wrong for f in missed)
        shares = f"{inside.count} of {inside.n}" if inside.n else "-"
        rows.append(
            (
                kind,
                len(of_kind),
                *counts,
                told,
                len(outside),
                len(missed),
                wrong,
                worst_trusted(of_kind),
                shares,
            )
        )
    return markdown_table(HEADER, rows) if rows else ""


def _subtle(findings: Sequence[Outcome]) -> list[Outcome]:
    return [f for f in findings if f.kind in KINDS and KINDS[f.kind].is_subtle]


def _is_trusted(outcome: Outcome) -> bool:
    return outcome.status == "trusted"


def _is_missed(outcome: Outcome) -> bool:
    """Whether a pose is trusted though the truth is outside its interval, and the result does not say why."""
    return _is_trusted(outcome) and not outcome.is_inside and outcome.is_told is not True
