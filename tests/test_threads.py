"""The threads that a process may use, in pools of Python."""

import multiprocessing
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from semcal_cli import threads
from semcal_cli.threads import num_cores, thread_pool


@pytest.mark.parametrize("num_threads", [1, 3, None])
def test_a_pool_has_as_many_threads_as_are_allowed(
    monkeypatch: pytest.MonkeyPatch, num_threads: int | None
) -> None:
    monkeypatch.setattr(threads, "_num_threads", num_threads)
    allowed = num_threads or num_cores()
    together = threading.Barrier(allowed)
    with thread_pool() as pool:
        # Each waits until as many run side by side; with fewer threads, none would go on.
        names = {*pool.map(lambda _: (together.wait(10.0), threading.get_ident())[1], range(3 * allowed))}
    assert len(names) == allowed


FORKED = """
import multiprocessing, sys
import semcal_cli as semcal

def refined(drive):
    return semcal.refine(drive, semcal.read_transform(drive)).T_camera_lidar.tobytes()

if __name__ == "__main__":
    here = refined(sys.argv[1])
    with multiprocessing.get_context(sys.argv[2]).Pool(2) as pool:
        assert pool.map_async(refined, [sys.argv[1]] * 2).get(60) == [here, here]
"""
"""Program that refines a drive, and again in two processes that it starts by a method of `multiprocessing`."""


@pytest.mark.parametrize("method", multiprocessing.get_all_start_methods())
def test_a_process_started_after_a_call_gives_the_same_result(
    method: str, street: Path, tmp_path: Path
) -> None:
    """A fork has a copy of the core's pool, but none of its threads: it would wait for them for ever."""
    script = tmp_path / "script.py"
    script.write_text(FORKED)
    subprocess.run([sys.executable, script, street, method], check=True, timeout=120)
