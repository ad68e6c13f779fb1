"""What all commands of `semcal experiment` have in common: where results go, which drives, and the table at the end."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.options import PATH, Command, number_option
from semcal_cli.config import MAX_SEED

if TYPE_CHECKING:
    from semcal_cli.experiments.page_tables import Place

out_option = click.option(
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


into_option = click.option(
    "--into",
    metavar="PAGE[#NAME]",
    callback=_find_place,
    help="Markdown page to write the table into, too: between its lines `<!-- table: NAME -->` and "
    "`<!-- end of table -->`.  [default NAME: that of the experiment]",
)


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


def print_table(table: str, folder: Path, into: Place | None) -> None:
    """Print the table of an experiment, and where its files lie; write it into its place of a page."""
    from semcal_cli.experiments.runner import read_measured

    click.echo(table, nl=False)
    click.echo(f"written to {folder}", err=True)
    if into is not None:
        into.write(table, read_measured(folder))
