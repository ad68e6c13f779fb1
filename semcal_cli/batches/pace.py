"""The pace of a run over many items: which are being done, since when, and how long the rest may take."""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock
from time import monotonic


class Pace:
    """Is told which items are done before a run, which begin and which end; threads may tell it at the same time."""

    def __init__(self, num_items: int, num_jobs: int, clock: Callable[[], float] = monotonic) -> None:
        """Begin to watch.

        Args:
            num_items: Number of all items.
            num_jobs: Number of items at a time.
            clock: Seconds since any moment.
        """
        self.num_items = self.num_left = num_items
        self._num_jobs, self._clock, self._started = num_jobs, clock, clock()
        self._begun: dict[str, float] = {}
        self._num_ended, self._durations_s = 0, list[float]()
        self._lock = Lock()

    @property
    def num_done(self) -> int:
        """Number of items that are done, now or before the run."""
        return self.num_items - self.num_left

    def resume(self, num_done: int, num_items: int) -> None:
        """Begin a run of which some items are done already; they are no measure of how long the others take."""
        self.num_items, self.num_left = num_items, num_items - num_done

    def skip(self) -> None:
        """Count an item that was done before the run."""
        self.num_left -= 1

    def begin(self, name: str) -> None:
        """Note that an item begins."""
        with self._lock:
            self._begun[name] = self._clock()

    def end(self, name: str) -> None:
        """Note that an item is done; where it ran elsewhere, nobody told that it began."""
        with self._lock:
            begun = self._begun.pop(name, None)
            if begun is not None:
                self._durations_s.append(self._clock() - begun)
            self._num_ended += 1
            self.num_left -= 1

    def running(self) -> list[tuple[str, float]]:
        """List the names of the items that are being done, each with the seconds since it began, the oldest first."""
        with self._lock:
            now = self._clock()
            return [(name, now - begun) for name, begun in self._begun.items()]

    def left_s(self) -> float | None:
        """Estimate the seconds until all items are done; None while nothing is known.

        Each item that is left is taken to last as long as the mean of those that have ended.
        """
        if self._num_ended == 0:
            return None
        if not self._durations_s:
            return (self._clock() - self._started) / self._num_ended * self.num_left
        mean_s = sum(self._durations_s) / len(self._durations_s)
        rests_s = [max(mean_s - elapsed_s, 0.0) for _, elapsed_s in self.running()]
        all_s = sum(rests_s) + mean_s * (self.num_left - len(rests_s))
        return max([all_s / self._num_jobs, *rests_s])
