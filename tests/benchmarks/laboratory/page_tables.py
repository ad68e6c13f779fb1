"""Tables in pages of the documentation, each written by the command that measures its figures.

A page holds places: the line `<!-- table: NAME -->`, and below it the line `<!-- end of table -->`. What is between
them is replaced by the tables and, below them, the command, the machine, the date and the commit.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from semcal_cli.errors import InputError
from semcal_cli.experiments.experiment_run import MEASURED
from semcal_cli.experiments.measured import measured_here
from semcal_cli.files.input_files import read_text
from semcal_cli.files.output_files import check_replaceable, write_text

END = "<!-- end of table -->"
TABLE = re.compile(r"(?:^\|.*\n)+", re.MULTILINE)


class Place(NamedTuple):
    """A place in a page, into which a command writes its tables."""

    page: Path
    name: str

    @property
    def start(self) -> str:
        """The line above the place."""
        return f"<!-- table: {self.name} -->"

    def write(self, printed: str, command: str, measured: Sequence[str]) -> None:
        """Write the tables of what a command printed; the rest of the page stays as it is.

        Args:
            printed: Text with Markdown tables; its other lines are left out.
            command: The command, as from `command_line`.
            measured: Where and when, as from `measured_here`; several if a stopped run was resumed elsewhere.

        Raises:
            InputError: the page cannot be read or written, it does not have exactly one such place, or no table was
                printed.
        """
        before, after = self.split()
        tables = "\n".join(TABLE.findall(f"{printed}\n"))
        if not tables:
            raise InputError(f"{self.page}: found no table to write below {self.start!r}")
        line = f"Measured by `{command}` on {'; on '.join(measured)}."
        write_text(f"{before}\n\n{tables}\n{line}\n\n{after}", self.page)

    def split(self) -> tuple[str, str]:
        """Read what is before and after the content of the place, including its two lines.

        Raises:
            InputError: the page cannot be read, or it does not have exactly one such place.
        """
        text = read_text(self.page)
        content = r"\n(?:(?!<!-- table:).*\n)*?"
        places = [*re.finditer(f"^({re.escape(self.start)}){content}({re.escape(END)})$", text, re.MULTILINE)]
        if len(places) != 1:
            raise InputError(
                f"{self.page}: found {len(places)} places from a line {self.start!r} to a line {END!r}, expected one"
            )
        return text[: places[0].end(1)], text[places[0].start(2) :]


def find_place(into: str, name: str) -> Place:
    """Find the place that `PAGE` names, or `PAGE#NAME` where its name is not that of the command.

    Raises:
        InputError: the page cannot be read, its folder cannot be written to, or it does not have exactly one such
            place.
    """
    page, _, other = into.rpartition("#")
    # File and folder names may contain "#", too; names of places contain neither a point nor a slash.
    place = Place(Path(page), other) if other.isidentifier() and page else Place(Path(into), name)
    place.split()
    check_replaceable(place.page)
    return place


def command_line(arguments: Sequence[str]) -> str:
    """Format the command of a script as it was called, without `--into` and without the folders of this machine.

    Args:
        arguments: `sys.argv` of the script.
    """
    program, *words = arguments
    # Only the last name of an absolute path, or of one above the working folder, means something elsewhere.
    words = [re.sub(r"(^|^-\w|=)(?:/|\.\./).*/", r"\1", word.rstrip("/")) for word in words]
    command = shlex.join(["python", f"tests/benchmarks/{Path(program).name}", *words])
    return re.sub(r" (?:--into |'?--into=)(?:'[^']*'|[^\s']+'?)", "", command)


def read_measured(folder: Path) -> list[str]:
    """Read where and when the results in a folder were measured; here and now if it keeps no results.

    Raises:
        InputError: the file cannot be read.
    """
    file = folder / MEASURED
    return read_text(file).splitlines() if file.exists() else [measured_here()]
