"""The `semcal` command: one module per subcommand, and the one place that turns errors into exit codes.

A subcommand is imported when it is called, and imports nothing heavy at the top of its module, so `--help` is fast.
"""

from __future__ import annotations

import gc
import os
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from keyword import iskeyword
from typing import Any, NamedTuple

import click

from semcal_cli.cli.ci import annotate
from semcal_cli.cli.removed import explained
from semcal_cli.config import MAX_PIXELS
from semcal_cli.errors import InputError, SemcalError, printable
from semcal_cli.plugins import PluginWarning
from semcal_cli.readable import for_people

EXIT_FAILURE, EXIT_STOPPED = 1, 130
ARENA_MAX = -8
"""Parameter of glibc's `mallopt`: the number of memory arenas, by default eight per core."""


PYTHONS_FORMAT = warnings.formatwarning
"""How Python writes a warning."""

SECTIONS: dict[str, dict[str, str]] = {
    "Start": {
        "demo": "Calibrate a synthetic street, and show the result.",
        "import": "Make a drive from a recording, a data set or your own files.",
        "label": "Label images or sweeps with a network.",
        "inspect": "Show what a drive contains, and what looks wrong with it.",
        "accumulate": "Make dense clouds of the sweeps of a sparse LiDAR.",
        "merge": "Make one drive of several drives of one rig.",
        "odometry": "Estimate the LiDAR's motion from the sweeps of a drive.",
        "synth": "Write a synthetic drive with a known transform.",
        "doctor": "Show what is installed, what is missing, and what needs it.",
        "completion": "Print shell completion for bash, zsh or fish.",
    },
    "Calibrate": {
        "calibrate": "Find the transform of a recording or drive, and its uncertainty.",
        "initialize": "Search all mounting directions, without refinement.",
        "refine": "Refine a transform that is roughly known.",
    },
    "Check": {
        "verify": "Check whether a transform still holds on a drive.",
        "compare": "Compare two transforms with each other.",
        "report": "Write a report about a transform, as one HTML page.",
        "overlay": "Draw the points of a drive on its images.",
        "view": "Adjust a transform by hand in the browser.",
    },
    "Export": {
        "base": "Estimate the pose of the LiDAR on its vehicle, for base_link.",
        "convert": "Convert a transform to the format of another tool.",
        "export": "Export a drive or a rig to viewers and other programs.",
    },
    "Many drives": {
        "batch": "Calibrate or verify many drives.",
        "fleet": "Combine the results of many drives of one rig.",
        "audit": "Check the calibrations that a data set delivers, on one page.",
    },
    "Research": {
        "experiment": "Compare semcal with other methods.",
    },
}
"""One-line help of each command, by section. Each command has a module of the same name."""


class Sections(click.Group):
    """A group that lists its commands in sections, and imports each one when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """List the names of all commands."""
        return [name for section in SECTIONS.values() for name in section]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command; return None if there is none with this name."""
        if cmd_name in self.list_commands(ctx):
            self._load(cmd_name)
        else:  # click suggests a similar name, for which it needs all
            self.load_all()
        return self.commands.get(cmd_name)

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; the error about what was removed says what to use instead."""
        with explained():
            return super().invoke(ctx)

    def load_all(self) -> None:
        """Import all commands."""
        for name in self.list_commands(click.Context(self)):
            self._load(name)

    def _load(self, command: str) -> None:
        if command not in self.commands:
            name = f"{command}_" if iskeyword(command) else command
            self.add_command(getattr(import_module(f"semcal_cli.cli.{name}"), name))

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the sections."""
        width = max(len(name) for section in SECTIONS.values() for name in section)
        for heading, section in SECTIONS.items():
            with formatter.section(heading):
                formatter.write_dl([(f"{name:<{width}}", line) for name, line in section.items()])


@click.group(cls=Sections, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="semcal")
def semcal() -> None:
    """Find where a camera sits relative to a LiDAR, from ordinary driving data."""


class Ending(NamedTuple):
    """How a command ended."""

    exit_code: int
    line: str = ""
    """Message of an expected failure; otherwise empty."""
    failure: Exception | None = None
    """The expected failure."""


def main() -> None:
    """Run the command line."""
    exit_code = run(sys.argv[1:]).exit_code
    # The operating system frees what is left: Python need not search it for garbage first.
    gc.freeze()
    sys.exit(exit_code)


