"""The threads that a process may use, in pools of Python."""

import threading

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
