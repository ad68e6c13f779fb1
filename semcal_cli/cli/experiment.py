"""`semcal experiment`: semcal compared with other methods, on this machine."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.text import Text

from semcal_cli.cli.options import max_points
from semcal_cli.cli.settings import KNOWN_TRANSFORMS, argument, option, setting_of
from semcal_cli.cli.settings_command import command
from semcal_cli.cli.terminal import clock_time, live_lines, make_console, running_lines, time_left
from semcal_cli.config import MAX_SEED, CalibrationConfig
from semcal_cli.errors import check_torch
from semcal_cli.many.batch.pace import Pace

if TYPE_CHECKING:
    from semcal_cli.experiments.experiment_run import Experiment


@click.group()
def experiment() -> None:
    """Compare semcal with other methods."""


@dataclass(frozen=True, kw_only=True)
class ExperimentSettings:
    """The option of every experiment."""

    output: Path = option(
        "Folder for the results.", "-o", "--output", default=Path("semcal_experiments"), metavar="DIR"
    )


class ListedName(click.ParamType[str]):
    """A name of a list that is imported only when one is given, so that `--help` stays fast."""

    def __init__(self, name: str, names: Callable[[], Collection[str]]) -> None:
        """Make the type, named as in messages, with the function that lists the names."""
        self.name, self.names = name, names

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Check that the name is listed."""
        if value not in (names := self.names()):
            self.fail(f"found {value!r}, expected one of: {'; '.join(names)}.", param, ctx)
        return str(value)


def _methods() -> Collection[str]:
    from semcal_cli.experiments.methods import METHODS

    return METHODS


def _numbers_of_pairs() -> Collection[str]:
    from semcal_cli.experiments.pairs_and_noise import EXPERIMENTS

    return [setting.name for setting in EXPERIMENTS["pairs"]]


@dataclass(frozen=True, kw_only=True)
class MethodsSettings(ExperimentSettings):
    """Settings of experiments that compare methods on synthetic drives."""

    seeds: int = option("Number of drives, each with one run per table cell.", default=20, minimum=1)
    first_seed: int = option("Seed of the first drive.", default=50_000, minimum=0, maximum=MAX_SEED)
    jobs: int = option("Number of runs in parallel.", default=1, minimum=1)
    method: tuple[str, ...] = option(
        "Run this method alone, by its name in the table, such as semcal or SOIC. Give the option again for each "
        "method.",
        type=ListedName("method", _methods),
        metavar="NAME",
        multiple=True,
        default=(),
    )
    unmended: bool = option(
        "Leave isolated wrong pixels as they are for every method; the paper's method always does. Results go to a "
        "separate folder.",
        default=False,
    )


@dataclass(frozen=True, kw_only=True)
class PairsSettings(MethodsSettings):
    """Settings of `pairs`."""

    pairs: tuple[str, ...] = option(
        "Run this number of pairs alone. Give the option again for each number.",
        type=ListedName("number", _numbers_of_pairs),
        metavar="N",
        multiple=True,
        default=(),
    )


def _compare_methods(name: str, settings: MethodsSettings, chosen: tuple[str, ...] = ()) -> None:
    from semcal_cli.experiments import pairs_and_noise

    check_torch(f"semcal experiment {name}")
    seeds = range(settings.first_seed, settings.first_seed + settings.seeds)
    choice = pairs_and_noise.Choice(chosen, settings.method)
    runs = pairs_and_noise.experiment(
        settings.output, seeds, name, choice, removes_speckle=not settings.unmended
    )
    click.echo(measure(runs, settings.jobs), nl=False)


@command(PairsSettings, experiment)
def pairs(settings: PairsSettings) -> None:
    """Compare methods over the number of pairs.

    The numbers are 1, 2, 5, 10, 20, 50 and 70. semcal, the paper's method, SOIC and PMI start from the same pose, 2
    degrees and 0.2 m off; the paper's method also runs from its own start, without an initial guess. Writes
    results.csv, summary.json, table.md and plot.png to a folder in DIR; a stopped run resumes where it stopped. With
    `--pairs` and `--method`, these files have the chosen runs alone, and a later run goes on from them.
    """
    _compare_methods("pairs", settings, settings.pairs)


