"""Files of recordings as `rosbags` reads them, and what is still whole of damaged ones.

A file that has no index, or was cut off, is read through once: its whole chunks become the index that it lacks. The
readers of `ros1_file`, `mcap_file` and `sqlite_file` derive from those of the library, which do not do that.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any, NamedTuple, Protocol

MAX_STAMP_NS = 2**63 - 1


class Span(NamedTuple):
    """The messages of one connection."""

    num_messages: int
    """Number of messages."""
    first_ns: int
    """Time of the first, as it was received."""
    last_ns: int
    """Time of the last."""


class Storage(Protocol):
    """A file of a recording."""

    connections: list[Any]
    damage: str | None
    is_indexed: bool

    def open(self) -> None:
        """Open the file and read its index, or make one."""

    def close(self) -> None:
        """Close the file."""

    def messages(
        self, connections: Collection[Any], start: int | None, stop: int | None
    ) -> Iterator[tuple[Any, int, bytes]]:
        """Yield connection, time and bytes of messages, in order of time."""

    def spans(self) -> dict[int, Span]:
        """Count the messages of each connection."""


def described_damage(what: str, missing: int, num_bad: int) -> str:
    """Describe what is missing of a file."""
    parts = [what]
    if missing > 0:
        parts.append(f"the last {missing:,} bytes, which are not whole")
    if num_bad:
        parts.append(f"{num_bad:,} damaged chunks")
    return ", ".join(parts)
