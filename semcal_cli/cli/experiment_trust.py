"""`semcal experiment trust`: whether what semcal states of itself is true, and what its checks measure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.experiment_options import into_option, out_option, print_table, seeds_options
from semcal_cli.extras import check_torch

if TYPE_CHECKING:
    from semcal_cli.experiments.page_tables import Place

PARTS = ("good", "bad", "spoiled", "subtle", "verify")


@click.command()
@seeds_options(
    60,
    "Drives: six calibrations of each as it is, two with classes off alike in all frames, five made impossible, and "
    "15 verifications.",
    first_seed=20_000,
)
@click.option(
    "--only",
    "parts",
    type=click.Choice(PARTS),
    multiple=True,
    default=PARTS,
    help="Only this part; may be given again. Beside others, `spoiled` and `subtle` spoil only every fifth drive.",
)
@click.option(
    "--limits",
    is_flag=True,
    help="Measure instead what each check finds on good and on bad drives, beside its limit: 19 calibrations of each "
    "drive.",
)
@out_option
@into_option
def trust(
    seeds: int,
    first_seed: int,
    jobs: int,
    parts: tuple[str, ...],
    limits: bool,
    out: Path,
    into: Place | None,
) -> None:
    """Count how often intervals contain the truth, verdicts are right, and `verify` detects offsets.

    Drives are also spoiled in the ways of real recordings, and given subtle faults: none should be trusted and wrong.
    Takes about two minutes for each drive, and seven for one that is spoiled. Writes the same files as `accuracy`; a
    stopped run resumes.
    """
    from semcal_cli.cli.experiment_progress import experiment_progress
    from semcal_cli.experiments import runner, trust, trust_rates
    from semcal_cli.experiments.outcome import Outcome
    from semcal_cli.experiments.pool import Pool

    chosen = range(first_seed, first_seed + seeds)
    if limits:
        if parts != PARTS:
            raise click.UsageError("--limits has no parts: leave out --only")
        _measure_limits(chosen, jobs, out, into)
        return
    if "good" in parts:  # every fifth drive of which is calibrated by MINE, too
        check_torch("semcal experiment trust --only good")
    folder = runner.make_folder(out, "trust")
    with experiment_progress(jobs) as watcher:
        findings = runner.run_cases(
            trust.cases(chosen, parts),
            trust.Experiment(Pool(out / "pool"), Pool(out / "pool_with_pictures", has_pictures=True)),
            Outcome,
            folder,
            jobs,
            watcher,
        )
    print_table(trust_rates.write_trust(findings, jobs, folder), folder, into)


def _measure_limits(seeds: range, jobs: int, out: Path, into: Place | None) -> None:
    """Measure what the checks have on good and bad drives; limits.json in the folder is that of the next version."""
    from semcal_cli.cli.experiment_progress import experiment_progress
    from semcal_cli.experiments import limits, limits_table, runner
    from semcal_cli.experiments.pool import Pool

    folder = runner.make_folder(out, "limits")
    with experiment_progress(jobs) as watcher:
        run = limits.Experiment(Pool(out / "pool_of_limits", has_pictures=True))
        values = runner.run_cases(limits.cases(seeds), run, limits.Value, folder, jobs, watcher)
    command = f"semcal experiment trust --limits --first-seed {seeds.start} --seeds {len(seeds)}"
    print_table(limits_table.write_limits(values, jobs, folder, command, seeds), folder, into)
