"""What all experiments share: cases that run once, results that are kept, and the files that are written.

A stopped run resumes where it stopped. Results from several machines are kept together.
"""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.experiments.measured import machine, measured_here
from semcal_cli.experiments.plots import plot_png
from semcal_cli.experiments.summary import Column, summarise, summary_table
from semcal_cli.files.input_files import check_own_file, read_text
from semcal_cli.files.output_files import lock_file, make_folder, open_own, write_bytes, write_text
from semcal_cli.many.batch.pace import Pace
from semcal_cli.many.batch.processes import ProcessError, Worker, in_processes
from semcal_cli.threads import set_num_threads

if TYPE_CHECKING:
    from matplotlib.figure import Figure

JOURNAL, MEASURED = "results.jsonl", "measured.txt"
"""Files of the results of each case, and of the machines, dates and commits where they were measured, one a line."""
FILES = RESULTS, SUMMARY, TABLE, PLOT = "results.csv", "summary.json", "table.md", "plot.png"
"""Files that are written when all cases have run."""
MAX_JOURNAL_BYTES = 256 << 20
UNKNOWN_MACHINE = "an unknown machine"
"""Stands for the machine of results that do not record where they were measured."""
Case = TypeVar("Case")
"""Unit of an experiment that runs once, a dataclass; its `repr` identifies it."""
Result = TypeVar("Result")
"""Result of a case: a dataclass of numbers and strings."""


