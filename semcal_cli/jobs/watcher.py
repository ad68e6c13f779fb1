"""Who is told how a run over many items goes."""

from __future__ import annotations


class Watcher:
    """Is told which items are done before a run, which begin and which end; this one does nothing with it."""

    def resume(self, num_done: int, num_items: int) -> None:
        """The run begins, and some of its items are done already."""

    def begin(self, item: str) -> None:
        """An item begins; several threads may tell so at the same time."""

    def end(self, item: str) -> None:
        """An item is done."""
