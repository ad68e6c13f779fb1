"""The file of an experiment's results, which gets the results of each case when it is done."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Generic, TypeVar

from semcal_cli.errors import InputError
from semcal_cli.experiments.page_tables import measured_here
from semcal_cli.files.reading import read_text
from semcal_cli.files.writing import write_text

MAX_BYTES = 256 << 20
"""Largest size of the file of results."""
UNKNOWN = "a machine that is not known"
"""Where the results of a semcal that did not tell it were measured."""
Found = TypeVar("Found")
"""Result of a case: a dataclass of numbers and strings."""


class Journal(Generic[Found]):
    """`results.jsonl`: the `repr` of a case identifies it; cases of another version of semcal do not count."""

    def __init__(self, file: Path, kind: type[Found]) -> None:
        """Read the file; an incomplete last line, left by a stopped run, is cut off.

        Raises:
            InputError: a line is not a case of this experiment.
        """
        self.file, self._here = file, measured_here()
        self._before = self._cut_off_half_a_line()
        self._new: dict[str, str] = {}
        self._known: dict[str, tuple[list[Found], str]] = {}
        for number, text in enumerate(self._before.splitlines(keepends=True), start=1):
            try:
                line = json.loads(text)
                if line["version"] == version("semcal"):
                    found = [kind(**result) for result in line["results"]]
                    self._known[line["case"]] = found, line.get("measured", UNKNOWN)
            except (ValueError, KeyError, TypeError):
                needed = "needed a case of this experiment; without the file, all is run anew"
                raise InputError(f"{file}: line {number}: found {text[:40]!r}, {needed}") from None

    def find(self, case: object) -> list[Found] | None:
        """Results of a case, or None if it has not been run."""
        found, _ = self._known.get(repr(case), (None, ""))
        return found

    def measured(self, cases: Sequence[object]) -> list[str]:
        """Tell where and when the results of cases were measured, each once."""
        return list(dict.fromkeys(self._known[repr(case)][1] for case in cases))

    def append(self, case: object, results: list[Found]) -> None:
        """Append the results of a case."""
        self._known[repr(case)] = results, self._here
        listed = [vars(result) for result in results]
        line = {"case": repr(case), "version": version("semcal"), "measured": self._here, "results": listed}
        self._new[repr(case)] = json.dumps(line) + "\n"
        with self.file.open("a") as file:
            file.write(self._new[repr(case)])

    def sort(self, cases: Sequence[object]) -> None:
        """Sort the lines by the order of the cases; several jobs finish cases in another order."""
        ordered = [self._new[repr(case)] for case in cases if repr(case) in self._new]
        if ordered != list(self._new.values()):
            write_text(self._before + "".join(ordered), self.file)

    def _cut_off_half_a_line(self) -> str:
        text = read_text(self.file, limit=MAX_BYTES)
        whole = text[: text.rfind("\n") + 1]
        if half := text[len(whole) :]:
            # The file is cut in place, since it is locked: a new file of the same name would not be.
            os.truncate(self.file, self.file.stat().st_size - len(half.encode()))
        return whole
