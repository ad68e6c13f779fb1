"""Pairs of a sweep and the image nearest in time, found while the recording is read."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from semcal_cli.config.nanoseconds import NS
from semcal_cli.importing.bags.messages import Message, MessageError, Topic
from semcal_cli.importing.bags.recorded_motion import Trajectory

MAX_KEPT_BYTES = {True: 1 << 27, False: 1 << 26}
"""Largest number of bytes of images (True) and of sweeps that are kept as possible partners."""
PATIENCE_NS = NS
"""How far apart the messages of one moment may be received: drivers have different delays."""
BEFORE_NS, AFTER_NS = NS // 2, 2 * NS
"""How much is read before and after a wanted time: images before the first sweep, and sweeps until one has an image."""
MARGIN_NS = NS // 20
"""How much is read beyond the longest time so far from the receipt of an image to that of its sweep."""
CLOSE_GAP = 0.4
"""Gap, relative to the time from sweep to sweep, below which no other sweep can be nearer to an image."""
NUM_LEARNED = 5
"""Number of pairs after which it is known how long before their sweeps images are received."""


class StampedPair(NamedTuple):
    """A sweep and the image nearest in time."""

    sweep: Message
    image: Message
    sweep_ns: int
    """Stamp of the sweep."""
    image_ns: int
    """Stamp of the image."""


class _Stamped(NamedTuple):
    stamp_ns: int
    message: Message


class _Recent:
    """The last messages of a topic, kept while they may still be the nearest to something."""

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes, self._num_bytes = max_bytes, 0
        self._kept: deque[_Stamped] = deque()

    def add(self, new: _Stamped) -> None:
        """Keep a message, and drop those that are too old or too many."""
        self._kept.append(new)
        self._num_bytes += len(new.message.raw)
        while len(self._kept) > 1 and (
            self._num_bytes > self._max_bytes
            or new.message.received_ns - self._kept[0].message.received_ns > PATIENCE_NS
        ):
            self._num_bytes -= len(self._kept.popleft().message.raw)

    def nearest(self, stamp_ns: int) -> _Stamped | None:
        """Find the message whose stamp is nearest."""
        return min(self._kept, key=lambda kept: abs(kept.stamp_ns - stamp_ns), default=None)

    def reaches(self, stamp_ns: int) -> bool:
        """Return whether the last message is at or after a stamp, so that no later one is nearer to an earlier time."""
        return bool(self._kept) and self._kept[-1].stamp_ns >= stamp_ns


class Pairing:
    """Finds a pair soon after each wanted time: a sweep and an image, each the nearest to the other.

    The first sweep that was received at or after a wanted time is taken, or another one that is nearer to its image.
    If it has no image within the largest gap, the next sweeps are tried, until `PATIENCE_NS` later.
    """

    def __init__(
        self,
        wanted_ns: Sequence[int],
        max_gap_ns: int,
        *,
        by_receipt: bool,
        image_topic: Topic,
        period_ns: int = 0,
    ) -> None:
        self._wanted = deque(wanted_ns)
        self._max_gap_ns = max_gap_ns
        self._by_receipt = by_receipt
        self._image_topic = image_topic
        self._period_ns = period_ns
        self._sweeps, self._images = _Recent(MAX_KEPT_BYTES[False]), _Recent(MAX_KEPT_BYTES[True])
        self._waiting: deque[_Stamped] = deque()
        self._used: set[int] = set()
        self._retry_until_ns = 0
        self._last_ns = 0
        self._num_leads, self._lead_ns = 0, 0
        self.read_ns = 0
        """Time just after the last message that was read."""
        self.delay_ns = 0
        """Longest time so far between the stamp and the receipt of a sweep, of those within `PATIENCE_NS`."""
        self.left_out: Counter[str] = Counter()
        """Number of sweeps and images that were read and left out, by reason."""
        self.delays_s: dict[bool, list[float]] = {False: [], True: []}
        """Times between stamp and receipt, of sweeps and of images (True)."""

    @property
    def before_ns(self) -> int:
        """How much to read before a wanted time, so that the image of its sweep is included."""
        return BEFORE_NS if self._num_leads < NUM_LEARNED else self._lead_ns + MARGIN_NS

    def is_wanted(self, time_ns: int) -> bool:
        """Return whether a wanted time up to this one has no sweep yet."""
        return bool(self._wanted) and self._wanted[0] <= time_ns

    def pairs(
        self,
        messages: Iterable[Message],
        goal_ns: int | None = None,
        trajectory: Trajectory | None = None,
    ) -> Iterator[StampedPair]:
        """Yield the pairs of a stretch of the recording, in order.

        Args:
            messages: The sweeps and images of the stretch, which comes after the stretches before.
            goal_ns: The wanted time for which the stretch is read, until there is a pair; None reads all.
            trajectory: States how much to read after a sweep for the poses of its points; None if no poses are needed.
        """
        for message in messages:
            is_image = message.topic == self._image_topic
            self.read_ns = message.received_ns + 1
            try:
                stamp_ns = self.stamp_ns(message)
            except MessageError as error:
                self.left_out[f"{'images' if is_image else 'sweeps'}: {error}"] += 1
                continue
            delay_ns = message.received_ns - stamp_ns
            self.delays_s[is_image].append(delay_ns / NS)
            if not is_image and delay_ns <= PATIENCE_NS:
                self.delay_ns = max(self.delay_ns, delay_ns)
            new = _Stamped(stamp_ns, message)
            (self._images if is_image else self._sweeps).add(new)
            if not is_image and self._takes(message.received_ns):
                self._waiting.append(new)
                self._last_ns = message.received_ns
            yield from self._settled(message)
            after_ns = 0 if trajectory is None else trajectory.after_ns
            if goal_ns is not None and self._is_done(goal_ns, message.received_ns - after_ns):
                break
        yield from self._settled(None)
        self._retry_until_ns = 0

    def stamp_ns(self, message: Message) -> int:
        """Return the time of a message.

        Raises:
            MessageError: it has no header, or a stamp of zero.
        """
        if self._by_receipt:
            return message.received_ns
        if message.header_ns == 0:
            raise MessageError("found a stamp of zero, expected a time, or --stamps receive")
        return message.header_ns

    def _takes(self, received_ns: int) -> bool:
        """Return whether a sweep that was received now is the first after a wanted time."""
        is_taken = received_ns <= self._retry_until_ns
        if self._wanted and self._wanted[0] <= received_ns:
            self._wanted.popleft()
            is_taken = True
        while self._wanted and self._wanted[0] < received_ns:  # Equal times belong to sweeps to come.
            self._wanted.popleft()
        self._retry_until_ns = 0
        return is_taken

    def _settled(self, now: Message | None) -> Iterator[StampedPair]:
        """Yield the pairs for whose parts no nearer partner can come."""
        while self._waiting:
            first = self._waiting[0]
            # Messages of one moment arrive within this time; later ones are ignored.
            is_late = now is None or now.received_ns - first.message.received_ns > PATIENCE_NS
            image = self._images.nearest(first.stamp_ns)
            gap_ns = self._max_gap_ns if image is None else abs(image.stamp_ns - first.stamp_ns)
            if not is_late and not self._images.reaches(first.stamp_ns + min(gap_ns, self._max_gap_ns)):
                return
            if image is None or gap_ns > self._max_gap_ns:
                self.left_out[f"sweeps: no image within {self._max_gap_ns / NS:g} s"] += 1
                self._retry_until_ns = first.message.received_ns + PATIENCE_NS
                self._waiting.popleft()
                continue
            if gap_ns > CLOSE_GAP * self._period_ns:
                if not is_late and not self._sweeps.reaches(image.stamp_ns + gap_ns):
                    return
                nearest = self._sweeps.nearest(image.stamp_ns)
                if nearest is not None and abs(nearest.stamp_ns - image.stamp_ns) < gap_ns:
                    self._waiting[0] = nearest
                    continue
            self._waiting.popleft()
            if image.stamp_ns in self._used:
                self.left_out["sweeps: their nearest image is nearer to another sweep"] += 1
                continue
            self._used.add(image.stamp_ns)
            self._num_leads += 1
            self._lead_ns = max(self._lead_ns, first.message.received_ns - image.message.received_ns)
            yield StampedPair(first.message, image.message, first.stamp_ns, image.stamp_ns)

    def _is_done(self, goal_ns: int, now_ns: int) -> bool:
        if self._waiting or self._retry_until_ns or self.is_wanted(goal_ns):
            return False
        return now_ns >= self._last_ns
