"""Frequency with which spoiled drives are trusted, wrong, and said to be wrong in what is wrong with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from semcal_cli.experiments.accuracy import RIGS
from semcal_cli.experiments.outcome import Outcome
from semcal_cli.experiments.rate import Rate, axes_inside, rate_of, rates_by
from semcal_cli.experiments.spoiled import (
    COPIES,
    KINDS,
    KNOCKED,
    LEAKED,
    PRINCIPAL_POINT,
    SCALE,
    SEGMENTS,
    SINGLE,
)
from semcal_cli.experiments.summary import Column, cell, common, grouped, summarise, summary_table

MANY_PAIRS = 10
"""Least number of pairs of the drives none of which may be trusted and wrong."""
EXCEPTED = (PRINCIPAL_POINT, SCALE)
"""Groups that labels cannot tell from another pose; a note or a wider interval is what counts there."""


def spoiled_rates(findings: Sequence[Outcome]) -> list[Rate]:
    """Rates of what calibrations say of spoiled drives."""
    of_group = _by_group(findings, is_subtle=False)
    counted = [f for name in of_group if name not in EXCEPTED for f in of_group[name]]
    counted = [f for f in counted if f.num_pairs >= MANY_PAIRS]
    by_pairs = sorted(counted, key=lambda f: f.num_pairs)
    knocks = of_group.get(KNOCKED, [])
    named = [f for f in knocks if f.num_axes_inside is not None]
    inside = sum(f.num_axes_inside or 0 for f in named)
    return [
        rate_of(f"spoiled, trusted and wrong, {MANY_PAIRS} pairs or more", counted, _is_wrong),
        *rates_by("the same, {}", counted, lambda f: KINDS[f.kind].group, None, _is_wrong),
        *rates_by("the same, {} pairs", by_pairs, lambda f: f.num_pairs, None, _is_wrong),
        *rates_by("the same, {}", counted, lambda f: f.rig, RIGS, _is_wrong),
        rate_of("knocked cameras, trusted at any pose", knocks, _is_trusted),
        rate_of("knocked cameras named with their frame, within one", knocks, lambda f: f.has_frame is True),
        rate_of("the same, and the offset within its intervals", knocks, _is_told),
        Rate("axes of named offsets within their intervals", inside, 6 * len(named)),
        *(
            rate_of(f"{name}, told or not trusted or right", of_group.get(name, []), _is_excused)
            for name in EXCEPTED
        ),
        rate_of("copies of a frame have its interval and verdict", of_group.get(COPIES, []), _is_told),
    ]


def subtle_rates(findings: Sequence[Outcome]) -> list[Rate]:
    """Rates of what calibrations of drives with subtle faults state."""
    rates = []
    for group, found in _by_group(findings, is_subtle=True).items():
        rates += [
            rate_of(f"{group}: trusted, outside the interval", found, _is_outside),
            rate_of(f"{group}: the same, not told", found, _is_untold),
            rate_of(f"{group}: the same, beyond 0.3 degrees or 6 cm", found, _is_missed),
        ]
        if group == LEAKED:
            rates.append(rate_of(f"{group} are told", found, _is_told))
        if group in (SINGLE, SEGMENTS):
            right = [f for f in found if f.errors and not f.is_wrong]
            trusted = list(filter(_is_trusted, found))
            rates += [
                rate_of(f"{group} are trusted", found, _is_trusted),
                rate_of(f"{group} are trusted, of those within 0.3 degrees and 6 cm", right, _is_trusted),
                axes_inside(f"{group}, trusted: axes in the 95 % interval", trusted),
            ]
    return rates


def kinds_markdown(findings: Sequence[Outcome], *, is_subtle: bool) -> str:
    """Format a table with a row for each way of spoiling; empty without findings of one.

    The columns of rigs count what is trusted and wrong.
    """
    found = _of_kinds(findings, is_subtle=is_subtle)
    columns = SUBTLE_COLUMNS if is_subtle else SPOILED_COLUMNS
    return summary_table(summarise(found, columns), columns) if found else ""


def _of_kinds(findings: Sequence[Outcome], *, is_subtle: bool) -> list[Outcome]:
    """Choose the outcomes of spoiled drives, in the order of `KINDS`."""
    places = {name: place for place, name in enumerate(KINDS) if KINDS[name].is_subtle == is_subtle}
    return sorted((f for f in findings if f.kind in places), key=lambda f: places[f.kind])


def _by_group(findings: Sequence[Outcome], *, is_subtle: bool) -> dict[str, list[Outcome]]:
    return grouped(_of_kinds(findings, is_subtle=is_subtle), lambda f: KINDS[f.kind].group)


def _is_trusted(outcome: Outcome) -> bool:
    return outcome.is_trusted


def _is_wrong(outcome: Outcome) -> bool:
    """Whether a pose is trusted that is farther than 0.3 degrees or 6 cm from each true pose."""
    return outcome.is_trusted and outcome.is_wrong


def _is_told(outcome: Outcome) -> bool:
    return outcome.is_told is True


def _is_excused(outcome: Outcome) -> bool:
    return _is_told(outcome) or not _is_wrong(outcome)


def _is_outside(outcome: Outcome) -> bool:
    """Whether a pose is trusted though the truth is outside its interval, along or about any axis."""
    return outcome.is_trusted and not outcome.is_inside


def _is_untold(outcome: Outcome) -> bool:
    """Whether that is so, and the result does not say why."""
    return _is_outside(outcome) and not _is_told(outcome)


def _is_missed(outcome: Outcome) -> bool:
    """Whether that is so, and the pose is farther than 0.3 degrees or 6 cm from the truth."""
    return _is_untold(outcome) and outcome.is_wrong


def _number(is_so: Callable[[Outcome], bool]) -> Callable[[Sequence[Outcome]], int]:
    return lambda found: sum(map(is_so, found))


def _with_status(status: str) -> Column:
    return cell(status.replace("_", " "), _number(lambda f: f.status == status))


def _number_told(found: Sequence[Outcome]) -> int | str:
    """Count the results that say what is wrong, where that is asked."""
    return "-" if KINDS[found[0].kind].diagnose is None else _number(_is_told)(found)


def _wrong_of_rig(rig: str, found: Sequence[Outcome]) -> str:
    of_rig = [f for f in found if f.rig == rig]
    return f"{_number(_is_wrong)(of_rig)} of {len(of_rig)}" if of_rig else "-"


def _worst_trusted(found: Sequence[Outcome]) -> str:
    trusted = list(filter(_is_trusted, found))
    if not trusted:
        return "-"
    return f"{max(f.rotation_deg for f in trusted):.2f} deg, {max(f.center_cm for f in trusted):.1f} cm"


def _axes_inside(found: Sequence[Outcome]) -> str:
    inside = axes_inside("", list(filter(_is_trusted, found)))
    return f"{inside.count} of {inside.n}" if inside.n else "-"


_COLUMNS = (
    cell("drives", len),
    *map(_with_status, ("trusted", "not_trusted", "failed")),
    cell("told", _number_told),
)
SPOILED_COLUMNS = (
    common("kind", "spoiled"),
    *_COLUMNS,
    cell("trusted and wrong", _number(_is_wrong)),
    *(cell(rig, partial(_wrong_of_rig, rig)) for rig in RIGS),
    cell("worst trusted error", _worst_trusted),
)
SUBTLE_COLUMNS = (
    common("kind", "subtle"),
    *_COLUMNS,
    cell("trusted, outside the interval", _number(_is_outside)),
    cell("of these, not told", _number(_is_untold)),
    cell("of these, beyond 0.3 deg or 6 cm", _number(_is_missed)),
    cell("worst trusted error", _worst_trusted),
    cell("axes in the interval, trusted", _axes_inside),
)
