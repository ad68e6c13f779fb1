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

MAX_CPU_S = 60
"""Most processor time that a command takes: unlike wall time, it does not depend on what else the machine does."""
MAX_WALL_S = 600.0
"""Wall time after which a command that hangs is killed."""
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
taken, max_bytes, max_cpu_s, *command = sys.argv[1:]
process = os.fork()
if process == 0:
    for limit, most in ((resource.RLIMIT_AS, int(max_bytes)), (resource.RLIMIT_CPU, int(max_cpu_s))):
        resource.setrlimit(limit, (most, most))
    os.execv(command[0], command)
_, status, usage = os.wait4(process, 0)
with open(taken, "w") as file:
    file.write(f"{usage.ru_maxrss << 10} {usage.ru_utime + usage.ru_stime}")
code = os.waitstatus_to_exitcode(status)
sys.exit(code if code >= 0 else 128 - code)
"""
"""Program that runs a command, and writes its peak memory in bytes and its processor time in seconds. A process counts
the memory that its parent had before `exec`, so the tests' own process cannot run the command."""


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
    kept: tuple[str, ...] = ()
    """Files that must stay as they were."""
    check: Callable[[Path], object] = lambda folder: None
    """Asserts what else must hold afterwards."""


@dataclass(frozen=True)
class Answer:
    """What a command answered, and what it took."""

    exit_code: int
    stdout: str
    stderr: str
    max_bytes: int
    """Largest resident memory of the command's process and its children."""
    cpu_s: float
    """Processor time of the command's process and its children."""

    @property
    def line(self) -> str:
        """Last line on standard error."""
        return (self.stderr.strip().splitlines() or [""])[-1]


def run_guarded(
    arguments: tuple[str, ...],
    folder: Path,
    stdin: bytes = b"",
    said_before: bytes = b"",
    source: Path | None = None,
) -> Answer:
    """Run semcal in a folder with limits of time and memory; `source` is a checkout of another version."""
    given, out, err, taken = (folder / f".{name}" for name in ("stdin", "stdout", "stderr", "taken"))
    limits = (str(GUARD_BYTES), str(MAX_CPU_S))
    given.write_bytes(stdin)
    with given.open("rb") as read, out.open("wb") as said, err.open("wb") as complained:
        said.write(said_before)
        said.flush()
        process = subprocess.Popen(
            [sys.executable, "-c", LAUNCHER, str(taken), *limits, *SEMCAL, *arguments],
            cwd=folder,
            stdin=read,
            stdout=said,
            stderr=complained,
            env={**os.environ, **ENVIRONMENT, **({} if source is None else {"PYTHONPATH": str(source)})},
            start_new_session=True,
        )
        try:
            code = process.wait(MAX_WALL_S)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    texts = (path.read_bytes().decode(errors="replace") for path in (out, err))
    max_bytes, cpu_s = taken.read_text().split()
    return Answer(code, *texts, int(max_bytes), float(cpu_s))


def check(case: Hostile, folder: Path) -> None:
    """Run a case, and check its answer."""
    case.make(folder)
    before = {name: (folder / name).read_bytes() for name in case.kept}
    answer = run_guarded(case.command, folder, case.stdin, case.said_before)
    assert answer.exit_code == case.exit_code, answer
    assert "Traceback" not in answer.stderr, answer.stderr
    assert re.search(case.line, answer.line), answer.stderr
    assert answer.max_bytes <= MAX_BYTES, f"{answer.max_bytes / 2**30:.2f} GiB"
    assert answer.cpu_s <= MAX_CPU_S, f"{answer.cpu_s:.1f} s"
    assert {name: (folder / name).read_bytes() for name in case.kept} == before
    case.check(folder)
