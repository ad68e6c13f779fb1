"""Pairs of a recording that may become frames: read near wanted times, kept on disk, chosen so that scenes differ."""

from __future__ import annotations

import os
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import BinaryIO

import numpy as np

from semcal_cli.config.nanoseconds import NS
from semcal_cli.geometry.arrays import Numbers, Values, Vector
from semcal_cli.importing.bags.bag import Bag
from semcal_cli.importing.bags.image_messages import thumbnail
from semcal_cli.importing.bags.messages import Message, MessageError
from semcal_cli.importing.bags.recorded_motion import Trajectory
from semcal_cli.importing.bags.stamped_pairs import AFTER_NS, Pairing, StampedPair
from semcal_cli.importing.bags.topics import MAX_FRAMES, BagRequest, Topics
from semcal_cli.importing.bags.video import Packet, Video
from semcal_cli.observations.frame_selection import evenly_spaced, farthest_points

CANDIDATES = 2
"""Number of pairs that are read for each frame that is kept, when scenes should differ."""
MIN_TRAVELLED_M = 5.0
"""Shortest path of the rig along which frames are spread; on shorter ones, frames whose images differ are chosen."""
MAX_SPREAD = 500
"""Largest number of frames that are chosen by how much they differ; more would take long and are spaced evenly."""


@dataclass(frozen=True)
class SpooledPair:
    """A pair whose messages are on disk."""

    pair: StampedPair
    """The pair, without the bytes of its messages."""
    places: tuple[slice, slice]
    """Where the bytes of its sweep and its image are."""
    thumbnail: Values
    """Thumbnail of the image."""


class Spool:
    """Messages on disk, until it is known which are needed."""

    def __init__(self, file: BinaryIO, video: Video | None = None) -> None:
        """Keep messages in a file; images of a video are decoded."""
        self._file, self._video = file, video

    def put(self, pair: StampedPair) -> SpooledPair:
        """Put a pair on disk.

        Raises:
            MessageError: its image cannot be read.
        """
        if self._video is not None and isinstance(pair.image, Packet):
            pair = pair._replace(image=self._video.still(pair.image))
        small_image = thumbnail(pair.image)
        light = pair._replace(sweep=replace(pair.sweep, raw=b""), image=replace(pair.image, raw=b""))
        return SpooledPair(light, (self._append(pair.sweep.raw), self._append(pair.image.raw)), small_image)

    def get(self, candidate: SpooledPair) -> tuple[Message, Message]:
        """Read the sweep and the image of a pair; several threads may do so."""
        number = self._file.fileno()
        raw = [os.pread(number, span.stop - span.start, span.start) for span in candidate.places]
        return replace(candidate.pair.sweep, raw=raw[0]), replace(candidate.pair.image, raw=raw[1])

    def _append(self, content: bytes) -> slice:
        start = self._file.seek(0, os.SEEK_END)
        self._file.write(content)
        self._file.flush()
        return slice(start, start + len(content))


