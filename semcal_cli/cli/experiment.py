"""`semcal experiment`: accuracy and speed, measured here and now on synthetic drives."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import click

from semcal_cli.cli.options import PATH

FIRST_SEED = 10_000
ESTIMATORS = ("exact", "mine")


@click.group()
def experiment() -> None:
    """Measure what the README's tables say, on synthetic drives.

    Writes results.csv, summary.json, table.md and plot.png into a folder of the experiment's name, and keeps its drives
    in a pool beside it, about 45 MB each. An experiment that was stopped goes on where it was.
    """


out_option = click.option(
    "-o",
    "--out",
    type=PATH,
    default="semcal_experiments",
    show_default=True,
    metavar="DIR",
    help="Where results and pool go.",
)


@experiment.command()
@click.option(
    "--seeds", type=click.IntRange(1), default=20, show_default=True, metavar="N", help="Drives for each row."
)
@click.option(
    "--first-seed",
    type=click.IntRange(0),
    default=FIRST_SEED,
    show_default=True,
    metavar="N",
    help="The first of them.",
)
@click.option(
    "--jobs",
    type=click.IntRange(1),
    default=1,
    show_default=True,
    metavar="N",
    help="Calibrations at a time.",
)
@click.option(
    "--estimator",
    "estimators",
    type=click.Choice(ESTIMATORS),
    multiple=True,
    default=ESTIMATORS,
    show_default=True,
    help="What to compare; may be given twice.",
)
@out_option
def accuracy(seeds: int, first_seed: int, jobs: int, estimators: tuple[str, ...], out: Path) -> None:
    """Compare calibrations with the truth, over sensors, lenses, labels and starts.

    Takes about a minute for each seed and job.
    """
    from semcal_cli.cli.session import make_console
    from semcal_cli.experiments import accuracy, runner
    from semcal_cli.refinement import Estimator

    chosen: list[Estimator] = [name for name in get_args(Estimator) if name in estimators]
    folder = runner.make_folder(out, f"accuracy_{'_'.join(chosen)}" if len(chosen) == 1 else "accuracy")
    console = make_console(quiet=False)

    def progress(done: int, total: int) -> None:
        console.print(f"{done} of {total} cases", end="\r" if console.is_terminal else "\n")

    cases = accuracy.cases(range(first_seed, first_seed + seeds))
    results = runner.run_cases(cases, accuracy.make_run(out / "pool", chosen), folder, jobs, progress)
    summaries = runner.write_results("accuracy", results, folder)
    click.echo(runner.markdown(summaries), nl=False)


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

    Wants an idle machine; takes about three minutes for each repeat.
    """
    from semcal_cli.cli.session import make_console
    from semcal_cli.errors import InputError
    from semcal_cli.experiments import runner, speed

    if plain_torch is not None and not plain_torch.is_file():
        raise InputError(f"{plain_torch}: found no such file, needed the script to compare with")
    console = make_console(quiet=False)
    timings = speed.measure(runner.make_folder(out, "speed"), repeats, plain_torch, console.print)
    click.echo(speed.markdown(timings), nl=False)