@command(MethodsSettings, experiment)
def noise(settings: MethodsSettings) -> None:
    """Compare methods over the share of wrong labels.

    The share is 0 to 50 % on both sides, with 20 pairs. Otherwise as `pairs`; PMI does not use labels.
    """
    _compare_methods("noise", settings)


@dataclass(frozen=True, kw_only=True)
class TableSettings(ExperimentSettings):
    """Settings of `table`."""

    drive: Path = argument()
    reference: Path | None = option(
        f"Reference: {KNOWN_TRANSFORMS}.  [default: the drive's own]", metavar="FILE|DRIVE"
    )
    init: Path | None = option(
        "Start of all methods.  [default: semcal's initial calibration]", metavar="FILE|DRIVE"
    )
    frame: int = option(
        "Frame that the images show, counted from 0 among the frames used.", default=0, minimum=0
    )
    max_frames: int = setting_of(CalibrationConfig, "max_frames")
    max_points: int = max_points()


@command(TableSettings, experiment)
def table(settings: TableSettings) -> None:
    """Compare methods on DRIVE with its reference.

    All methods start from the same pose. Writes results.csv, summary.json, table.md and the images (a) to (d) to the
    drive's folder in DIR: the points at the reference, and where SOIC, PMI and semcal put them. If the reference is
    within 1 degree and 10 cm of that of RELLIS-3D or KITTI-360, the poses that the paper reports are listed below it,
    measured on the same frames.
    """
    from semcal_cli.cli.output_checks import check_outputs
    from semcal_cli.cli.stage_options import read_initial_pose
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.config import MAX_BASELINE_M
    from semcal_cli.drive.document import drive_file, read_drive
    from semcal_cli.experiments.experiment_run import prepare_folder
    from semcal_cli.experiments.table import FILES, compare, write_table
    from semcal_cli.formats import WITHOUT_OPTIONS, read_transform
    from semcal_cli.observations.loading import load

    check_torch("semcal experiment table")
    spec = read_drive(settings.drive, settings.max_points)
    T_reference = read_transform(settings.reference or settings.drive, options=WITHOUT_OPTIONS)
    initial_pose = None if settings.init is None else read_initial_pose(settings.init)
    if initial_pose is not None:
        initial_pose.check_distance(MAX_BASELINE_M)
    folder = settings.output / f"table_{spec.root.resolve().name}"
    prepare_folder(folder)
    transforms = [drive_file(path) for path in (settings.reference, settings.init) if path is not None]
    check_outputs(
        [spec.path, *map(spec.resolve, spec.files()), *transforms], *(folder / name for name in FILES)
    )
    with Terminal(quiet=False) as terminal:
        terminal.show("reading frames")
        data = load(spec, CalibrationConfig(max_frames=settings.max_frames))
        comparison = compare(data, T_reference, initial_pose, settings.frame, terminal.show)
    click.echo(write_table(comparison, settings.frame, folder), nl=False)
    click.echo(f"written to {folder}", err=True)


def measure(experiment: Experiment[Any, Any], num_jobs: int | None) -> str:
    """Run an experiment, show its progress, name the folder of its files, and return its table.

    Args:
        experiment: The experiment.
        num_jobs: As in `Experiment.measure`.

    Raises:
        SemcalError: as `Experiment.measure`.
    """
    console = make_console()
    progress = RunProgress(console, num_jobs or 1)
    with live_lines(console, progress.lines):
        report = experiment.measure(num_jobs, progress)
    click.echo(f"written to {experiment.folder}", err=True)
    return report


class RunProgress(Pace):
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
            times = ", ".join(
                filter(None, [f"after {clock_time(monotonic() - self._began)}", time_left(self)])
            )
            number = f"{self.num_done:>{len(str(self.num_items))}}/{self.num_items}"
            self._console.print(f"{number}  {name}  ({times})", markup=False)

    def lines(self) -> list[Text]:
        """Describe how many runs are done and about how long the rest takes, and list the running ones."""
        count = f"{self.num_done:,} of {self.num_items:,} runs are done"
        return [Text("   ".join(filter(None, [count, time_left(self)]))), *running_lines(self)]
