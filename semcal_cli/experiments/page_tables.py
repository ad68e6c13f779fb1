"""Tables of figures in pages of the documentation, each written by the command that measures it.

A page holds places: the line `<!-- table: NAME -->`, and below it the line `<!-- end of table -->`. What stands between
them is written anew: the tables, and below them the command, the machine, the date and the commit.
"""

from __future__ import annotations

import argparse
import io
import re
import shlex
import subprocess
import sys
from codecs import BOM_UTF8
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from datetime import date
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple, TextIO

from semcal_cli.errors import InputError, SemcalError
from semcal_cli.experiments.result_files import machine
from semcal_cli.files.reading import read_bytes, read_text
from semcal_cli.files.writing import check_replaceable, write_text

END = "<!-- end of table -->"
TABLE = re.compile(r"(?:^\|.*\n)+", re.MULTILINE)
ROOT = Path(__file__).parents[2]
"""The clone, if semcal is installed from one in place."""


class Place(NamedTuple):
    """A place of a page that a command writes its tables into."""

    page: Path
    name: str

    @property
    def start(self) -> str:
        """The line above the place."""
        return f"<!-- table: {self.name} -->"

    def write(self, printed: str, measured: Sequence[str]) -> None:
        """Write the tables of what a command printed; the rest of the page stays as it is.

        Args:
            printed: Text with Markdown tables, of which the other lines are left out.
            measured: Where and when, as `measured_here` tells it; several if a stopped run was resumed elsewhere.

        Raises:
            InputError: the page cannot be read or written, or has not exactly one such place, or nothing printed is a
                table.
        """
        before, after = self.split()
        tables = "\n".join(TABLE.findall(f"{printed}\n"))
        if not tables:
            raise InputError(f"{self.page}: found no table to write below {self.start!r}, needed one")
        line = f"Measured by `{command_line(sys.argv)}` on {'; on '.join(measured)}."
        write_text(f"{before}\n\n{tables}\n{line}\n\n{after}", self.page)

    def split(self) -> tuple[str, str]:
        """Read what stands before and after the content of the place, its two lines included.

        Raises:
            InputError: the page cannot be read, or has not exactly one such place.
        """
        content = read_bytes(self.page)
        if content.startswith(BOM_UTF8) or b"\r\n" in content:
            # They could not be kept, since what is written has neither.
            raise InputError(
                f"{self.page}: found line breaks or a byte order mark of Windows, needed neither"
            )
        text = read_text(self.page)
        starts = [found.end() for found in re.finditer(f"^{re.escape(self.start)}$", text, re.MULTILINE)]
        if len(starts) != 1:
            raise InputError(f"{self.page}: found {len(starts)} lines {self.start!r}, needed one")
        before, rest = text[: starts[0]], text[starts[0] :]
        end = re.search(f"^{re.escape(END)}$", rest, re.MULTILINE)
        if end is None or "<!-- table:" in rest[: end.start()]:
            raise InputError(f"{self.page}: found no line {END!r} below {self.start!r}, needed one")
        return before, rest[end.start() :]


def find_place(into: str, name: str) -> Place:
    """Find the place of `PAGE`, or of `PAGE#NAME` where it has another name than the command.

    Raises:
        InputError: the page cannot be read, its folder cannot be written to, or it has not exactly one such place.
    """
    page, _, other = into.rpartition("#")
    # Names of files and folders may have the sign, too: no name of a place has a point or a slash.
    place = Place(Path(page), other) if other.isidentifier() and page else Place(Path(into), name)
    place.split()
    check_replaceable(place.page)
    return place


def command_line(arguments: Sequence[str]) -> str:
    """Format a command as it was called, without `--into` and without the folders of this machine.

    Args:
        arguments: `sys.argv` of `semcal` or of a script of tests/benchmarks.
    """
    program, *words = arguments
    name = Path(program).name
    # Of a path from the root, or from above the working folder, only the last name means something elsewhere.
    words = [re.sub(r"(^|^-\w|=)(?:/|\.\./).*/", r"\1", word.rstrip("/")) for word in without_into(words)]
    return shlex.join(
        [*(["python", f"tests/benchmarks/{name}"] if name.endswith(".py") else ["semcal"]), *words]
    )


def without_into(words: Sequence[str]) -> list[str]:
    """Leave out `--into` and its page."""
    return _into_parser().parse_known_args(words)[1]


@cache
def measured_here() -> str:
    """Tell where and when this process measures: the machine, the date and the commit."""
    found = machine()
    cores = f"{found['cores']} core{'s' * (found['cores'] != 1)}"
    return f"{found['processor']}, {cores}, {_gpu()}, {date.today()}, {_commit()}"


def _gpu() -> str:
    files = sorted(Path("/proc/driver/nvidia/gpus").glob("*/information"))
    models = [re.search(r"^Model:\s*(.+)", file.read_text(), re.MULTILINE) for file in files]
    return " and ".join(model[1] for model in models if model) or "no NVIDIA GPU"


def _commit() -> str:
    """Name the commit of the clone, and whether its files, less its pages, have changes; else the version."""
    if not (ROOT / ".git").exists():
        return f"semcal {version('semcal')}"
    git = ["git", "-C", str(ROOT)]
    quietly = partial(subprocess.check_output, stderr=subprocess.DEVNULL, text=True)
    try:
        head = quietly([*git, "rev-parse", "--short", "HEAD"])
        changes = quietly([*git, "status", "--porcelain", "-uno", "--", ".", ":!*.md"])
    except (OSError, subprocess.CalledProcessError):
        return f"semcal {version('semcal')}"
    return f"commit {head.strip()}{' and changes' if changes else ''}"


def run_script(main: Callable[[], None]) -> None:
    """Run a script of tests/benchmarks, which gets the option `--into PAGE`.

    The tables that it prints are written into the place of the page that is named as the script, or `PAGE#NAME`.
    """
    parser = _into_parser()
    options, sys.argv[1:] = parser.parse_known_args()
    is_help = not {"-h", "--help"}.isdisjoint(sys.argv)
    if is_help:
        print(parser.format_help())
    try:
        if options.into is None or is_help:
            main()
            return
        place = find_place(options.into, Path(sys.argv[0]).stem)
        measured = measured_here()
        place.write(_printed(main), [measured])
    except SemcalError as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        sys.exit(130)


def _into_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(usage=argparse.SUPPRESS, add_help=False, allow_abbrev=False)
    parser.add_argument("--into", metavar="PAGE", help="also write the tables into their place of this page")
    return parser


class _Copy(io.StringIO):
    """A stream that keeps what it passes on."""

    def __init__(self, stream: TextIO) -> None:
        super().__init__()
        self.stream = stream

    def write(self, text: str) -> int:
        self.stream.write(text)
        return super().write(text)

    def flush(self) -> None:
        self.stream.flush()


def _printed(main: Callable[[], None]) -> str:
    """Run a function to its end, and return what it prints."""
    with redirect_stdout(_Copy(sys.stdout)) as copy:
        try:
            main()
        except SystemExit as end:  # click ends its commands by one
            if end.code:
                raise
        return copy.getvalue()