@dataclass(frozen=True)
class Report:
    """What an experiment writes besides its results."""

    rows: Sequence[Mapping[str, Any]]
    """Rows of the summary."""
    table: str
    """Markdown of the table."""
    draw: Callable[[], Figure] | None = None
    """Draws the plot; None without one."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """Entries of the summary that precede its rows."""
    texts: Mapping[str, str] = field(default_factory=dict)
    """Texts of further files, by file name."""

    @classmethod
    def of(cls, results: Sequence[Any], columns: Sequence[Column], **more: Any) -> Report:
        """Summarise the results of each group in the columns of the table; `more` holds the other fields."""
        rows = summarise(results, columns)
        return cls(rows, summary_table(rows, columns), **more)

    def write(self, name: str, results: Sequence[Any], folder: Path, num_jobs: int | None = None) -> None:
        """Write results.csv, summary.json with this machine's description, table.md and, if there is one, plot.png.

        Args:
            name: Name of the experiment.
            results: Results, dataclasses of one class.
            folder: Folder of the files.
            num_jobs: Number of cases that ran in parallel; None leaves it out of the summary.

        Raises:
            InputError: a file cannot be written.
        """
        file = io.StringIO()
        writer = csv.DictWriter(file, list(vars(results[0])), lineterminator="\n")
        writer.writeheader()
        writer.writerows(vars(result) for result in results)
        jobs = {} if num_jobs is None else {"jobs": num_jobs}
        document = {"experiment": name, "machine": machine(), **jobs, **self.facts, "rows": self.rows}
        summary = json.dumps(document, indent=2) + "\n"
        texts = {RESULTS: file.getvalue(), SUMMARY: summary, TABLE: self.table, **self.texts}
        for file_name, text in texts.items():
            write_text(text, folder / file_name)
        if self.draw is not None:
            write_bytes(plot_png(self.draw), folder / PLOT)


@dataclass(frozen=True)
class Experiment(Generic[Case, Result]):
    """An experiment, as one of the modules declares it."""

    name: str
    """Name in the summary."""
    folder: Path
    """Folder of the results."""
    cases: Sequence[Case]
    """All cases."""
    run: Callable[[Case], list[Result]]
    """Runs one case; it is pickled for other processes."""
    result: type[Result]
    """Class of a result."""
    report: Callable[[Sequence[Result]], Report]
    """Summarises all results."""
    complete: Callable[[list[Result]], list[Result]] = list
    """Adds results that follow from others."""
    scratch: Path | None = None
    """Folder that is deleted at the end."""

    def measure(self, num_jobs: int | None, watcher: Pace) -> str:
        """Run all cases that have no results yet, write the files, and return the table.

        Args:
            num_jobs: Number of cases to run in parallel; None runs one at a time and is left out of the summary.
            watcher: Notes which cases begin and end.

        Raises:
            InputError: the existing results are from another experiment, another process writes to them, or a file
                cannot be written.
            CalibrationError: the process of a case crashed.
        """
        prepare_folder(self.folder)
        results = self.run_cases(num_jobs or 1, watcher)
        if self.scratch is not None:
            rmtree(self.scratch, ignore_errors=True)
        results = self.complete(results)
        report = self.report(results)
        report.write(self.name, results, self.folder, num_jobs)
        return report.table

    def run_cases(self, num_jobs: int, watcher: Pace) -> list[Result]:
        """Run each case that has no results in the folder yet; with several jobs, each computes on one thread.

        Returns:
            Results of all cases, in the order of the cases.

        Raises:
            InputError: as `measure`.
            CalibrationError: as `measure`.
        """
        num_threads = 1 if num_jobs > 1 else None

        def run(worker: Worker, case: Case) -> tuple[Case, list[Result]]:
            watcher.begin(describe_case(case))
            try:
                return case, worker.ask(_run, self.run, num_threads, case)
            except ProcessError as error:
                raise CalibrationError(f"{case}: {error}") from None

        with lock_file(self.folder / JOURNAL, "run"):
            journal = Journal(self.folder / JOURNAL, self.result)
            missing = [case for case in self.cases if repr(case) not in journal.entries]
            watcher.resume(len(self.cases) - len(missing), len(self.cases))
            try:
                # Closing the generator ends its processes; a traceback would keep it alive.
                with closing(in_processes(missing, run, num_jobs)) as done:
                    for case, results in done:
                        journal.append(case, results)
                        watcher.end(describe_case(case))
            finally:
                journal.sort(self.cases)
            measured = [journal.entries[repr(case)] for case in self.cases]
            machines = dict.fromkeys(machine for _, machine in measured)
            write_text("".join(f"{machine}\n" for machine in machines), self.folder / MEASURED)
        return [result for results, _ in measured for result in results]


def prepare_folder(folder: Path) -> None:
    """Create the folder of an experiment, and check that nothing but files is where files will be written.

    Raises:
        InputError: the folder cannot be created, or a link, a pipe or a folder is in the way.
    """
    make_folder(folder)
    for file in (JOURNAL, MEASURED, *FILES):
        check_own_file(folder / file)


def describe_case(case: Any) -> str:
    """Describe a case by its fields: texts alone, numbers with their names."""
    return ", ".join(
        value if isinstance(value, str) and not value.isdecimal() else f"{name.removeprefix('num_')} {value}"
        for name, value in vars(case).items()
    )


class Journal(Generic[Result]):
    """`results.jsonl`: one line for each finished case; cases of other versions of semcal do not count."""

    def __init__(self, file: Path, kind: type[Result]) -> None:
        """Read the file, and cut off an incomplete last line, which a stopped run leaves.

        Raises:
            InputError: a line is not a case of this experiment.
        """
        self.file, self._here, self._new = file, measured_here(), dict[str, str]()
        self.entries = dict[str, tuple[list[Result], str]]()
        """Results and where they were measured, by the `repr` of the case."""
        text = read_text(file, limit=MAX_JOURNAL_BYTES)
        self._before = text[: text.rfind("\n") + 1]
        if incomplete := text[len(self._before) :]:
            # The file is truncated in place, because it is locked: a new file of the same name would not be.
            os.truncate(file, file.stat().st_size - len(incomplete.encode()))
        for number, text in enumerate(self._before.splitlines(keepends=True), start=1):
            try:
                line = json.loads(text)
                if line["version"] == version("semcal"):
                    results = [kind(**result) for result in line["results"]]
                    self.entries[line["case"]] = results, line.get("measured", UNKNOWN_MACHINE)
            except (ValueError, KeyError, TypeError):
                needed = "expected a case of this experiment; delete the file to run all cases again"
                raise InputError(f"{file}: line {number}: found {text[:40]!r}, {needed}") from None

    def append(self, case: object, results: list[Result]) -> None:
        """Append the results of a case."""
        self.entries[repr(case)] = results, self._here
        documents = [vars(result) for result in results]
        line = {
            "case": repr(case),
            "version": version("semcal"),
            "measured": self._here,
            "results": documents,
        }
        self._new[repr(case)] = json.dumps(line) + "\n"
        with open_own(self.file) as file:
            file.write(self._new[repr(case)].encode())

    def sort(self, cases: Sequence[object]) -> None:
        """Sort the new lines by the order of the cases, which parallel jobs finish in another order."""
        ordered = [self._new[repr(case)] for case in cases if repr(case) in self._new]
        if ordered != list(self._new.values()):
            write_text(self._before + "".join(ordered), self.file)


def _run(run: Callable[[Case], list[Result]], num_threads: int | None, case: Case) -> list[Result]:
    """Run a case in another process."""
    set_num_threads(num_threads)
    return run(case)
