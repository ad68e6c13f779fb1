"""Coverage-guided fuzzing of the files and answers that semcal reads, by atheris (`pip install '.[dev]'`).

    python tests/fuzz/documents.py drive -max_total_time=600 /tmp/found tests/fuzz/corpus/drive

fuzzes one document with libFuzzer's options: what is new goes into the first folder, which must exist. A finding ends
the run, and its input is written. `-merge=1` adds what is new in the second folder to the first one.

    python tests/fuzz/documents.py --runs 3000

tries so many inputs for each of them, fewer of recordings, from the stored corpus. With PYTHONHASHSEED=0 they are the
same ones every time, however fast the machine is. `--seed 2` tries others.
"""

from __future__ import annotations

import argparse
import io
import multiprocessing
import os
import shutil
import sys
import tempfile
from collections.abc import Sequence
from contextlib import redirect_stderr
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

try:
    import atheris
except ImportError:
    sys.exit("atheris is missing: pip install '.[dev]' has it on Linux with x86-64 and Python 3.10 to 3.14")

sys.path.insert(0, str(Path(__file__).parents[1]))
# Which modules are instrumented is nobody's concern.
with redirect_stderr(io.StringIO()), atheris.instrument_imports(["semcal_cli"], enable_loader_override=False):
    from targets import TARGETS, check
from mutation import mutate

CORPUS = Path(__file__).parent / "corpus"
LIMITS = ("-timeout=20", "-rss_limit_mb=2048")
"""Of one input: seconds, and megabytes of memory."""
SHOWN_LINES = 60
"""Last lines of the log of a finding, which are shown."""


def fuzz(name: str, options: Sequence[str], folder: Path, log: Path | None = None) -> None:
    """Fuzz a document, which is written into a folder, until the time is over or something is found; never return."""
    if log is not None:
        output = os.open(log, os.O_CREAT | os.O_WRONLY)
        os.dup2(output, sys.stdout.fileno())
        os.dup2(output, sys.stderr.fileno())
    folder.mkdir()
    target = TARGETS[name]
    target.prepare(folder)
    atheris.Setup(
        [sys.argv[0], *LIMITS, f"-max_len={target.max_bytes}", *options],
        lambda content: check(target, content, folder),
        custom_mutator=lambda data, size, seed: mutate(data, size, seed, atheris.Mutate),
    )
    atheris.Fuzz()


def fuzz_apart(*arguments: Any) -> BaseProcess:
    """Fuzz a document as `fuzz` does, in a process of its own that takes over what is instrumented."""
    process = multiprocessing.get_context("fork").Process(target=fuzz, args=arguments)
    process.start()
    return process


def fuzz_all(runs: int, seed: int, memory: Path) -> bool:
    """Try some inputs for each document, on all cores; tell whether nothing was found."""
    num_jobs, names = os.cpu_count() or 1, list(TARGETS)
    good = True
    for first in range(0, len(names), num_jobs):
        running = {}
        for name in names[first : first + num_jobs]:
            new, found = memory / f"{name}-new", Path(tempfile.gettempdir()) / f"fuzz-{name}-"
            new.mkdir()
            runs_of_it = round(TARGETS[name].share * runs)
            options = [f"-seed={seed}", f"-runs={runs_of_it}", f"-artifact_prefix={found}", str(new)]
            options.append(str(CORPUS / name))
            running[name] = fuzz_apart(name, options, memory / name, memory / f"{name}.log")
        for name, process in running.items():
            process.join()
            good &= process.exitcode == 0
            tell(name, process.exitcode == 0, (memory / f"{name}.log").read_text(errors="replace"))
    return good


def tell(name: str, is_good: bool, log: str) -> None:
    """Describe how many documents were tried, or what was found."""
    lines = log.splitlines()
    if is_good:
        print(f"{name}:", *(line for line in lines if line.startswith("Done")), flush=True)
        return
    # libFuzzer's lines of its progress begin with a number sign.
    shown = [line for line in lines if not line.startswith("#")]
    print(f"{name}:", *shown[-SHOWN_LINES:], sep="\n  ", flush=True)


def main(arguments: Sequence[str]) -> int:
    """Run the program; return its exit code."""
    shared = Path("/dev/shm")
    memory = Path(tempfile.mkdtemp(prefix="semcal-fuzz-", dir=shared if shared.is_dir() else None))
    try:
        if "--runs" in arguments:
            parser = argparse.ArgumentParser()
            parser.add_argument("--runs", type=int)
            parser.add_argument("--seed", type=int, default=1)
            said = parser.parse_args(arguments)
            return 0 if fuzz_all(said.runs, said.seed, memory) else 1
        name, *options = arguments
        process = fuzz_apart(name, options, memory / name)
        process.join()
        return process.exitcode or 0
    finally:
        shutil.rmtree(memory)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
