"""What all scripts of this folder share: options on the command line, tables in a page, experiments, and timing.

The `main` of a script yields the lines of Markdown that it prints. Its parameters are the arguments of the command
line, and those by keyword only its options.
"""

from __future__ import annotations

import inspect
import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

import click
from laboratory.page_tables import command_line, find_place, read_measured

from semcal_cli.cli.experiment import measure
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.errors import CalibrationError, SemcalError
from semcal_cli.experiments.experiment_run import Experiment
from semcal_cli.experiments.measured import measured_here
from semcal_cli.experiments.summary import Column, markdown_table, summarise, summary_table, table_row
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.synthetic.synthesis import synthesize

OUTPUT = Path("semcal_experiments")
"""Folder of the results of experiments, unless `-o` names another one."""
SEMCAL = [
    sys.executable,
    "-c",
    "import sys; sys.path = list(filter(None, sys.path)); from semcal_cli.cli import main; main()",
]
"""The installed command, even if the working directory contains its source."""


def script(main: Callable[..., Iterable[str]]) -> None:
    """Run the `main` of a script on the command line of this process.

    Options without a default have to be given, a tuple is an option that may be given again, and `output` is also `-o`.
    With `--into PAGE` the tables are also written into the place of the page that is named as the script, or
    `PAGE#NAME`.
    """
    name, hints = Path(sys.argv[0]), get_type_hints(main)
    parameters = [_parameter(each, hints[each.name]) for each in inspect.signature(main).parameters.values()]
    into = click.Option(
        ["--into"], metavar="PAGE", help="Also write the tables into their place of this page."
    )
    about = "\n\n".join(f"\b\n{part}" for part in str(sys.modules[main.__module__].__doc__).split("\n\n"))
    command = click.Command(
        name.stem, None, partial(_print, main, name.stem), [*parameters, into], help=about
    )
    try:
        command.main(prog_name=name.name)
    except SemcalError as error:
        sys.exit(str(error))


def _print(main: Callable[..., Iterable[str]], name: str, into: str | None, **options: Any) -> None:
    place = None if into is None else find_place(into, name)
    measured, lines = measured_here(), []
    printed = main(**options)
    for line in printed:
        print(line, flush=True)
        lines.append(line)
    if place is None:
        return
    if isinstance(printed, KeptTable):
        place.write(printed.text, printed.command, printed.measured)
    else:
        place.write("\n".join(lines), command_line(sys.argv), [measured])


@dataclass(frozen=True)
class KeptTable:
    """The lines of a table whose results are kept in files."""

    text: str
    measured: Sequence[str]
    """Where and when the results were measured, as `measured_here` tells it; several if a run resumed elsewhere."""
    command: str
    """Command that measured them."""

    def __iter__(self) -> Iterator[str]:
        return iter(self.text.splitlines())


def run_experiment(experiment: Experiment[Any, Any], jobs: int | None = None) -> KeptTable:
    """Run an experiment with its progress on standard error; a stopped run resumes where it stopped."""
    # The cases run in processes of their own, in which NumPy uses one thread, as in those of `semcal`.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    text = measure(experiment, jobs)
    return KeptTable(text, read_measured(experiment.folder), command_line(sys.argv))


def _parameter(parameter: inspect.Parameter, hint: Any) -> click.Parameter:
    is_multiple, is_open = get_origin(hint) is tuple, parameter.default is parameter.empty
    if get_args(hint) and get_origin(hint) is not Literal:
        hint = get_args(hint)[0]
    if get_origin(hint) is Literal:
        hint = click.Choice(get_args(hint))
    kind = click.Path(path_type=Path) if hint is Path else hint
    if parameter.kind is not parameter.KEYWORD_ONLY:
        return click.Argument([parameter.name], type=kind)
    names = [f"--{parameter.name.replace('_', '-')}", *(["-o"] if parameter.name == "output" else [])]
    settings = {"required": True} if is_open else {"default": parameter.default, "show_default": True}
    return click.Option(names, type=kind, multiple=is_multiple, is_flag=hint is bool, **settings)


def table(header: str, rows: Iterable[Sequence[object]]) -> Iterator[str]:
    """Format a Markdown table line by line, as its rows are found; ` | ` stands between the heads of the columns."""
    yield from markdown_table(header.split(" | "), []).splitlines()
    for row in rows:
        yield table_row(*row)


def summary(groups: Iterable[Sequence[object]], columns: Sequence[Column]) -> Iterator[str]:
    """Format a Markdown table line by line, as groups of results are found, each with a row or more."""
    yield from summary_table([], columns).splitlines()
    for found in groups:
        yield from summary_table(summarise(found, columns), columns).splitlines()[2:]


def street(folder: Path, seed: int, frames: int, width: int, **more: Any) -> tuple[Drive, Pose]:
    """Make a synthetic drive with images of 16 to 9, and read it with its true T_camera_lidar (4, 4)."""
    synthesize(SynthConfig(num_frames=frames, seed=seed, width=width, height=width * 9 // 16, **more), folder)
    return read_drive(folder), read_transform(folder)


class Ended(NamedTuple):
    """A finished process."""

    seconds: float
    """Wall-clock time."""
    cpu_s: float
    """Processor time."""
    peak_gib: float
    """Largest resident memory."""
    messages: str
    """What it wrote to standard error."""


def run_process(command: Sequence[str], codes: Sequence[int] = (0, 3)) -> Ended:
    """Run a process that ends with a result, trusted or not, or another of these exit codes; measure time and memory.

    Linux counts the memory of this process as the new one's until it starts, so the peak is at least that.

    Raises:
        CalibrationError: the process failed.
    """
    begin = perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    with process.stderr as errors:
        messages = errors.read()
    # `Popen.wait` does not report the memory.
    _, status, usage = os.wait4(process.pid, 0)
    code = process.returncode = os.waitstatus_to_exitcode(status)
    if code not in codes:
        raise CalibrationError(f"{' '.join(command)}: exit code {code}: {' '.join(messages.split()[-30:])}")
    return Ended(perf_counter() - begin, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 2**20, messages)


def seconds_of(*arguments: object) -> float:
    """Time `semcal` with arguments, as a whole process."""
    return run_process([*SEMCAL, *map(str, arguments), "-q"]).seconds
