"""Pairs of a recording that may become frames: read near wanted times, kept on disk, chosen so that scenes differ."""

from __future__ import annotations

import os
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import BinaryIO, Protocol

import numpy as np
import numpy.typing as npt

from semcal_cli.bags.bag import Bag
from semcal_cli.bags.messages import NS, Message, MessageError
from semcal_cli.bags.pairs import AFTER_NS, Pair, Pairing
from semcal_cli.bags.pictures import thumbnail
from semcal_cli.bags.topics import MAX_FRAMES, Request, Topics
from semcal_cli.drive.frame_selection import evenly_spaced, farthest_points

CANDIDATES = 2
"""Pairs that are looked at for each frame that is kept, when scenes are to differ."""
LEAST_TRAVELLED_M = 5.0
"""Way of the rig from which on frames are spread along it; below, by how much their pictures differ."""
MAX_SPREAD = 500
"""Most frames that are chosen by how much they differ; more, which would take long, are spaced evenly."""
MAX_WAITING = 2
"""Pairs that may wait to be put on disk: reading goes on meanwhile."""
Looks = npt.NDArray[np.float32]


class PosesAround(Protocol):
    """What has to be read around a sweep, so that there are poses before and after its points."""

    @property
    def before_ns(self) -> int:
        """Time before the stamp of the sweep."""

    @property
    def after_ns(self) -> int:
        """Time after its receipt."""


@dataclass(frozen=True)
class Candidate:
    """A pair whose messages lie on disk."""

    pair: Pair
    """The pair, without the bytes of its messages."""
    places: tuple[slice, slice]
    """Where the bytes of its sweep and its picture lie."""
    look: Looks
    """Thumbnail of the picture."""