def run(arguments: Sequence[str]) -> Ending:
    """Run a command; an expected failure is one line on stderr and exit code 1."""
    # OpenCV reads these when it is imported: they limit the size of a decoded image, and silence its own messages.
    os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(MAX_PIXELS))
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    # NumPy and SciPy each start a thread pool for matrices; ours are small, and idle threads slow the core down.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Matplotlib would look for a display, and import what draws on it.
    os.environ.setdefault("MPLBACKEND", "agg")
    _limit_arenas()
    # NumPy need not warn about overflow: results are checked.
    warnings.simplefilter("ignore", RuntimeWarning)
    warnings.formatwarning = _formatted
    try:
        for argument in arguments:
            _check_text(argument)
        return _invoke(arguments)
    except SemcalError as error:
        failure: Exception = error
        line = str(error)
    except BrokenPipeError:
        _silence_closed_pipe()
        return Ending(EXIT_FAILURE, "the output was closed early")
    except KeyboardInterrupt:
        return _stopped(EXIT_STOPPED)
    except ImportError as error:  # an installed library is incomplete
        if _is_interrupted(error):
            return _stopped(EXIT_STOPPED)
        failure = error
        line = f"{error.name or 'a library'}: cannot be imported: {' '.join(str(error).split())}"
    except OSError as error:
        failure = error
        line = f"{error.filename or 'standard output'}: {(error.strerror or str(error)).lower()}"
    _tell(line)
    annotate(arguments[0] if arguments else "", "error", line)
    return Ending(EXIT_FAILURE, line, failure)


def _tell(line: str) -> None:
    """Print an error, as all of them are printed."""
    click.echo(f"semcal: error: {for_people(line)}", err=True)


def _formatted(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
) -> str:
    """Format a plugin's warning as one line for users, and any other warning as Python does."""
    if isinstance(message, PluginWarning):
        return f"semcal: warning: {printable(str(message))}\n"
    return PYTHONS_FORMAT(message, category, filename, lineno, line)


def _limit_arenas() -> None:
    """Let threads share memory arenas, one per core.

    Each thread keeps freed memory in its own arena: a quarter of the peak when one pair is calibrated. The environment
    variable takes precedence.
    """
    if "MALLOC_ARENA_MAX" in os.environ:
        return
    import ctypes

    # Other C libraries have no `mallopt`; on Windows, `CDLL(None)` fails.
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).mallopt(ARENA_MAX, os.cpu_count() or 1)


def _invoke(arguments: Sequence[str]) -> Ending:
    """Invoke the command; wrong usage is one line as well, after which stands how to get help."""
    try:
        return Ending(int(semcal.main(arguments, prog_name="semcal", standalone_mode=False) or 0))
    except SystemExit as end:
        return Ending(int(end.code or 0))
    except click.ClickException as error:
        line = " ".join(error.format_message().split())
        if isinstance(error, click.exceptions.NoArgsIsHelpError):  # a group without a command: its help
            error.show()
            return Ending(error.exit_code, line, error)
        _tell(line)
        if isinstance(error, click.UsageError) and error.ctx is not None:
            click.echo(f"Try '{error.ctx.command_path} --help' for help.", err=True)
        return Ending(error.exit_code, line, error)
    except click.Abort as stop:
        # click raises this for Ctrl-C, which shells report as 128 plus the number of the signal.
        return _stopped(EXIT_STOPPED if _is_interrupted(stop) else EXIT_FAILURE)


def _stopped(exit_code: int) -> Ending:
    click.echo("stopped", err=True)
    return Ending(exit_code, "stopped")


def _is_interrupted(error: BaseException | None) -> bool:
    """Whether Ctrl-C caused an error: a library that is being imported may raise its own instead."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _silence_closed_pipe() -> None:
    """Discard what is still to be flushed at exit: the reader of the output is gone."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):
            stream.flush()
            continue
        with suppress(OSError, ValueError, AttributeError):
            os.dup2(nowhere, stream.fileno())


def _check_text(argument: str) -> None:
    """Refuse names that YAML, JSON or HTML cannot represent."""
    try:
        argument.encode()
    except UnicodeEncodeError:
        text = argument.encode(errors="backslashreplace").decode()
        raise InputError(f"{text}: found bytes that are not UTF-8, expected text") from None
