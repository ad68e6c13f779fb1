"""Failures of the machine are told from those of the drive, wherever they are met."""

import errno
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import sleep

import pytest
from batches import TINY, run, summary

from semcal_cli import core
from semcal_cli.errors import InputError
from semcal_cli.many.batch.processes import ProcessError, Worker
from semcal_cli.many.batch.run import is_of_machine
from semcal_cli.synthetic.synthesis import synthesize

UNREADABLE = Path("/proc/self/mem")
"""A regular file whose first byte the system refuses with EIO, as it does those on a broken disk."""
NEEDS_PROC = pytest.mark.skipif(not UNREADABLE.is_file(), reason="needs Linux's /proc")


@contextmanager
def no_descriptors() -> Iterator[None]:
    """Allow no more open files than there are."""
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    lowest = os.open(os.devnull, os.O_RDONLY)
    os.close(lowest)
    resource.setrlimit(resource.RLIMIT_NOFILE, (lowest, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)


def test_the_core_keeps_the_number_of_the_systems_error(tmp_path: Path) -> None:
    sweep = tmp_path / "a.bin"
    sweep.write_bytes(bytes(16))
    with pytest.raises(InputError, match=r"^/.*/a.bin: Too many open files") as error, no_descriptors():
        core.read_point_clouds([(sweep, None)], 10)
    cause = error.value.__cause__
    assert isinstance(cause, OSError)
    assert (cause.errno, cause.filename) == (errno.EMFILE, str(sweep))
    assert is_of_machine(error.value, tmp_path / "out")


@NEEDS_PROC
@pytest.mark.parametrize("suffix", ["png", "npy"])
def test_what_a_parser_makes_of_a_broken_disk_does_not_hide_it(suffix: str, tmp_path: Path) -> None:
    labels = tmp_path / f"a.{suffix}"
    labels.symlink_to(UNREADABLE)
    with pytest.raises(InputError, match=r"^/.*/a\.\w+: Input/output error \(os error 5\)$") as error:
        core.read_label_images([labels], 4, 3, None)
    assert is_of_machine(error.value, tmp_path / "out")


def test_what_is_wrong_with_a_file_is_not_the_machines_fault(tmp_path: Path) -> None:
    for name, content in (("a.bin", bytes(15)), ("b.npz", b"PK"), ("c.pcd", b"")):
        (tmp_path / name).write_bytes(content)
    for name in ("a.bin", "b.npz", "c.pcd", "missing.bin", "d.txt"):
        with pytest.raises(InputError) as error:
            core.read_point_clouds([(tmp_path / name, None)], 10)
        assert error.value.__cause__ is None
        assert not is_of_machine(error.value, tmp_path / "out")


@NEEDS_PROC
def test_a_drive_on_a_broken_disk_has_no_outcome(tmp_path: Path) -> None:
    synthesize(TINY, tmp_path / "drive")
    (labels,) = (tmp_path / "drive").glob("image_labels/*")
    kept = labels.rename(tmp_path / "kept.png")
    labels.symlink_to(UNREADABLE)
    out = tmp_path / "out"
    assert run(["batch", str(tmp_path / "drive"), "-o", str(out)]).exit_code == 1
    assert summary(out)[0]["reasons"] == [f"{labels}: Input/output error (os error 5)"]
    assert not list(out.rglob("record.json"))
    labels.unlink()
    labels.write_bytes(kept.read_bytes()[:50])
    assert run(["batch", str(tmp_path / "drive"), "-o", str(out)]).exit_code == 1
    assert list(out.rglob("record.json"))


def end_by(name: str) -> None:
    """End this process by a signal, without a core file."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.kill(os.getpid(), getattr(signal, name))


@pytest.fixture(scope="module")
def one_worker() -> Iterator[Worker]:
    worker = Worker()
    yield worker
    worker.stop()
    worker.close()


@pytest.mark.parametrize(
    ("name", "is_from_outside"),
    [
        *((name, True) for name in ("SIGKILL", "SIGTERM", "SIGBUS", "SIGABRT", "SIGXCPU")),
        *((name, False) for name in ("SIGSEGV", "SIGFPE", "SIGILL", "SIGSYS")),
    ],
)
def test_signals_of_the_machine(name: str, is_from_outside: bool, one_worker: Worker) -> None:
    """Memory that runs out ends a process by SIGKILL, or by the SIGABRT of a failed allocation."""
    with pytest.raises(ProcessError, match=f"^the process was killed by {name}\\b") as error:
        one_worker.ask(end_by, name)
    assert error.value.is_from_outside == is_from_outside
    assert not error.value.is_timed_out


@NEEDS_PROC
def test_a_process_that_is_killed_leaves_no_temporary_file(tmp_path: Path) -> None:
    """It writes three megabytes over and over, into files without a name.

    A file has a temporary name only between its last two calls, in which one of ten processes may be met.
    """
    loop = (
        "import sys; from pathlib import Path; from semcal_cli.files.output_files import write_bytes\n"
        "print(flush=True)\n"
        "while True: write_bytes(bytes(3_000_000), Path(sys.argv[1]))"
    )
    for delay_ms in range(0, 40, 4):
        command = [sys.executable, "-c", loop, tmp_path / "a.bin"]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            process.stdout.readline()
            sleep(delay_ms / 1000.0)
            process.kill()
    assert len(list(tmp_path.glob(".*"))) <= 1
