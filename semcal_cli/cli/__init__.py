"""The `semcal` command: one file a subcommand, and the one place that turns errors into exit codes.

A subcommand is imported when it is called, and nothing heavy at the top of its file, so that help answers at once.
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
from typing import NamedTuple

import click

from semcal_cli.cli.ci import annotate
from semcal_cli.config import MAX_PIXELS
from semcal_cli.errors import InputError, SemcalError, printable
from semcal_cli.plugins import PluginWarning

EXIT_FAILURE, EXIT_STOPPED = 1, 130
GARBAGE_AFTER = 50_000
"""Number of new objects after which Python looks for garbage, instead of 700."""
ARENA_MAX = -8
"""Parameter of glibc's `mallopt`: the number of arenas that threads get memory from, eight for each core by default."""


PYTHONS_FORMAT = warnings.formatwarning
"""How Python writes a warning."""

SECTIONS: dict[str, dict[str, str]] = {
    "Start": {
        "demo": "Calibrate a synthetic street from nothing, and look at it.",
        "import": "Make a drive of a recording, a data set or your own files.",
        "label": "Label images or sweeps with a network.",
        "inspect": "Show what a drive holds, and what looks wrong with it.",
        "odometry": "Estimate how the LiDAR moves from the sweeps of a drive.",
        "synth": "Write a synthetic drive whose transform is known.",
        "completion": "Print what completes commands in bash, zsh or fish.",
    },
    "Calibrate": {
        "calibrate": "Find the transform from nothing, and how sure it is.",
        "initialize": "Only search all mounting directions.",
        "refine": "Only refine a transform that is known roughly.",
    },
    "Check": {
        "verify": "Check on a drive whether a transform still holds.",
        "compare": "Tell how two transforms differ, beside what is allowed.",
        "report": "Write a page about a transform, to send around.",
        "overlay": "Draw the points on the images.",
        "view": "Move the points on the images by hand, and save.",
    },
    "Export": {
        "convert": "Write a transform in the format of another tool.",
        "export": "Write a drive for a viewer.",
    },
    "Many drives": {
        "batch": "Calibrate or verify many drives.",
        "fleet": "Put the results of many drives of one rig together.",
    },
    "Research": {
        "experiment": "Measure the figures of the documentation.",
    },
}
"""Line of help of each command that is not hidden, by the headings of the sections. Each has a module of its name."""
HIDDEN = ("evaluate",)


class Sections(click.Group):
    """A group that lists its commands in sections, and imports one when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """List the names of all commands."""
        return [*(name for section in SECTIONS.values() for name in section), *HIDDEN]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command; None if there is none of this name."""
        if cmd_name in self.list_commands(ctx):
            self._load(cmd_name)
        else:  # click looks among all for one that is meant
            self.load_all()
        return self.commands.get(cmd_name)

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
    """Find where a camera sits relative to a LiDAR, from semantic labels of ordinary driving data."""


class Ending(NamedTuple):
    """How a command ended."""

    exit_code: int
    line: str = ""
    """Message of an expected failure; otherwise empty."""
    failure: Exception | None = None
    """The expected failure."""


def main() -> None:
    """Run the command line."""
    # Imports make many objects and no garbage.
    gc.set_threshold(GARBAGE_AFTER)
    exit_code = run(sys.argv[1:]).exit_code
    # The system takes back what is left: Python need not look through all of it for garbage before it ends.
    gc.freeze()
    sys.exit(exit_code)


def run(arguments: Sequence[str]) -> Ending:
    """Run a command; an expected failure is one line on stderr and exit code 1."""
    # OpenCV reads these when it is imported: they limit the size of an unpacked image, and leave error messages to us.
    os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(MAX_PIXELS))
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    # NumPy and SciPy each start a thread pool for matrices; none here is large, and idle threads slow the core down.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _limit_arenas()
    # NumPy need not warn of overflowing numbers: their results are checked.
    warnings.simplefilter("ignore", RuntimeWarning)
    warnings.formatwarning = _formatted
    try:
        for argument in arguments:
            _check_text(argument)
        return _invoke(arguments)
    except SemcalError as error:
        failure: Exception = error
        # The message is one line, even if a file's name contains a line break.
        line = " ".join(str(error).splitlines())
    except BrokenPipeError:
        _silence_closed_pipe()
        return Ending(EXIT_FAILURE, "the output was closed before its end")
    except KeyboardInterrupt:
        return _stopped(EXIT_STOPPED)
    except ImportError as error:  # of a library that is there, but not whole
        if _is_interrupted(error):
            return _stopped(EXIT_STOPPED)
        failure = error
        line = f"{error.name or 'a library'}: cannot be imported: {' '.join(str(error).split())}"
    except OSError as error:
        failure = error
        line = f"{error.filename or 'standard output'}: {(error.strerror or str(error)).lower()}"
    click.echo(f"semcal: error: {line}", err=True)
    annotate(arguments[0] if arguments else "", "error", line)
    return Ending(EXIT_FAILURE, line, failure)


def _formatted(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
) -> str:
    """Write a warning of a plugin as a line for users, and any other as Python does."""
    if isinstance(message, PluginWarning):
        return f"semcal: warning: {printable(str(message))}\n"
    return PYTHONS_FORMAT(message, category, filename, lineno, line)


def _limit_arenas() -> None:
    """Let threads share arenas of memory, one for each core.

    Each thread keeps what it has freed in its own: of a calibration of one pair, that is a quarter of the peak. What
    the environment says counts more.
    """
    if "MALLOC_ARENA_MAX" in os.environ:
        return
    import ctypes

    # Other C libraries have no such thing; Windows cannot even be asked.
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).mallopt(ARENA_MAX, os.cpu_count() or 1)


def _invoke(arguments: Sequence[str]) -> Ending:
    """Invoke the command, and show a wrong usage as click does."""
    try:
        return Ending(int(semcal.main(arguments, prog_name="semcal", standalone_mode=False) or 0))
    except SystemExit as end:
        return Ending(int(end.code or 0))
    except click.ClickException as error:
        error.show()
        return Ending(error.exit_code, " ".join(error.format_message().split()), error)
    except click.Abort as stop:
        # click makes this of Ctrl-C, which shells tell by 128 and the number of its signal.
        return _stopped(EXIT_STOPPED if _is_interrupted(stop) else EXIT_FAILURE)


def _stopped(exit_code: int) -> Ending:
    click.echo("stopped", err=True)
    return Ending(exit_code, "stopped")


def _is_interrupted(error: BaseException | None) -> bool:
    """Whether Ctrl-C led to an error: a library that is being loaded makes errors of its own of it."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _silence_closed_pipe() -> None:
    """Let what is still to be flushed at the end go nowhere: who read the output has gone."""
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
        found = argument.encode(errors="backslashreplace").decode()
        raise InputError(f"{found}: found bytes that are not UTF-8, needed text") from None
