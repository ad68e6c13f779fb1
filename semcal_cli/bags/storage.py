"""What every reader of a file of a recording gives, whatever its format."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Protocol

from semcal_cli.bags.messages import Message, Topic


class Storage(Protocol):
    """An open file of a recording."""

    topics: list[Topic]
    """Its topics, each with the messages of this file."""
    damage: str | None
    """Description of what is missing; None if nothing is."""
    is_indexed: bool
    """Whether a time can be looked up without reading all that stands before it."""

    def messages(self, topics: Collection[Topic], start_ns: int, stop_ns: int) -> Iterator[Message]:
        """Yield the messages of some topics from `start_ns` to before `stop_ns`, in the order of receipt."""
