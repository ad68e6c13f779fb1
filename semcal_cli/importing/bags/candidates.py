"""Pairs of a recording that may become frames: read near wanted times, kept on disk, chosen so that scenes differ."""

from __future__ import annotations

import os
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from semcal_cli.geometry.arrays import Values
from semcal_cli.importing.bags.bag import Bag
from semcal_cli.importing.bags.image_messages import thumbnail
from semcal_cli.importing.bags.messages import NS, Message, MessageError
from semcal_cli.importing.bags.recorded_motion import Trajectory
from semcal_cli.importing.bags.stamped_pairs import AFTER_NS, Pair, Pairing
from semcal_cli.importing.bags.topics import MAX_FRAMES, Request, Topics
from semcal_cli.importing.bags.video import Packet, Video
from semcal_cli.observations.frame_selection import evenly_spaced, farthest_points

CANDIDATES = 2
"""Number of pairs that are read for each frame that is kept, when scenes should differ."""
LEAST_TRAVELLED_M = 5.0
"""Shortest path of the rig along which frames are spread; on shorter ones, frames whose images differ are chosen."""
MAX_SPREAD = 500
"""Largest number of frames that are chosen by how much they differ; more would take long and are spaced evenly."""


@dataclass(frozen=True)
class Candidate:
    """A pair whose messages are on disk."""

    pair: Pair
    """The pair, without the bytes of its messages."""
    places: tuple[slice, slice]
    """Where the bytes of its sweep and its image are."""
    look: Values
    """Thumbnail of the image."""


class Spool:
    """Messages on disk, until it is known which are needed."""

    def __init__(self, file: BinaryIO, video: Video | None = None) -> None:
        """Keep messages in a file; images of a video are decoded."""
        self._file, self._video = file, video

    def put(self, pair: Pair) -> Candidate:
        """Put a pair on disk.

        Raises:
            MessageError: its image cannot be read.
        """
        if self._video is not None and isinstance(pair.image, Packet):
            pair = pair._replace(image=self._video.still(pair.image))
        look = thumbnail(pair.image)
        light = pair._replace(sweep=replace(pair.sweep, raw=b""), image=replace(pair.image, raw=b""))
        return Candidate(light, (self._append(pair.sweep.raw), self._append(pair.image.raw)), look)

    def get(self, candidate: Candidate) -> tuple[Message, Message]:
        """Read the sweep and the image of a pair; several threads may do so."""
        number = self._file.fileno()
        raw = [os.pread(number, place.stop - place.start, place.start) for place in candidate.places]
        return replace(candidate.pair.sweep, raw=raw[0]), replace(candidate.pair.image, raw=raw[1])

    def _append(self, content: bytes) -> slice:
        start = self._file.seek(0, os.SEEK_END)
        self._file.write(content)
        self._file.flush()
        return slice(start, start + len(content))