class Spool:
    """Messages on disk, until it is known which are needed."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def put(self, pair: Pair) -> Candidate:
        """Put a pair on disk.

        Raises:
            MessageError: its picture cannot be read.
        """
        look = thumbnail(pair.picture)
        light = pair._replace(sweep=replace(pair.sweep, raw=b""), picture=replace(pair.picture, raw=b""))
        return Candidate(light, (self._append(pair.sweep.raw), self._append(pair.picture.raw)), look)

    def get(self, candidate: Candidate) -> tuple[Message, Message]:
        """Read the sweep and the picture of a pair; several threads may do so."""
        number = self._file.fileno()
        raw = [os.pread(number, place.stop - place.start, place.start) for place in candidate.places]
        return replace(candidate.pair.sweep, raw=raw[0]), replace(candidate.pair.picture, raw=raw[1])

    def _append(self, content: bytes) -> slice:
        start = self._file.seek(0, os.SEEK_END)
        self._file.write(content)
        self._file.flush()
        return slice(start, start + len(content))


def wanted_times(bag: Bag, topics: Topics, request: Request) -> list[int]:
    """Choose the times, as messages were received, near which pairs are looked for; nanoseconds, ascending."""
    span = topics.points.span
    if request.every_s is not None:
        wanted = range(span.first_ns, span.last_ns + 1, max(round(request.every_s * NS), 1))
        count = request.max_frames or len(wanted)
    else:
        count = CANDIDATES * (request.max_frames or MAX_FRAMES)
        wanted = range(span.first_ns, span.last_ns, max((span.last_ns - span.first_ns) // count, 1))
    if len(wanted) >= span.num_messages or span.first_ns == span.last_ns:
        # Every sweep is wanted, however unevenly they came.
        return sorted(message.received_ns for message in bag.messages([topics.points]))
    return list(wanted[:count])


def read_pairs(
    bag: Bag,
    wanted_ns: Sequence[int],
    pairing: Pairing,
    watched: Callable[[int, int], Iterator[Message]],
    poses: PosesAround | None,
    on_place: Callable[[int, int], None],
) -> Iterator[Pair]:
    """Read the pairs near wanted times: no more of the recording than that takes, if it has an index.

    Args:
        bag: The recording.
        wanted_ns: The times.
        pairing: What finds the pairs.
        watched: Function that yields the sweeps and pictures from a start to before a stop.
        poses: What has to be read around a sweep for the poses of its points; None for nothing.
        on_place: Called with the number of times that were read, and of all.
    """
    if not bag.is_indexed:
        on_place(0, 1)
        yield from pairing.pairs(watched(bag.start_ns, bag.end_ns + 1))
        return
    read_ns = 0

    def noted(messages: Iterable[Message]) -> Iterator[Message]:
        nonlocal read_ns
        for message in messages:
            read_ns = message.received_ns + 1
            yield message

    for index, wanted in enumerate(wanted_ns):
        on_place(index, len(wanted_ns))
        if pairing.is_wanted(wanted):
            before_ns = pairing.before_ns
            if poses is not None:
                before_ns = max(before_ns, pairing.delay_ns + poses.before_ns)
            messages = noted(watched(max(read_ns, wanted - before_ns), wanted + AFTER_NS))
            yield from pairing.pairs(messages, wanted, lambda: 0 if poses is None else poses.after_ns)


def spooled(pairs: Iterable[Pair], spool: Spool, on_error: Callable[[MessageError], None]) -> list[Candidate]:
    """Put pairs on disk while the next ones are read; those whose picture cannot be read are told and left out."""
    found: list[Candidate] = []

    def finish(waiting: Future[Candidate]) -> None:
        try:
            found.append(waiting.result())
        except MessageError as error:
            on_error(error)

    with ThreadPoolExecutor(1) as worker:
        waiting: deque[Future[Candidate]] = deque()
        for pair in pairs:
            waiting.append(worker.submit(spool.put, pair))
            if len(waiting) > MAX_WAITING:
                finish(waiting.popleft())
        for each in waiting:
            finish(each)
    return found


def way_m(positions: Sequence[npt.NDArray[np.float64] | None]) -> npt.NDArray[np.float64] | None:
    """Compute the length of the way to each position (N,), metres; None if it is short, or a position is unknown."""
    known = [position for position in positions if position is not None]
    if len(known) < max(len(positions), 2):
        return None
    steps = np.linalg.norm(np.diff(np.stack(known), axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    return way if way[-1] >= LEAST_TRAVELLED_M else None


def longest_ascending(values: Sequence[int]) -> list[int]:
    """Find the longest strictly ascending part of a sequence, by its indices: what is left without outliers."""
    ends: list[int] = []  # Index of the smallest last value of an ascending part of each length.
    before: list[int | None] = []
    for index, value in enumerate(values):
        length = bisect_left(ends, value, key=lambda end: values[end])
        before.append(ends[length - 1] if length else None)
        ends[length:] = [index, *ends[length + 1 :]]
    found: list[int] = []
    place = ends[-1] if ends else None
    while place is not None:
        found.append(place)
        place = before[place]
    return found[::-1]


def most_different(
    looks: Sequence[Looks], count: int, way: npt.NDArray[np.float64] | None = None
) -> list[int]:
    """Choose `count` pairs that are far apart along the way or whose pictures differ, in ascending order.

    Args:
        looks: Thumbnails of the pictures.
        count: How many to choose.
        way: (N,) way to each, metres; None if it is not known. Where it is, pictures count as much as a metre at most.
    """
    if count > MAX_SPREAD:
        return evenly_spaced(range(len(looks)), count)
    rows = np.stack(looks) if way is None else np.column_stack([way, np.stack(looks)])

    def distances(rows: npt.NDArray[np.float64], row: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        apart = np.abs(rows - row)
        found: npt.NDArray[np.float64] = (
            apart.mean(axis=1) if way is None else apart[:, 0] + apart[:, 1:].mean(axis=1)
        )
        return found

    return farthest_points(rows, count, distances)
