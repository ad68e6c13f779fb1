"""Running of the cases of an experiment; a stopped run resumes where it was."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import Any, TypeVar

from semcal_cli.batch.pace import Pace
from semcal_cli.batch.processes import ProcessError, Worker, in_processes
from semcal_cli.batch.run import resume
from semcal_cli.errors import CalibrationError, InputError, os_reason
from semcal_cli.experiments.journal import Found, Journal
from semcal_cli.experiments.page_tables import measured_here
from semcal_cli.experiments.result_files import FILES
from semcal_cli.files.reading import check_own_file, read_text
from semcal_cli.files.writing import locked, write_text
from semcal_cli.threads import set_num_threads

JOURNAL, MEASURED = "results.jsonl", "measured.txt"
"""File of the results of each case, and one with a line for each machine, date and commit that they are of."""

Case = TypeVar("Case")
"""Unit of an experiment that is run once; its `repr` identifies it."""


def make_folder(folder: Path) -> None:
    """Create the folder of an experiment, and check that only files stand where files will be written at the end.

    Raises:
        InputError: the folder cannot be created, or a link, a pipe or a folder is in the way.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {os_reason(error)}") from None
    for file in (JOURNAL, MEASURED, *FILES):
        check_own_file(folder / file)


def run_cases(
    cases: Sequence[Case],
    run: Callable[[Case], list[Found]],
    kind: type[Found],
    folder: Path,
    num_jobs: int,
    watcher: Pace | None = None,
) -> list[Found]:
    """Run each case that has no results in `folder` yet; a stopped run resumes where it was.

    With several jobs, each computes on one thread.

    Args:
        cases: All cases of the experiment.
        run: Function that runs one case; it is pickled for other processes.
        kind: Class of the results.
        folder: Folder of `results.jsonl`.
        num_jobs: Number of cases at a time.
        watcher: Told which cases begin and end, by their words.

    Returns:
        Results of all cases, in the order of the cases.

    Raises:
        InputError: the existing results are not of this experiment, or another process writes to them.
        CalibrationError: the process of a case crashed.
    """
    num_threads = 1 if num_jobs > 1 else None
    watcher = watcher or Pace(len(cases), num_jobs)

    def read_outcome(case: Case) -> tuple[Case, list[Found]] | None:
        results = journal.find(case)
        return None if results is None else (case, results)

    def execute(missing: Sequence[Case]) -> Generator[tuple[Case, list[Found]], None, None]:
        watcher.resume(len(cases) - len(missing), len(cases))
        yield from in_processes(missing, measure, num_jobs)

    def measure(worker: Worker, case: Case) -> tuple[Case, list[Found]]:
        watcher.begin(in_words(case))
        try:
            return case, worker.ask(_run, run, num_threads, case)
        except ProcessError as error:
            raise CalibrationError(f"{case}: {error}") from None

    def keep(measured: tuple[Case, list[Found]], is_new: bool) -> None:
        if is_new:
            journal.append(*measured)
            watcher.end(in_words(measured[0]))

    with locked(folder / JOURNAL, "run"):
        journal = Journal(folder / JOURNAL, kind)
        done = resume(cases, read_outcome, execute, on_done=keep, finish=lambda _: journal.sort(cases))
        write_text("".join(f"{where}\n" for where in journal.measured(cases)), folder / MEASURED)
    results = {repr(case): found for case, found in done}
    return [result for case in cases for result in results[repr(case)]]


def read_measured(folder: Path) -> list[str]:
    """Read where and when the results in a folder were measured; here and now, if it keeps no results of cases.

    Raises:
        InputError: the file cannot be read.
    """
    file = folder / MEASURED
    return read_text(file).splitlines() if file.exists() else [measured_here()]


def in_words(case: Any) -> str:
    """Describe a case by its fields: texts as they are, and numbers with their names."""
    parts = [
        value if isinstance(value, str) and not value.isdecimal() else f"{name.removeprefix('num_')} {value}"
        for name, value in vars(case).items()
    ]
    return ", ".join(parts)


def _run(run: Callable[[Case], list[Found]], num_threads: int | None, case: Case) -> list[Found]:
    """Run a case in another process."""
    set_num_threads(num_threads)
    return run(case)
