"""What all commands of `semcal experiment` share: which drives, where results go, and the table at the end."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.options import PATH, Command, number_option
from semcal_cli.config import MAX_SEED

if TYPE_CHECKING:
    from semcal_cli.experiments.experiment import Experiment
    from semcal_cli.experiments.page_tables import Place

_out_option = click.option(
    "-o",
    "--out",
    type=PATH,
    default="semcal_experiments",
    show_default=True,
    metavar="DIR",
    help="Folder of the results and the pool.",
)


def _find_place(context: click.Context, parameter: click.Parameter, into: str | None) -> Place | None:
    """Find the place before the experiment is run."""
    from semcal_cli.experiments.page_tables import find_place

    return None if into is None else find_place(into, str(context.info_name))


_into_option = click.option(
    "--into",
    metavar="PAGE[#NAME]",
    callback=_find_place,
    help="Markdown page to write the table into, too: between its lines `<!-- table: NAME -->` and "
    "`<!-- end of table -->`.  [default NAME: that of the experiment]",
)


def out_options(command: Command) -> Command:
    """Add the options for the folder of the results, and for the page of the table."""
    return _out_option(_into_option(command))


def seeds_options(num_seeds: int, help: str, first_seed: int) -> Callable[[Command], Command]:
    """Add the options for the drives of an experiment, and for the number of parallel runs.

    Args:
        num_seeds: Default number of drives.
        help: Help text of the number of drives.
        first_seed: Default seed of the first drive.
    """

    def add(command: Command) -> Command:
        for option in (
            number_option("--jobs", default=1, help="Number of runs at a time."),
            number_option(
                "--first-seed", least=0, most=MAX_SEED, default=first_seed, help="Seed of the first drive."
            ),
            number_option("--seeds", default=num_seeds, help=help),
        ):
            command = option(command)
        return command

    return add


def rows_option(module: str, example: str) -> Callable[[Command], Command]:
    """Add the option for some rows of a table.

    Args:
        module: Module of `semcal_cli.experiments` whose `ROWS` are known.
        example: Name of a row, for the help.
    """

    def check(_: click.Context, __: click.Parameter, rows: tuple[str, ...]) -> tuple[str, ...]:
        if rows:
            known = import_module(f"semcal_cli.experiments.{module}").ROWS
            for row in rows:
                if row not in known:
                    needed = ", ".join(known)
                    raise click.BadParameter(f"found {row!r}, needed one of: {needed}", param_hint="--row")
        return rows

    return click.option(
        "--row",
        "rows",
        multiple=True,
        metavar="NAME",
        callback=check,
        help=f"Only this row of the table, as '{example}'; may be given again.",
    )


def measures(declare: Callable[..., Experiment[Any, Any]]) -> Callable[..., None]:
    """Make a command of a function that declares an experiment: it is run, and its table is shown.

    The function gets `out`, its own options, and `seeds`, a range, if the command has `seeds_options`.
    """

    @out_options
    @wraps(declare)
    def command(out: Path, into: Place | None, jobs: int = 1, **options: Any) -> None:
        from semcal_cli.cli.experiment_progress import experiment_progress
        from semcal_cli.experiments.runner import make_folder

        if "first_seed" in options:
            first_seed = options.pop("first_seed")
            options["seeds"] = range(first_seed, first_seed + options["seeds"])
        experiment = declare(out=out, **options)
        make_folder(experiment.folder)
        with experiment_progress(jobs) as watcher:
            table = experiment.measure(jobs, watcher)
        print_table(table, experiment.folder, into)

    return command


def print_table(table: str, folder: Path, into: Place | None) -> None:
    """Print the table of an experiment, and where its files lie; write it into its place of a page."""
    from semcal_cli.experiments.runner import read_measured

    click.echo(table, nl=False)
    click.echo(f"written to {folder}", err=True)
    if into is not None:
        into.write(table, read_measured(folder))
