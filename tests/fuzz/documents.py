"""Coverage-guided fuzzing of the documents that semcal reads, by atheris (`pip install '.[dev]'`).

    python tests/fuzz/documents.py drive -max_total_time=600 /tmp/found tests/fuzz/corpus/drive

fuzzes one document with libFuzzer's options: what is new goes into the first folder, which must exist. A finding ends
the run, and its input is written. `-merge=1` adds what is new in the second folder to the first one.

    python tests/fuzz/documents.py --seconds 60

fuzzes all of them for a minute in total, from the stored corpus and always with the same seed.
"""

from __future__ import annotations

import io
import os
import shutil
import sys
import tempfile
import traceback
from collections.abc import Sequence
from contextlib import redirect_stderr
from pathlib import Path

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
LIMITS = ("-timeout=20", "-rss_limit_mb=2048", "-max_len=4096")
"""Of one input: seconds, and megabytes of memory; short documents say all that long ones do."""
SHOWN_LINES = 60
"""Last lines of the log of a finding, which are shown."""


def fuzz(name: str, options: Sequence[str], folder: Path) -> None:
    """Fuzz a document, which is written into a folder, until the time is over or something is found; never return."""
    target = TARGETS[name]
    target.prepare(folder)
    atheris.Setup(
        [sys.argv[0], *LIMITS, *options],
        lambda content: check(target, content, folder),
        custom_mutator=lambda data, size, seed: mutate(data, size, seed, atheris.Mutate),
    )
    atheris.Fuzz()


def fuzz_apart(name: str, options: Sequence[str], folder: Path, log: Path | None = None) -> int:
    """Fuzz a document in a process of its own, whose output goes to a log if one is given; return its id."""
    process = os.fork()
    if process != 0:
        return process
    code = 1
    try:
        if log is not None:
            output = os.open(log, os.O_CREAT | os.O_WRONLY)
            os.dup2(output, sys.stdout.fileno())
            os.dup2(output, sys.stderr.fileno())
        folder.mkdir()
        fuzz(name, options, folder)
    except SystemExit as end:
        code = int(end.code or 0)
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


def fuzz_all(seconds: float, memory: Path) -> bool:
    """Fuzz all documents on all cores for a time in total; tell whether nothing was found."""
    num_jobs = os.cpu_count() or 1
    # libFuzzer ends up to a second later.
    share = min(max(int(seconds * num_jobs / len(TARGETS)), 1), int(seconds))
    waiting, running, good = list(TARGETS), {}, True
    while waiting or running:
        while waiting and len(running) < num_jobs:
            name = waiting.pop(0)
            new, found = memory / f"{name}-new", Path(tempfile.gettempdir()) / f"fuzz-{name}-"
            new.mkdir()
            options = ["-seed=1", f"-max_total_time={share}", f"-artifact_prefix={found}", str(new)]
            log = memory / f"{name}.log"
            process = fuzz_apart(name, [*options, str(CORPUS / name)], memory / name, log)
            running[process] = name, log
        process, status = os.wait()
        name, log = running.pop(process)
        good &= status == 0
        lines = log.read_text(errors="replace").splitlines()
        if status == 0:
            print(f"{name}:", *(line for line in lines if line.startswith("Done")), flush=True)
        else:
            # libFuzzer's lines of its progress begin with a number sign.
            shown = [line for line in lines if not line.startswith("#")]
            print(f"{name}:", *shown[-SHOWN_LINES:], sep="\n  ", flush=True)
    return good


def main(arguments: Sequence[str]) -> int:
    """Run the program; return its exit code."""
    shared = Path("/dev/shm")
    memory = Path(tempfile.mkdtemp(prefix="semcal-fuzz-", dir=shared if shared.is_dir() else None))
    try:
        if arguments[:1] == ["--seconds"]:
            return 0 if fuzz_all(float(arguments[1]), memory) else 1
        name, *options = arguments
        fuzz_apart(name, options, memory / name)
        return os.waitstatus_to_exitcode(os.wait()[1])
    finally:
        shutil.rmtree(memory)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
