"""`semcal experiment`: accuracy and speed, measured here and now on synthetic drives."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import get_args

import click

from semcal_cli.cli.options import MAX_SEED, PATH, Command

FIRST_SEED = 10_000
ESTIMATORS = ("exact", "mine")


@click.group()
def experiment() -> None:
    """Measure what the README's tables say, on synthetic drives."""


out_option = click.option(
    "-o",
    "--out",
    type=PATH,
    default="semcal_experiments",
    show_default=True,
    metavar="DIR",
    help="Where results and pool go.",
)


jobs_option = click.option(
    "--jobs", type=click.IntRange(1), default=1, show_default=True, metavar="N", help="Runs at a time."
)


def first_seed_option(default: int) -> Callable[[Command], Command]:
    """Say which seeds are used."""
    return click.option(
        "--first-seed",
        type=click.IntRange(0, MAX_SEED),
        default=default,
        show_default=True,
        metavar="N",
        help="The first of them.",
    )


@experiment.command()
@click.option(
    "--seeds", type=click.IntRange(1), default=20, show_default=True, metavar="N", help="Drives for each row."
)
@first_seed_option(FIRST_SEED)
@jobs_option
@click.option(
    "--estimator",
    "estimators",
    type=click.Choice(ESTIMATORS),
    multiple=True,
    default=ESTIMATORS,
    show_default=True,
    help="What to compare; may be given twice.",
)
@click.option(
    "--row",
    "rows",
    multiple=True,
    metavar="NAME",
    help="Only this row of the table, as 'network-like labels'; may be given again.",
)
@click.option("--edge-band", type=click.IntRange(0), metavar="PX", help="As in `calibrate`.")
@out_option
def accuracy(
    seeds: int,
    first_seed: int,
    jobs: int,
    estimators: tuple[str, ...],
    rows: tuple[str, ...],
    edge_band: int | None,
    out: Path,
) -> None:
    """Compare calibrations with the truth, over sensors, lenses, labels and starts.

    Takes about two minutes for each seed. Writes results.csv, summary.json, table.md and plot.png into a folder of DIR,
    and keeps its drives in a pool beside it, about 45 MB each. When it was stopped it goes on where it was.
    """
    from semcal_cli.cli.session import make_console
    from semcal_cli.experiments import accuracy, runner
    from semcal_cli.refinement import EDGE_BAND_PX, Estimator

    for row in rows:
        if row not in accuracy.ROWS:
            raise click.BadParameter(
                f"found {row!r}, needed one of: {', '.join(accuracy.ROWS)}", param_hint="--row"
            )
    band = EDGE_BAND_PX if edge_band is None else edge_band
    chosen: tuple[Estimator, ...] = tuple(name for name in get_args(Estimator) if name in estimators)
    console = make_console(quiet=False)

    def progress(done: int, total: int) -> None:
        console.print(f"{done} of {total} cases", end="\r" if console.is_terminal else "\n")

    # Runs that measure something else go on where they were, each in its own folder.
    name = "_".join(
        ["accuracy", *(chosen if len(chosen) == 1 else ()), *(() if edge_band is None else (f"band{band}",))]
    )
    folder = runner.make_folder(out, name)
    cases = accuracy.cases(range(first_seed, first_seed + seeds), rows or tuple(accuracy.ROWS))
    run = accuracy.Experiment(runner.Pool(out / "pool"), chosen, band)
    results = runner.run_cases(cases, run, runner.Result, folder, jobs, progress)
    summaries = runner.write_accuracy(results, jobs, folder)
    click.echo(runner.markdown(summaries), nl=False)


@experiment.command()
@click.option(
    "--seeds",
    type=click.IntRange(1),
    default=60,
    show_default=True,
    metavar="N",
    help="Drives: six calibrations of each as it is, five made impossible, 15 verifications.",
)
@first_seed_option(20_000)
@jobs_option
@out_option
def trust(seeds: int, first_seed: int, jobs: int, out: Path) -> None:
    """Count how often intervals hold the truth, verdicts are right, and `verify` sees what is off.

    Takes about two minutes for each drive. Writes what `accuracy` writes, and goes on where it was when it was stopped.
    """
    from semcal_cli.cli.session import make_console
    from semcal_cli.experiments import runner, trust

    folder = runner.make_folder(out, "trust")
    console = make_console(quiet=False)
    findings = runner.run_cases(
        trust.cases(range(first_seed, first_seed + seeds)),
        trust.Experiment(runner.Pool(out / "pool")),
        trust.Finding,
        folder,
        jobs,
        lambda done, total: console.print(
            f"{done} of {total} runs", end="\r" if console.is_terminal else "\n"
        ),
    )
    click.echo(trust.write_trust(findings, jobs, folder), nl=False)


@experiment.command()
@click.option(
    "--repeats",
    type=click.IntRange(1),
    default=3,
    show_default=True,
    metavar="N",
    help="Runs of each process.",
)
@click.option(
    "--plain-torch",
    type=PATH,
    metavar="FILE",
    help="Compare with this script: tests/benchmarks/plain_torch.py of a clone.",
)
@out_option
def speed(repeats: int, plain_torch: Path | None, out: Path) -> None:
    """Time whole processes, and compare the refinement with the same in plain torch.

    Wants an idle machine; takes about three minutes for each repeat. Writes what `accuracy` writes, and goes on
    where it was when it was stopped.
    """
    from semcal_cli.cli.session import make_console
    from semcal_cli.errors import InputError
    from semcal_cli.experiments import runner, speed

    if plain_torch is not None and not plain_torch.is_file():
        raise InputError(f"{plain_torch}: found no such file, needed the script to compare with")
    folder = runner.make_folder(out, "speed")
    console = make_console(quiet=False)
    experiment = speed.Experiment(folder, plain_torch and plain_torch.resolve())
    timings = runner.run_cases(
        experiment.cases(repeats),
        experiment,
        speed.Timing,
        folder,
        1,
        lambda done, total: console.print(f"{done} of {total} runs"),
    )
    click.echo(speed.markdown(speed.write_speed(timings, folder)), nl=False)
