"""Progress of a run over many items: which are running, since when, and how long the rest may take."""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock
from time import monotonic


class Pace:
    """Keeps track of the items that begin and end, and of those done before a run; its methods are thread-safe."""

    def __init__(self, num_items: int, num_jobs: int, clock: Callable[[], float] = monotonic) -> None:
        """Start the clock.

        Args:
            num_items: Number of all items.
            num_jobs: Number of items that run at a time.
            clock: Returns seconds since an arbitrary moment.
        """
        self.num_items = self.num_left = num_items
        self._num_jobs, self._clock, self._started = num_jobs, clock, clock()
        self._begun: dict[str, float] = {}
        self._num_ended, self._durations_s = 0, list[float]()
        self._lock = Lock()

    @property
    def num_done(self) -> int:
        """Number of items that were done in this run or before."""
        return self.num_items - self.num_left

    def resume(self, num_done: int, num_items: int) -> None:
        """Begin a run some of whose items are already done; these do not count for the estimate of the time left."""
        self.num_items, self.num_left = num_items, num_items - num_done

    def skip(self) -> None:
        """Count an item that was done before the run."""
        self.num_left -= 1

    def begin(self, name: str) -> None:
        """Note that an item begins."""
        with self._lock:
            self._begun[name] = self._clock()

    def end(self, name: str) -> None:
        """Note that an item is done. The beginning of items that run on a cluster is not known."""
        with self._lock:
            start = self._begun.pop(name, None)
            if start is not None:
                self._durations_s.append(self._clock() - start)
            self._num_ended += 1
            self.num_left -= 1

    def running(self) -> list[tuple[str, float]]:
        """List the names of the running items, each with the seconds since it began, oldest first."""
        with self._lock:
            now = self._clock()
            return [(name, now - start) for name, start in self._begun.items()]

    def left_s(self) -> float | None:
        """Estimate the seconds until all items are done; None while nothing is known.

        Each remaining item is assumed to take the mean time of those that have ended.
        """
        if self._num_ended == 0:
            return None
        if not self._durations_s:
            return (self._clock() - self._started) / self._num_ended * self.num_left
        mean_s = sum(self._durations_s) / len(self._durations_s)
        rests_s = [max(mean_s - elapsed_s, 0.0) for _, elapsed_s in self.running()]
        all_s = sum(rests_s) + mean_s * (self.num_left - len(rests_s))
        return max([all_s / self._num_jobs, *rests_s])
