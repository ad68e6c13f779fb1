"""What all experiments are: cases, a function that runs one, and a report of all results."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import rmtree
from typing import Generic

from semcal_cli.batch.pace import Pace
from semcal_cli.experiments.journal import Found
from semcal_cli.experiments.result_files import Report, write_report
from semcal_cli.experiments.runner import Case, run_cases


@dataclass(frozen=True)
class Experiment(Generic[Case, Found]):
    """An experiment, as one of the modules declares it."""

    name: str
    """Name in the summary."""
    folder: Path
    """Folder of the results."""
    cases: Sequence[Case]
    """All cases."""
    run: Callable[[Case], list[Found]]
    """Runs one case; it is pickled for other processes."""
    result: type[Found]
    """Class of the results."""
    report: Callable[[Sequence[Found]], Report]
    """Sums up all results."""
    complete: Callable[[list[Found]], list[Found]] = list
    """Adds results that follow from others."""
    scratch: Path | None = None
    """Folder that is deleted at the end."""
    has_jobs: bool = True
    """Whether the summary tells the number of jobs."""

    def measure(self, num_jobs: int, watcher: Pace) -> str:
        """Run all cases that have no results yet, write the files, and return the table.

        Raises:
            InputError: as `run_cases`, or a file cannot be written.
            CalibrationError: as `run_cases`.
        """
        results = run_cases(self.cases, self.run, self.result, self.folder, num_jobs, watcher)
        if self.scratch is not None:
            rmtree(self.scratch, ignore_errors=True)
        results = self.complete(results)
        report = self.report(results)
        write_report(self.name, results, report, self.folder, num_jobs if self.has_jobs else None)
        return report.table
