"""Hostile cases of the real command: what is made, what is run, and the line that answers.

Each table of cases stands in a file of its own, by what is attacked; `test_hostile_commands.py` runs them all.
"""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

MAX_SECONDS = 60.0
"""Longest time until something is refused."""
MAX_BYTES = 2 << 30
"""Largest resident memory of any process of a command that refuses something."""
GUARD_BYTES = 8 << 30
"""Address space of a process of a case: what asks for more fails, and the machine stays whole."""
ENVIRONMENT = {"GITHUB_ACTIONS": "", "MALLOC_ARENA_MAX": "2", "RAYON_NUM_THREADS": "2"}
"""No annotations for GitHub, and an address space that does not grow with the cores."""
SEMCAL = (sys.executable, "-c", "from semcal_cli.cli import main; main()")
"""The command, run where the sources do not shadow the installed package."""
LAUNCHER = """
import os, resource, sys
peak, guard, *command = sys.argv[1:]
process = os.fork()
if process == 0:
    resource.setrlimit(resource.RLIMIT_AS, (int(guard), int(guard)))
    os.execv(command[0], command)
_, status, usage = os.wait4(process, 0)
with open(peak, "w") as file:
    file.write(str(usage.ru_maxrss))
code = os.waitstatus_to_exitcode(status)
sys.exit(code if code >= 0 else 128 - code)
"""
"""Program that runs a command and writes its peak memory in KiB. A process counts what its parent had before `exec`, so
the tests' own process cannot run the command."""


@dataclass(frozen=True)
class Hostile:
    """A case: its files, its command and its answer."""

    make: Callable[[Path], object]
    """Makes the files of the case in a folder that holds the small whole drives `drive` and `other`."""
    command: tuple[str, ...]
    """Arguments of semcal, which runs in that folder."""
    line: str
    """Pattern of the last line on standard error."""
    exit_code: int = 1
    stdin: bytes = b""
    """Content of standard input."""
    said_before: bytes = b""
    """What the shell has written to the file `.stdout`, the command's standard output, before."""
    check: Callable[[Path], object] = lambda folder: None
    """Asserts what must hold afterwards: files that stay as they were."""


@dataclass(frozen=True)
class Answer:
    """What a command answered, and what it took."""

    exit_code: int
    stdout: str
    stderr: str
    max_bytes: int
    """Largest resident memory of the command's process and its children."""

    @property
    def line(self) -> str:
        """Last line on standard error."""
        return (self.stderr.strip().splitlines() or [""])[-1]


def run_guarded(
    arguments: tuple[str, ...], folder: Path, stdin: bytes = b"", said_before: bytes = b""
) -> Answer:
    """Run semcal in a folder with limits of time and memory."""
    given, out, err, peak = (folder / f".{name}" for name in ("stdin", "stdout", "stderr", "peak"))
    given.write_bytes(stdin)
    with given.open("rb") as read, out.open("wb") as said, err.open("wb") as complained:
        said.write(said_before)
        said.flush()
        process = subprocess.Popen(
            [sys.executable, "-c", LAUNCHER, str(peak), str(GUARD_BYTES), *SEMCAL, *arguments],
            cwd=folder,
            stdin=read,
            stdout=said,
            stderr=complained,
            env={**os.environ, **ENVIRONMENT},
            start_new_session=True,
        )
        try:
            code = process.wait(MAX_SECONDS)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    texts = (path.read_bytes().decode(errors="replace") for path in (out, err))
    return Answer(code, *texts, max_bytes=int(peak.read_text()) << 10)


def check(case: Hostile, folder: Path) -> None:
    """Run a case, and check its answer."""
    case.make(folder)
    answer = run_guarded(case.command, folder, case.stdin, case.said_before)
    assert answer.exit_code == case.exit_code, answer
    assert "Traceback" not in answer.stderr, answer.stderr
    assert re.search(case.line, answer.line), answer.stderr
    assert answer.max_bytes <= MAX_BYTES, f"{answer.max_bytes / 2**30:.2f} GiB"
    case.check(folder)