def wanted_times(bag: Bag, topics: Topics, request: BagRequest) -> list[int]:
    """Choose the times of receipt near which pairs are searched; nanoseconds, ascending."""
    span = topics.points.span
    if request.sweeps_ns is not None:
        return sorted(request.sweeps_ns.values())
    if request.every_s is not None:
        times_ns = range(span.first_ns, span.last_ns + 1, max(round(request.every_s * NS), 1))
        count = request.max_frames or len(times_ns)
    else:
        count = CANDIDATES * (request.max_frames or MAX_FRAMES)
        times_ns = range(span.first_ns, span.last_ns, max((span.last_ns - span.first_ns) // count, 1))
    if len(times_ns) >= span.num_messages or span.first_ns == span.last_ns:
        # Every sweep is wanted, however unevenly they arrived.
        return sorted(message.received_ns for message in bag.messages([topics.points]))
    return list(times_ns[:count])


def read_pairs(
    bag: Bag,
    wanted_ns: Sequence[int],
    pairing: Pairing,
    read_messages: Callable[[int, int], Iterator[Message]],
    trajectory: Trajectory | None,
    on_place: Callable[[int, int], None],
) -> Iterator[StampedPair]:
    """Read the pairs near wanted times. If the recording has an index, only the parts around these times are read.

    Args:
        bag: The recording.
        wanted_ns: The times.
        pairing: Finder of the pairs.
        read_messages: Function that yields the sweeps and images from a start to before a stop.
        trajectory: States how much to read around a sweep for the poses of its points; None if no poses are needed.
        on_place: Called with the number of wanted times that are done, and of all.
    """
    if not bag.is_indexed:
        on_place(0, 1)
        yield from pairing.pairs(read_messages(bag.start_ns, bag.end_ns + 1))
        return
    for index, time_ns in enumerate(wanted_ns):
        on_place(index, len(wanted_ns))
        if pairing.is_wanted(time_ns):
            before_ns = pairing.before_ns
            if trajectory is not None:
                before_ns = max(before_ns, pairing.delay_ns + trajectory.before_ns)
            start_ns = max(pairing.read_ns, time_ns - before_ns)
            yield from pairing.pairs(read_messages(start_ns, time_ns + AFTER_NS), time_ns, trajectory)


def spool_pairs(pairs: Iterable[StampedPair], spool: Spool, left_out: Counter[str]) -> list[SpooledPair]:
    """Put pairs on disk; those whose image cannot be read are counted and left out."""
    candidates = []
    for pair in pairs:
        try:
            candidates.append(spool.put(pair))
        except MessageError as error:
            left_out[f"pairs: image: {error}"] += 1
    return candidates


def choose(
    candidates: Sequence[SpooledPair],
    request: BagRequest,
    trajectory: Trajectory | None,
    left_out: Counter[str],
) -> list[SpooledPair]:
    """Choose the pairs whose scenes differ most, in order of time, and count the others."""
    ascending = [
        candidates[index]
        for index in longest_ascending([candidate.pair.sweep_ns for candidate in candidates])
    ]
    if left := len(candidates) - len(ascending):
        left_out["pairs: their stamps run backwards"] += left
    if request.sweeps_ns is not None:
        kept = [candidate for candidate in ascending if candidate.pair.sweep_ns in request.sweeps_ns]
        if left := len(ascending) - len(kept):
            left_out["pairs: of sweeps that the first camera does not have"] += left
        return kept
    count = request.max_frames or (MAX_FRAMES if request.every_s is None else len(ascending))
    if len(ascending) <= count:
        return ascending
    if request.every_s is not None:
        left_out["pairs: more than --max-frames"] += len(ascending) - count
        return ascending[:count]
    path_lengths_m = (
        None
        if trajectory is None
        else _path_lengths_m([trajectory.position(candidate.pair.sweep_ns) for candidate in ascending])
    )
    reason = (
        "their images are like those of others"
        if path_lengths_m is None
        else "others are spread better along the path"
    )
    left_out[f"pairs: {reason}"] += len(ascending) - count
    return [
        ascending[index]
        for index in _most_different([candidate.thumbnail for candidate in ascending], count, path_lengths_m)
    ]


def _path_lengths_m(positions: Sequence[Vector | None]) -> Numbers | None:
    """Compute the path length up to each position (N,), metres; None if the path is short or a position is unknown."""
    known_positions = [position for position in positions if position is not None]
    if len(known_positions) < max(len(positions), 2):
        return None
    steps = np.linalg.norm(np.diff(np.stack(known_positions), axis=0), axis=1)
    path_lengths_m = np.concatenate([[0.0], np.cumsum(steps)])
    return path_lengths_m if path_lengths_m[-1] >= MIN_TRAVELLED_M else None


def longest_ascending(values: Sequence[int]) -> list[int]:
    """Find the indices of the longest strictly ascending subsequence: what is left without outliers."""
    ends: list[int] = []  # Index of the smallest last value of an ascending subsequence of each length.
    before: list[int | None] = []
    for index, value in enumerate(values):
        length = bisect_left(ends, value, key=lambda end: values[end])
        before.append(ends[length - 1] if length else None)
        ends[length : length + 1] = [index]
    indices: list[int] = []
    last = ends[-1] if ends else None
    while last is not None:
        indices.append(last)
        last = before[last]
    return indices[::-1]


def _most_different(thumbnails: Sequence[Values], count: int, path_lengths_m: Numbers | None) -> list[int]:
    """Choose `count` pairs that are far apart along the path or whose images differ, in ascending order.

    Args:
        thumbnails: Thumbnails of the images.
        count: How many to choose.
        path_lengths_m: (N,) path length up to each pair, metres, or None. With it, images that differ count as a metre
            at most.
    """
    if count > MAX_SPREAD:
        return evenly_spaced(range(len(thumbnails)), count)
    positions = np.zeros(len(thumbnails), np.float32) if path_lengths_m is None else path_lengths_m
    rows = np.column_stack([positions, np.stack(thumbnails)])

    def distances(rows: Numbers, row: Numbers) -> Numbers:
        apart = np.abs(rows - row)
        distance: Numbers = apart[:, 0] + apart[:, 1:].mean(axis=1)
        return distance

    return farthest_points(rows, count, distances)
