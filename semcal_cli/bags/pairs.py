"""Sweeps with the pictures nearest in time, while the recording streams by."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from semcal_cli.bags.messages import NS, Message, MessageError

MAX_WAITING_BYTES = 1 << 27
"""Most bytes of pictures that wait for the sweep that they may belong to."""
PATIENCE_NS = NS
"""How far apart the messages of one moment may be received: drivers are slow by different times."""
BEFORE_NS, AFTER_NS = NS // 2, 2 * NS
"""What is read before and after a wanted time: pictures before the first sweep, and sweeps until one has a picture."""
MARGIN_NS = NS // 20
"""What is read before the pictures that were as late as any so far."""
LEARNED = 5
"""Number of pairs from which on it is known how late pictures are."""


class Pair(NamedTuple):
    """A sweep and the picture nearest in time."""

    sweep: Message
    picture: Message
    sweep_ns: int
    """Stamp of the sweep."""
    picture_ns: int
    """Stamp of the picture."""


@dataclass
class _Waiting:
    sweep: Message
    stamp_ns: int
    picture: Message | None = None
    picture_ns: int = 0
    gap_ns: int = 1 << 62

    def offer(self, picture: Message, stamp_ns: int) -> None:
        gap_ns = abs(stamp_ns - self.stamp_ns)
        if gap_ns < self.gap_ns:
            self.picture, self.picture_ns, self.gap_ns = picture, stamp_ns, gap_ns


class Pairing:
    """Finds a pair soon after each wanted time.

    The first sweep that was received at or after a wanted time is taken; if it has no picture within the largest gap,
    the next one, until `PATIENCE_NS` after the wanted time.
    """

    def __init__(
        self, wanted_ns: Sequence[int], max_gap_ns: int, *, by_receipt: bool, picture_topic: str
    ) -> None:
        self._wanted = deque(wanted_ns)
        self._max_gap_ns = max_gap_ns
        self._by_receipt = by_receipt
        self._picture_topic = picture_topic
        self._pictures: deque[tuple[int, Message]] = deque()
        self._picture_bytes = 0
        self._waiting: deque[_Waiting] = deque()
        self._used: set[int] = set()
        self._retry_until_ns = 0
        self._last_ns = 0
        self._leads_ns: list[int] = []
        self.left_out: Counter[str] = Counter()
        """Number of sweeps and pictures that were looked at and left out, by the reason."""
        self.delays_s: dict[bool, list[float]] = {False: [], True: []}
        """Times between stamp and receipt, of sweeps and of pictures (True)."""

    @property
    def before_ns(self) -> int:
        """What has to be read before a wanted time, so that the pictures of its sweep are there."""
        return BEFORE_NS if len(self._leads_ns) < LEARNED else max(*self._leads_ns, 0) + MARGIN_NS

    def is_wanted(self, time_ns: int) -> bool:
        """Whether no sweep was taken for a wanted time yet."""
        return bool(self._wanted) and self._wanted[0] <= time_ns

    def pairs(
        self, messages: Iterable[Message], goal_ns: int | None = None, enough_ns: int = 0
    ) -> Iterator[Pair]:
        """Yield the pairs of a stretch of the recording, in order.

        Args:
            messages: The sweeps and pictures of the stretch, which follows those before.
            goal_ns: The wanted time for which the stretch is read, until there is a pair; None reads all.
            enough_ns: What to read after its sweep.
        """
        for message in messages:
            is_picture = message.topic == self._picture_topic
            try:
                stamp_ns = self.stamp_ns(message)
            except MessageError as error:
                self.left_out[f"{'pictures' if is_picture else 'sweeps'}: {error}"] += 1
                continue
            self.delays_s[is_picture].append((message.received_ns - stamp_ns) / NS)
            if is_picture:
                self._take_picture(message, stamp_ns)
            else:
                self._take_sweep(message, stamp_ns)
            yield from self._settled(message)
            if goal_ns is not None and self._is_done(goal_ns, message.received_ns - enough_ns):
                break
        yield from self._settled(None)
        self._retry_until_ns = 0

    def stamp_ns(self, message: Message) -> int:
        """Tell the time of a message.

        Raises:
            MessageError: it has no header, or a stamp of zero.
        """
        if self._by_receipt:
            return message.received_ns
        if message.header_ns == 0:
            raise MessageError("found a stamp of zero, needed a time; or give --stamps receive")
        return message.header_ns

    def _take_picture(self, message: Message, stamp_ns: int) -> None:
        for waiting in self._waiting:
            waiting.offer(message, stamp_ns)
        self._pictures.append((stamp_ns, message))
        self._picture_bytes += len(message.raw)
        while len(self._pictures) > 1 and (
            self._picture_bytes > MAX_WAITING_BYTES
            or message.received_ns - self._pictures[0][1].received_ns > PATIENCE_NS
        ):
            self._picture_bytes -= len(self._pictures.popleft()[1].raw)

    def _take_sweep(self, message: Message, stamp_ns: int) -> None:
        if not self._is_wanted(message.received_ns):
            return
        waiting = _Waiting(message, stamp_ns)
        for picture_ns, picture in self._pictures:
            waiting.offer(picture, picture_ns)
        self._waiting.append(waiting)
        self._last_ns = message.received_ns

    def _is_wanted(self, received_ns: int) -> bool:
        is_wanted = received_ns <= self._retry_until_ns
        while self._wanted and self._wanted[0] <= received_ns:
            self._wanted.popleft()
            is_wanted = True
        self._retry_until_ns = 0
        return is_wanted

    def _settled(self, message: Message | None) -> Iterator[Pair]:
        """Yield the pairs to which no nearer picture can come."""
        while self._waiting:
            first = self._waiting[0]
            if message is not None and not self._is_settled(first, message):
                return
            self._waiting.popleft()
            if first.gap_ns > self._max_gap_ns or first.picture is None:
                self.left_out[f"sweeps: no picture within {self._max_gap_ns / NS:g} s"] += 1
                self._retry_until_ns = first.sweep.received_ns + PATIENCE_NS
            elif first.picture_ns in self._used:
                self.left_out["sweeps: the nearest picture is nearer to another one"] += 1
            else:
                self._used.add(first.picture_ns)
                self._leads_ns.append(first.sweep.received_ns - first.picture.received_ns)
                yield Pair(first.sweep, first.picture, first.stamp_ns, first.picture_ns)

    def _is_done(self, goal_ns: int, now_ns: int) -> bool:
        if self._waiting or self._retry_until_ns or self.is_wanted(goal_ns):
            return False
        return now_ns >= self._last_ns

    def _is_settled(self, waiting: _Waiting, message: Message) -> bool:
        """Whether pictures are past the sweep by more than the best gap, or can hardly come any more."""
        if message.received_ns - waiting.sweep.received_ns > PATIENCE_NS:
            return True
        newest = self._pictures[-1][0] if self._pictures else None
        return newest is not None and newest >= waiting.stamp_ns + min(waiting.gap_ns, self._max_gap_ns)
