"""Counts how often a calibration's own statements are true: intervals, verdicts, and what it says of spoiled drives.

    python tests/benchmarks/trust.py [--seeds 60] [--only PART]

Each drive takes six calibrations unchanged, two with the same classes wrong in all frames, five of impossible variants,
and 15 verifications: about two minutes, and seven per spoiled drive. Drives are spoiled the way real recordings are, or
given subtle faults; together with other parts, `spoiled` and `subtle` spoil only every fifth drive. Writes results.csv,
summary.json and table.md to a folder in `semcal_experiments`, where a stopped run resumes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from benchmark import OUTPUT, KeptTable, run_experiment, script
from laboratory import spoiled
from laboratory.outcomes import (
    BAD,
    MOVED,
    MOVED_M,
    NOISES,
    OFFSETS,
    PAIRS,
    SHARED,
    SHARED_PAIRS,
    Case,
    Outcome,
    run_case,
)
from laboratory.rates import Rate, rate_of, rates_by
from laboratory.rigs import RIGS
from laboratory.spoiled import KINDS, KNOCKED

from semcal_cli.errors import check_torch
from semcal_cli.experiments.drives import Pool
from semcal_cli.experiments.experiment_run import Experiment, Report
from semcal_cli.experiments.summary import (
    cell,
    common,
    count,
    group_results,
    markdown_table,
    summarise,
    summary_table,
)

Part = Literal["good", "bad", "spoiled", "subtle", "verify"]
PARTS = get_args(Part)
"""Parts of the experiment; MINE runs on the good drives."""
VERIFY_DRAWS = 5
"""Number of draws of wrong labels for `verify` on each drive, each with a transform that is off in another
direction."""
MINE_PAIRS = 10
MINE_EVERY = SPOILED_EVERY = 5
"""Step between the seeds whose drive is also calibrated with MINE, or spoiled; such seeds cycle through all rigs."""
MANY_PAIRS = 10
"""Number of pairs from which no drive may be trusted and wrong."""
EXCEPTED = (spoiled.PRINCIPAL_POINT, spoiled.SCALE)
"""Groups that labels cannot distinguish from another pose, where a note or a wider interval counts."""
INSIDE, TRUSTED, WRONGLY_TRUSTED = Outcome.axes_inside, Outcome.is_trusted, Outcome.is_trusted_and_wrong


def cases(seeds: range, parts: Sequence[str]) -> list[Case]:
    """List the cases of some parts of the experiment, seed by seed.

    Each seed has six calibrations of a good drive, two with class borders off, five of bad drives, and five rounds of
    three verifications. Only one round has no wrong labels, since a second one would be the same. Every fifth seed also
    has a calibration with MINE, and a drive for each kind of fault; if only spoiled drives are asked for, every seed
    has these.

    Args:
        seeds: Seeds of the drives.
        parts: Some of `good` (with MINE), `bad`, `spoiled`, `subtle` and `verify`.
    """
    found = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        found += [Case("good", seed, num_pairs, float(rng.choice(NOISES))) for num_pairs in PAIRS]
        found += [Case(kind, seed, int(rng.choice(PAIRS)), float(rng.choice(NOISES))) for kind in BAD]
        found += [Case(SHARED, seed, num_pairs, 0.0) for num_pairs in SHARED_PAIRS]
        noises = [*NOISES, *rng.choice(NOISES[1:], VERIFY_DRAWS - len(NOISES)).tolist()]
        found += [Case("verify", seed, PAIRS[-1], noise, draw) for draw, noise in enumerate(noises)]
        if seed % MINE_EVERY == 0:
            found.append(Case("mine", seed, MINE_PAIRS, float(rng.choice(NOISES))))
        if seed % SPOILED_EVERY == 0 or set(parts) <= {"spoiled", "subtle"}:
            found += spoiled.cases(seed)
    return [case for case in found if _part(case.kind) in parts]


def _part(kind: str) -> str:
    """Name the part of the experiment to which a kind belongs."""
    if kind in KINDS:
        return "subtle" if KINDS[kind].is_subtle else "spoiled"
    return "bad" if kind in BAD else "verify" if kind == "verify" else "good"


def run(pool: Pool, pool_with_images: Pool, case: Case) -> list[Outcome]:
    """Run a case; spoiled drives are made from drives with images."""
    return spoiled.run(pool_with_images, case) if case.kind in KINDS else run_case(pool, case)


def _is_told(outcome: Outcome) -> bool:
    """Whether the result says what is wrong."""
    return outcome.is_told is True


def rates(outcomes: Sequence[Outcome]) -> list[Rate]:
    """Compute the rates of all statements that semcal makes."""
    calibrated = [f for f in outcomes if f.kind not in OFFSETS and f.kind not in KINDS]
    trusted = list(filter(TRUSTED, calibrated))
    good, mine = ([f for f in calibrated if f.kind == kind] for kind in ("good", "mine"))
    trusted_good, trusted_mine = list(filter(TRUSTED, good)), list(filter(TRUSTED, mine))
    shared = [f for f in trusted if f.kind == SHARED]
    many = [f for f in good if f.num_pairs >= MANY_PAIRS]
    return [
        rate_of("trusted: axes in the 95 % interval", trusted_good, INSIDE),
        rate_of("the same, trusted or not", good, INSIDE),
        *rates_by("trusted, {} pairs", trusted_good, lambda f: f.num_pairs, INSIDE, PAIRS),
        *rates_by("trusted, {:.0%} wrong labels", trusted_good, lambda f: f.noise, INSIDE, NOISES),
        *rates_by("trusted, {}", trusted_good, lambda f: f.rig, INSIDE, RIGS),
        *rates_by(f"trusted, {SHARED}, {{}} pairs", shared, lambda f: f.num_pairs, INSIDE, SHARED_PAIRS),
        rate_of("trusted, MINE, 10 pairs", trusted_mine, INSIDE),
        rate_of("confident and wrong, of all", calibrated, Outcome.is_confidently_wrong),
        rate_of("confident and wrong, of those trusted", trusted, Outcome.is_confidently_wrong),
        rate_of("good drives are trusted, all", good, TRUSTED),
        rate_of(f"good drives are trusted, {MANY_PAIRS} pairs or more", many, TRUSTED),
        rate_of("good drives are trusted, MINE, 10 pairs", mine, TRUSTED),
        *rates_by("not trusted or failed, {}", outcomes, lambda f: f.kind, lambda f: not f.is_trusted(), BAD),
        *_rates_of_verify(outcomes),
        *spoiled_rates(outcomes),
        *subtle_rates(outcomes),
    ]


def _rates_of_verify(outcomes: Sequence[Outcome]) -> list[Rate]:
    """Compute the rates of the verdicts of `verify` for each offset, and for the three moves together."""
    found = []
    for name, kinds in (
        *((kind, (kind,)) for kind in OFFSETS),
        (f"{100 * MOVED_M:.0f} cm off, all", MOVED),
    ):
        chosen = [f for f in outcomes if f.kind in kinds]
        found.append(rate_of(f"verify fails, {name}", chosen, lambda f: f.status == "fail"))
        found.append(rate_of(f"verify is inconclusive, {name}", chosen, lambda f: f.status == "inconclusive"))
    return found


def spoiled_rates(outcomes: Sequence[Outcome]) -> list[Rate]:
    """Compute the rates of what calibrations say about spoiled drives."""
    groups = group_results(_of_kinds(outcomes, is_subtle=False), lambda f: KINDS[f.kind].group)
    counted = [
        f
        for name, found in groups.items()
        if name not in EXCEPTED
        for f in found
        if f.num_pairs >= MANY_PAIRS
    ]
    by_pairs = sorted(counted, key=lambda f: f.num_pairs)
    knocks = groups.get(KNOCKED, [])
    named = [f for f in knocks if f.num_axes_inside is not None]
    inside = sum(f.num_axes_inside or 0 for f in named)
    return [
        rate_of(f"spoiled, trusted and wrong, {MANY_PAIRS} pairs or more", counted, WRONGLY_TRUSTED),
        *rates_by("the same, {}", counted, lambda f: KINDS[f.kind].group, WRONGLY_TRUSTED),
        *rates_by("the same, {} pairs", by_pairs, lambda f: f.num_pairs, WRONGLY_TRUSTED),
        *rates_by("the same, {}", counted, lambda f: f.rig, WRONGLY_TRUSTED, RIGS),
        rate_of("knocked cameras, trusted at any pose", knocks, TRUSTED),
        rate_of("knocked cameras named with their frame, within one", knocks, lambda f: f.has_frame is True),
        rate_of("the same, and the offset within its intervals", knocks, _is_told),
        Rate("axes of named offsets within their intervals", inside, 6 * len(named)),
        *(
            rate_of(
                f"{name}, reported or not trusted or right",
                groups.get(name, []),
                lambda f: _is_told(f) or not f.is_trusted_and_wrong(),
            )
            for name in EXCEPTED
        ),
        rate_of("copies of a frame have its interval and verdict", groups.get(spoiled.COPIES, []), _is_told),
    ]


def subtle_rates(outcomes: Sequence[Outcome]) -> list[Rate]:
    """Compute the rates of what calibrations say about drives with subtle faults."""
    found: list[Rate] = []
    groups = group_results(_of_kinds(outcomes, is_subtle=True), lambda f: KINDS[f.kind].group)
    for group, listed in groups.items():
        found += [
            rate_of(f"{group}: trusted, outside the interval", listed, Outcome.is_outside),
            rate_of(f"{group}: the same, not reported", listed, Outcome.is_outside_untold),
            rate_of(f"{group}: the same, beyond 0.3 degrees or 6 cm", listed, Outcome.is_missed),
        ]
        if group == spoiled.LEAKED:
            found.append(rate_of(f"{group} are reported", listed, _is_told))
        if group in (spoiled.SINGLE, spoiled.SEGMENTS):
            right = [f for f in listed if f.errors and not f.is_wrong()]
            found += [
                rate_of(f"{group} are trusted", listed, TRUSTED),
                rate_of(f"{group} are trusted, of those within 0.3 degrees and 6 cm", right, TRUSTED),
                rate_of(f"{group}, trusted: axes in the 95 % interval", filter(TRUSTED, listed), INSIDE),
            ]
    return found


def _of_kinds(outcomes: Sequence[Outcome], *, is_subtle: bool) -> list[Outcome]:
    """Choose the outcomes of spoiled drives, in the order of `KINDS`."""
    places = {name: place for place, name in enumerate(KINDS) if KINDS[name].is_subtle == is_subtle}
    return sorted((f for f in outcomes if f.kind in places), key=lambda f: places[f.kind])


def sharpness(outcomes: Sequence[Outcome]) -> float:
    """Ratio of the median stated standard error to the true RMS error of trusted poses, on the worst axis."""
    trusted = [f for f in outcomes if f.kind == "good" and f.is_trusted()]
    if not trusted:
        return math.nan
    sigmas, errors = np.array([f.sigmas for f in trusted]), np.array([f.errors for f in trusted])
    return float(np.max(np.median(sigmas, axis=0) / np.sqrt(np.mean(errors**2, axis=0))))


def _some(num_found: int, number: int) -> str:
    return f"{num_found} of {number}" if number else "-"


def _wrong_of_rig(rig: str, found: Sequence[Outcome]) -> str:
    of_rig = [f for f in found if f.rig == rig]
    return _some(sum(map(WRONGLY_TRUSTED, of_rig)), len(of_rig))


def _worst_trusted(found: Sequence[Outcome]) -> str:
    errors = [(np.linalg.norm(f.errors[3:]), np.linalg.norm(f.errors[:3])) for f in filter(TRUSTED, found)]
    return "{:.2f} deg, {:.1f} cm".format(*np.max(errors, axis=0)) if errors else "-"


def _axes_inside(found: Sequence[Outcome]) -> str:
    inside = rate_of("", filter(TRUSTED, found), INSIDE)
    return _some(inside.count, inside.n)


def _number_told(found: Sequence[Outcome]) -> Any:
    """Count the results that say what is wrong, where that is required."""
    return "-" if KINDS[found[0].kind].diagnose is None else sum(map(_is_told, found))


COMMON = (
    cell("drives", len),
    count("trusted", TRUSTED),
    count("not trusted", lambda f: f.status == "not_trusted"),
    count("failed", lambda f: f.status == "failed"),
    cell("reported", _number_told),
)
WORST = cell("worst trusted error", _worst_trusted)
SPOILED_COLUMNS = (
    common("kind", "spoiled"),
    *COMMON,
    count("trusted and wrong", WRONGLY_TRUSTED),
    *(cell(rig, partial(_wrong_of_rig, rig)) for rig in RIGS),
    WORST,
)
SUBTLE_COLUMNS = (
    common("kind", "subtle"),
    *COMMON,
    count("trusted, outside the interval", Outcome.is_outside),
    count("of these, not reported", Outcome.is_outside_untold),
    count("of these, beyond 0.3 deg or 6 cm", Outcome.is_missed),
    WORST,
    cell("axes in the interval, trusted", _axes_inside),
)


def kinds_markdown(outcomes: Sequence[Outcome], *, is_subtle: bool) -> str:
    """Format a table with a row for each kind of spoiled drive; empty without outcomes of any.

    The columns of the rigs count results that are trusted and wrong.
    """
    found = _of_kinds(outcomes, is_subtle=is_subtle)
    columns = SUBTLE_COLUMNS if is_subtle else SPOILED_COLUMNS
    return summary_table(summarise(found, columns), columns) if found else ""


def report(outcomes: Sequence[Outcome]) -> Report:
    """Summarise all outcomes."""
    found, ratio = rates(outcomes), sharpness(outcomes)
    headers = ("", "count", "of", "rate", "95 % interval")
    table = markdown_table(headers, (rate.cells for rate in found if rate.n > 0))
    if not math.isnan(ratio):
        table += f"| median stated sigma over true RMSE, worst axis | | | {ratio:.2f} | |\n"
    for is_subtle in (False, True):
        if more := kinds_markdown(outcomes, is_subtle=is_subtle):
            table += f"\n{more}"
    facts = {"sharpness": None if math.isnan(ratio) else ratio}
    return Report([vars(rate) for rate in found], table, facts=facts)


def main(
    *,
    seeds: int = 60,
    first_seed: int = 20_000,
    jobs: int = 1,
    only: tuple[Part, ...] = PARTS,
    output: Path = OUTPUT,
) -> KeptTable:
    """Run all parts or some."""
    if "good" in only:
        check_torch("--only good")
    listed = cases(range(first_seed, first_seed + seeds), only)
    run_one = partial(run, Pool(output / "pool"), Pool(output / "pool_with_images", has_images=True))
    return run_experiment(Experiment("trust", output / "trust", listed, run_one, Outcome, report), jobs)


if __name__ == "__main__":
    script(main)
