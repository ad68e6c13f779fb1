"""What all commands of `semcal experiment` share: drives, folder, progress, and the final table."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from importlib import import_module
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, TypeVar

import click
from rich.console import Console
from rich.text import Text

from semcal_cli.batches.pace import Pace
from semcal_cli.cli.settings import PATH
from semcal_cli.cli.terminal import clock_time, live_lines, make_console, running_lines, time_left
from semcal_cli.config import MAX_SEED

if TYPE_CHECKING:
    from semcal_cli.experiments.experiment import Experiment
    from semcal_cli.experiments.page_tables import Place

Command = TypeVar("Command", bound=Callable[..., Any])


def number_option(
    *names: str, default: int, help: str, least: int = 1, most: int | None = None
) -> Callable[[Command], Command]:
    """Make an integer option whose help shows its default.

    Args:
        names: Names of the option.
        default: Default value.
        help: Help text.
        least: Smallest value.
        most: Largest value; None for any.
    """
    kind = click.IntRange(least, most)
    return click.option(*names, type=kind, default=default, show_default=True, metavar="N", help=help)


def _find_place(context: click.Context, parameter: click.Parameter, into: str | None) -> Place | None:
    """Find the place before the experiment runs."""
    from semcal_cli.experiments.page_tables import find_place

    return None if into is None else find_place(into, str(context.info_name))


def out_options(command: Command) -> Command:
    """Add the options for the folder of the results, and for the page of the table."""
    into = click.option(
        "--into",
        metavar="PAGE[#NAME]",
        callback=_find_place,
        help="Also write the table into this Markdown page, between the lines `<!-- table: NAME -->` and "
        "`<!-- end of table -->`.  [default NAME: that of the experiment]",
    )
    out = click.option(
        "-o",
        "--out",
        type=PATH,
        default="semcal_experiments",
        show_default=True,
        metavar="DIR",
        help="Folder for the results and the pool of drives.",
    )
    return out(into(command))


def seeds_options(num_seeds: int, help: str, first_seed: int) -> Callable[[Command], Command]:
    """Add the options for the drives of an experiment, and for the number of parallel runs.

    Args:
        num_seeds: Default number of drives.
        help: Help text of the number of drives.
        first_seed: Default seed of the first drive.
    """
    jobs = number_option("--jobs", default=1, help="Number of runs in parallel.")
    first = number_option(
        "--first-seed", least=0, most=MAX_SEED, default=first_seed, help="Seed of the first drive."
    )
    seeds = number_option("--seeds", default=num_seeds, help=help)
    return lambda command: seeds(first(jobs(command)))


def rows_option(module: str, example: str) -> Callable[[Command], Command]:
    """Add the option for some rows of a table.

    Args:
        module: Module of `semcal_cli.experiments` whose `ROWS` are known.
        example: Name of a row, for the help.
    """

    def check(_: click.Context, __: click.Parameter, rows: tuple[str, ...]) -> tuple[str, ...]:
        known = import_module(f"semcal_cli.experiments.{module}").ROWS if rows else ()
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
        help=f"Run only this row of the table, such as '{example}'; may be repeated.",
    )


def measures(declare: Callable[..., Experiment[Any, Any]]) -> Callable[..., None]:
    """Make a command from a function that declares an experiment: it runs the experiment and shows its table.

    The function gets `out`, its own options, and the range `seeds` if the command has `seeds_options`.
    """

    @out_options
    @wraps(declare)
    def command(out: Path, into: Place | None, jobs: int | None = None, **options: Any) -> None:
        if "first_seed" in options:
            first_seed = options.pop("first_seed")
            options["seeds"] = range(first_seed, first_seed + options["seeds"])
        experiment = declare(out=out, **options)
        console = make_console()
        progress = Progress(console, jobs or 1)
        with live_lines(console, progress.lines):
            table = experiment.measure(jobs, progress)
        print_table(table, experiment.folder, into)

    return command


def print_table(table: str, folder: Path, into: Place | None) -> None:
    """Print the table of an experiment, and where its files are; write it into its place on a page."""
    from semcal_cli.experiments.experiment import read_measured

    click.echo(table, nl=False)
    click.echo(f"written to {folder}", err=True)
    if into is not None:
        into.write(table, read_measured(folder))


class Progress(Pace):
    """Shows the runs of an experiment: the running ones on a terminal, or one line per finished run on a pipe."""

    def __init__(self, console: Console, num_jobs: int) -> None:
        super().__init__(0, num_jobs)
        self._console, self._began = console, monotonic()

    def resume(self, num_done: int, num_items: int) -> None:
        """Report how many runs are already done."""
        super().resume(num_done, num_items)
        if num_done and not self._console.is_terminal:
            self._console.print(f"{num_done:,} of {num_items:,} runs are already done")

    def end(self, name: str) -> None:
        """Count a run, and name it on a pipe."""
        super().end(name)
        if not self._console.is_terminal:
            told = ", ".join(
                filter(None, [f"after {clock_time(monotonic() - self._began)}", time_left(self)])
            )
            number = f"{self.num_done:>{len(str(self.num_items))}}/{self.num_items}"
            self._console.print(f"{number}  {name}  ({told})", markup=False)

    def lines(self) -> list[Text]:
        """Say how many runs are done and about how long the rest takes, and list the running ones."""
        count = f"{self.num_done:,} of {self.num_items:,} runs are done"
        return [Text("   ".join(filter(None, [count, time_left(self)]))), *running_lines(self)]
