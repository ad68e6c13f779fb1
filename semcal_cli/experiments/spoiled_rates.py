"""Frequency with which spoiled drives are trusted, wrong, and told what is wrong with them."""

from __future__ import annotations

from collections.abc import Sequence

from semcal_cli.experiments.accuracy import RIGS
from semcal_cli.experiments.outcome import Outcome
from semcal_cli.experiments.rate import Rate, rate_of
from semcal_cli.experiments.result_files import markdown_table
from semcal_cli.experiments.spoiled import COPIES, KINDS, KNOCKED, PRINCIPAL_POINT, SCALE

MANY_PAIRS = 10
"""Least number of pairs of the drives none of which may be trusted and wrong."""
EXCEPTED = (PRINCIPAL_POINT, SCALE)
"""Groups that labels cannot tell from another pose; a note or a wider interval is what counts there."""


def spoiled_rates(findings: Sequence[Outcome]) -> list[Rate]:
    """Rates of what calibrations say of spoiled drives."""
    spoiled = [f for f in findings if f.kind in KINDS and not KINDS[f.kind].is_subtle]
    counted = [f for f in spoiled if _group(f) not in EXCEPTED and f.num_pairs >= MANY_PAIRS]
    knocks = [f for f in spoiled if _group(f) == KNOCKED]
    named = [f for f in knocks if f.num_axes_inside is not None]
    found = [
        rate_of(f"spoiled, trusted and wrong, {MANY_PAIRS} pairs or more", counted, is_trusted_and_wrong)
    ]
    found += [
        rate_of(f"the same, {name}", [f for f in counted if _group(f) == name], is_trusted_and_wrong)
        for name in dict.fromkeys(map(_group, counted))
    ]
    found += [
        rate_of(f"the same, {n} pairs", [f for f in counted if f.num_pairs == n], is_trusted_and_wrong)
        for n in sorted({f.num_pairs for f in counted})
    ]
    found += [
        rate_of(f"the same, {rig}", [f for f in counted if f.rig == rig], is_trusted_and_wrong)
        for rig in RIGS
    ]
    found += [
        rate_of("knocked cameras, trusted at any pose", knocks, lambda f: f.status == "trusted"),
        rate_of("knocked cameras named with their frame, within one", knocks, lambda f: f.has_frame is True),
        rate_of("the same, and the offset within its intervals", knocks, lambda f: f.is_told is True),
        Rate(
            "axes of named offsets within their intervals",
            sum(f.num_axes_inside or 0 for f in named),
            6 * len(named),
        ),
    ]
    found += [
        rate_of(
            f"{name}, told or not trusted or right", [f for f in spoiled if _group(f) == name], _is_excused
        )
        for name in EXCEPTED
    ]
    copies = [f for f in spoiled if _group(f) == COPIES]
    found.append(
        rate_of("copies of a frame have its interval and verdict", copies, lambda f: f.is_told is True)
    )
    return found


def spoiled_markdown(findings: Sequence[Outcome]) -> str:
    """Format a table with a row for each way of spoiling; the columns of rigs count what is trusted and wrong."""
    header = (
        "| spoiled | drives | trusted | not trusted | failed | told | trusted and wrong | "
        f"{' | '.join(RIGS)} | worst trusted error |"
    )
    rows = []
    for kind in (name for name, kind in KINDS.items() if not kind.is_subtle):
        of_kind = [f for f in findings if f.kind == kind]
        if not of_kind:
            continue
        statuses = [f.status for f in of_kind]
        wrong = [f for f in of_kind if is_trusted_and_wrong(f)]
        told = sum(f.is_told is True for f in of_kind) if KINDS[kind].tell is not None else "-"
        by_rig = (_of_rig(rig, wrong, of_kind) for rig in RIGS)
        counts = (statuses.count(status) for status in ("trusted", "not_trusted", "failed"))
        rows.append((kind, len(of_kind), *counts, told, len(wrong), *by_rig, worst_trusted(of_kind)))
    return markdown_table(header, rows) if rows else ""


def is_trusted_and_wrong(outcome: Outcome) -> bool:
    """Whether a pose is trusted that is farther than 0.3 degrees or 6 cm from each true pose."""
    return outcome.status == "trusted" and outcome.is_wrong


def worst_trusted(findings: Sequence[Outcome]) -> str:
    """Largest errors of trusted poses."""
    trusted = [f for f in findings if f.status == "trusted"]
    if not trusted:
        return "-"
    return f"{max(f.rotation_deg for f in trusted):.2f} deg, {max(f.center_cm for f in trusted):.1f} cm"


def _is_excused(outcome: Outcome) -> bool:
    return outcome.is_told is True or not is_trusted_and_wrong(outcome)


def _group(outcome: Outcome) -> str:
    return KINDS[outcome.kind].group


def _of_rig(rig: str, wrong: Sequence[Outcome], findings: Sequence[Outcome]) -> str:
    """Count the wrong drives of a rig, of all of that rig."""
    n = sum(f.rig == rig for f in findings)
    return f"{sum(f.rig == rig for f in wrong)} of {n}" if n else "-"
