"""Limits of the checks beside what was measured on both sides of them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from semcal_cli.experiments.experiment import Experiment
from semcal_cli.experiments.limits import (
    BAD_OF,
    FEW,
    GOOD,
    MOVING,
    WRONG_POSE,
    Case,
    Runner,
    Value,
    cases,
)
from semcal_cli.experiments.pool import Pool
from semcal_cli.experiments.result_files import Report
from semcal_cli.experiments.summary import markdown_table
from semcal_cli.result.checks import CHECKS, LIMITS, Evidence, Limit

LIMITS_FILE = "limits.json"
MARGIN = 1.25
"""Factor between the worst good value and the limit where there are no bad drives."""
QUANTILE = 0.05
"""Share of the bad drives that a limit by the rule may miss."""
RULE = (
    f"The rule: midway between the worst good value and that which {1 - QUANTILE:.0%} of the bad drives exceed; none "
    f"where these overlap; {MARGIN:g} times the worst good value where there are no bad drives.\n"
)


@dataclass(frozen=True)
class Row:
    """A limit with what was measured; the fields are those of `Evidence`."""

    topic: str
    name: str
    today: float
    num_good: int
    worst_good: float
    num_good_beyond: int
    bad_kind: str | None
    num_bad: int
    mildest_bad: float | None
    num_bad_within: int
    by_rule: float | None


def rows(values: Sequence[Value]) -> list[Row]:
    """Compare each limit that was measured with the values on both sides of it."""
    return [
        row
        for topic, check in CHECKS.items()
        for name, limit in check.limits.items()
        if (row := _row(topic, name, limit, values)) is not None
    ]


def _row(topic: str, name: str, limit: Limit, values: Sequence[Value]) -> Row | None:
    of_limit = [each for each in values if (each.topic, each.limit) == (topic, name)]
    on_good_drives = [each for each in of_limit if each.kind in (GOOD, FEW, MOVING)]
    good = _worst_of_each([each for each in on_good_drives if each.is_right], limit)
    if not good:
        return None
    kind = BAD_OF.get(topic)
    if kind == WRONG_POSE:
        of_bad = [each for each in on_good_drives if not each.is_right]
    else:
        of_bad = [each for each in of_limit if each.kind == kind]
    bad = _worst_of_each(of_bad, limit)
    by_rule = _by_rule(limit.sign, [limit.sign * x for x in good], [limit.sign * x for x in bad])
    return Row(
        topic=topic,
        name=name,
        today=limit.value,
        num_good=len(good),
        worst_good=_short(max(good, key=lambda x: limit.sign * x)),
        num_good_beyond=sum(not limit.is_kept_by(x) for x in good),
        bad_kind=kind if bad else None,
        num_bad=len(bad),
        mildest_bad=_short(min(bad, key=lambda x: limit.sign * x)) if bad else None,
        num_bad_within=sum(limit.is_kept_by(x) for x in bad),
        by_rule=None if by_rule is None else _short(by_rule),
    )


def _worst_of_each(values: Sequence[Value], limit: Limit) -> list[float]:
    """Take the worst value of each calibration, which decides: some checks look at both sides' labels."""
    found: dict[tuple[str, str, int], float] = {}
    for each in values:
        case = (each.kind, each.cue, each.seed)
        worst = max(limit.sign * each.value, limit.sign * found.get(case, each.value))
        found[case] = limit.sign * worst
    return list(found.values())


def _by_rule(sign: int, good: Sequence[float], bad: Sequence[float]) -> float | None:
    """Compute the limit by the rule, from values of which larger ones are worse."""
    worst = max(good)
    if not bad:
        return sign * worst * MARGIN**sign
    least_bad = float(np.quantile(bad, QUANTILE))
    return sign * 0.5 * (worst + least_bad) if least_bad > worst else None


def _short(value: float) -> float:
    return float(f"{value:.4g}")


def limits_text(found: Sequence[Row], command: str, seeds: range) -> str:
    """Write all limits as limits.json has them: today's values with the new evidence."""
    about = {"command": command, "first_seed": seeds.start, "num_seeds": len(seeds)}
    evidence = {
        (row.topic, row.name): Evidence(
            **about,  # type: ignore[arg-type]
            **{key: value for key, value in vars(row).items() if key not in ("topic", "name", "today")},
        )
        for row in found
    }
    document = {
        topic: {
            name: _entry(replace(limit, measured=evidence.get((topic, name), limit.measured)))
            for name, limit in limits.items()
        }
        for topic, limits in LIMITS.items()
    }
    return json.dumps(document, indent=2) + "\n"


def _entry(limit: Limit) -> dict[str, object]:
    return {key: value for key, value in asdict(limit).items() if value not in (None, "")}


def markdown(found: Sequence[Row]) -> str:
    """Format the table."""
    header = "| check | limit | good | worst | beyond | bad drives | mildest | within | limit today | by the rule |"
    return markdown_table(header, map(_cells, found))


def _cells(row: Row) -> list[object]:
    limit = CHECKS[row.topic].limits[row.name]
    bad: list[object] = ["", "", ""]
    if row.mildest_bad is not None:
        bad = [f"{row.num_bad}, {row.bad_kind}", limit.words(row.mildest_bad), row.num_bad_within]
    by_rule = "none" if row.by_rule is None else limit.words(row.by_rule)
    good = [row.num_good, limit.words(row.worst_good), row.num_good_beyond]
    return [row.topic, row.name, *good, *bad, limit.words(row.today), by_rule]


def experiment(out: Path, seeds: range) -> Experiment[Case, Value]:
    """Declare the experiment; limits.json in its folder is that of the next version."""
    command = f"semcal experiment trust --limits --first-seed {seeds.start} --seeds {len(seeds)}"

    def report(values: Sequence[Value]) -> Report:
        found = rows(values)
        texts = {LIMITS_FILE: limits_text(found, command, seeds)}
        return Report([vars(row) for row in found], f"{markdown(found)}\n{RULE}", texts=texts)

    run = Runner(Pool(out / "pool_of_limits", has_pictures=True))
    return Experiment("limits", out / "limits", cases(seeds), run, Value, report)