def wanted_times(bag: Bag, topics: Topics, request: Request) -> list[int]:
    """Choose the times of receipt near which pairs are searched; nanoseconds, ascending."""
    span = topics.points.span
    if request.every_s is not None:
        wanted = range(span.first_ns, span.last_ns + 1, max(round(request.every_s * NS), 1))
        count = request.max_frames or len(wanted)
    else:
        count = CANDIDATES * (request.max_frames or MAX_FRAMES)
        wanted = range(span.first_ns, span.last_ns, max((span.last_ns - span.first_ns) // count, 1))
    if len(wanted) >= span.num_messages or span.first_ns == span.last_ns:
        # Every sweep is wanted, however unevenly they arrived.
        return sorted(message.received_ns for message in bag.messages([topics.points]))
    return list(wanted[:count])


def read_pairs(
    bag: Bag,
    wanted_ns: Sequence[int],
    pairing: Pairing,
    watched: Callable[[int, int], Iterator[Message]],
    trajectory: Trajectory | None,
    on_place: Callable[[int, int], None],
) -> Iterator[Pair]:
    """Read the pairs near wanted times. If the recording has an index, only the parts around these times are read.

    Args:
        bag: The recording.
        wanted_ns: The times.
        pairing: Finder of the pairs.
        watched: Function that yields the sweeps and images from a start to before a stop.
        trajectory: States how much to read around a sweep for the poses of its points; None if no poses are needed.
        on_place: Called with the number of wanted times that are done, and of all.
    """
    if not bag.is_indexed:
        on_place(0, 1)
        yield from pairing.pairs(watched(bag.start_ns, bag.end_ns + 1))
        return
    for index, wanted in enumerate(wanted_ns):
        on_place(index, len(wanted_ns))
        if pairing.is_wanted(wanted):
            before_ns = pairing.before_ns
            if trajectory is not None:
                before_ns = max(before_ns, pairing.delay_ns + trajectory.before_ns)
            start_ns = max(pairing.read_ns, wanted - before_ns)
            yield from pairing.pairs(watched(start_ns, wanted + AFTER_NS), wanted, trajectory)


def spooled(pairs: Iterable[Pair], spool: Spool, left_out: Counter[str]) -> list[Candidate]:
    """Put pairs on disk; those whose image cannot be read are counted and left out."""
    found = []
    for pair in pairs:
        try:
            found.append(spool.put(pair))
        except MessageError as error:
            left_out[f"pairs: image: {error}"] += 1
    return found


def choose(
    candidates: Sequence[Candidate],
    request: Request,
    trajectory: Trajectory | None,
    left_out: Counter[str],
) -> list[Candidate]:
    """Choose the pairs whose scenes differ most, in order of time, and count the others."""
    kept = [candidates[index] for index in longest_ascending([each.pair.sweep_ns for each in candidates])]
    if left := len(candidates) - len(kept):
        left_out["pairs: their stamps run backwards"] += left
    count = request.max_frames or (MAX_FRAMES if request.every_s is None else len(kept))
    if len(kept) <= count:
        return kept
    if request.every_s is not None:
        left_out["pairs: more than --max-frames"] += len(kept) - count
        return kept[:count]
    way = None if trajectory is None else _way_m([trajectory.position(each.pair.sweep_ns) for each in kept])
    why = (
        "their images are like those of others" if way is None else "others are spread better along the path"
    )
    left_out[f"pairs: {why}"] += len(kept) - count
    return [kept[index] for index in _most_different([each.look for each in kept], count, way)]


def _way_m(positions: Sequence[npt.NDArray[np.float64] | None]) -> npt.NDArray[np.float64] | None:
    """Compute the path length up to each position (N,), metres; None if the path is short or a position is unknown."""
    known = [position for position in positions if position is not None]
    if len(known) < max(len(positions), 2):
        return None
    steps = np.linalg.norm(np.diff(np.stack(known), axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    return way if way[-1] >= LEAST_TRAVELLED_M else None


def longest_ascending(values: Sequence[int]) -> list[int]:
    """Find the indices of the longest strictly ascending subsequence: what is left without outliers."""
    ends: list[int] = []  # Index of the smallest last value of an ascending subsequence of each length.
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


def _most_different(looks: Sequence[Values], count: int, way: npt.NDArray[np.float64] | None) -> list[int]:
    """Choose `count` pairs that are far apart along the path or whose images differ, in ascending order.

    Args:
        looks: Thumbnails of the images.
        count: How many to choose.
        way: (N,) path length up to each, metres, or None. With it, images that differ count as a metre at most.
    """
    if count > MAX_SPREAD:
        return evenly_spaced(range(len(looks)), count)
    positions = np.zeros(len(looks), np.float32) if way is None else way
    rows = np.column_stack([positions, np.stack(looks)])

    def distances(rows: npt.NDArray[np.float64], row: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        apart = np.abs(rows - row)
        found: npt.NDArray[np.float64] = apart[:, 0] + apart[:, 1:].mean(axis=1)
        return found

    return farthest_points(rows, count, distances)
