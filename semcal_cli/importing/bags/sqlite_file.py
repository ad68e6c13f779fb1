"""Reader of `.db3` files of ROS 2, even if they are cut off."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Any, TypeAlias

from semcal_cli.importing.bags.messages import Message, Span, Topic

TABLES = "SELECT name FROM sqlite_master WHERE type = 'table' AND rootpage > 0"
"""Tables, but not views or virtual tables, whose rows could be anything and never end."""
IS_MESSAGE = "typeof(timestamp) = 'integer' AND typeof(data) = 'blob'"
"""Whether a row is a message: a column can hold anything."""
IN_RANGE = f"""SELECT topic_id, timestamp, data FROM messages WHERE timestamp >= ? AND timestamp < ?
AND {IS_MESSAGE} AND topic_id IN ({{}}) ORDER BY timestamp"""
ROWS = f"SELECT topic_id, {IS_MESSAGE}, timestamp, {{}} FROM messages NOT INDEXED"
"""Rows in the order of the file, which can be read where an index is damaged."""
Spans: TypeAlias = dict[tuple[Any, int], Span]
"""Rows by the id of their topic, and whether they are messages."""


class SqliteFile:
    """A `.db3` of ROS 2."""

    def __init__(self, path: Path, stack: ExitStack) -> None:
        """Open the database, until `stack` closes it, and count its rows.

        Raises:
            ValueError: it does not have the tables of a recording.
            sqlite3.Error: it is not a database, or is too damaged.
        """
        # A URI keeps SQLite from writing beside the file; it is quoted because a name can hold `?`, `#` and `%`.
        uri = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
        self._database = stack.enter_context(closing(sqlite3.connect(uri, uri=True)))
        self.is_indexed = True
        self._database.execute("PRAGMA trusted_schema = OFF")
        spans = self._spans()
        missing = [] if self.is_indexed else ["its end: the database is cut off or damaged"]
        if num_odd := sum(span.num_messages for (_, is_message), span in spans.items() if not is_message):
            missing.append(
                f"{num_odd:,} rows whose timestamp is not a whole number or whose data are not bytes"
            )
        log = path.with_name(f"{path.name}-wal")
        if log.is_file() and (size := log.stat().st_size):
            missing.append(f"the content of {log.name}, {size:,} bytes: the recording was not closed")
        self.damage = "; ".join(missing) or None
        self._topics = {
            key: Topic(name, kind, spans.get((key, 1), Span()))
            for key, name, kind in self._database.execute("SELECT id, name, type FROM topics")
            if isinstance(name, str) and isinstance(kind, str)
        }
        self.topics = list(self._topics.values())

    def messages(self, topics: Collection[Topic], start_ns: int, stop_ns: int) -> Iterator[Message]:
        """Yield the messages of some topics from `start_ns` to before `stop_ns`.

        They come in order of receipt; if the database is damaged, in the order of the file.
        """
        for topic_id, time_ns, raw in self._rows(topics, start_ns, stop_ns):
            yield Message(self._topics[topic_id], time_ns, raw)

    def _rows(self, topics: Collection[Topic], start_ns: int, stop_ns: int) -> Iterator[tuple[Any, ...]]:
        keys = [key for key, topic in self._topics.items() if topic in topics]
        if self.is_indexed:
            query = IN_RANGE.format(",".join("?" * len(keys)))
            yield from self._database.execute(query, [start_ns, stop_ns, *keys])
            return
        with suppress(sqlite3.Error):  # The damage was reported when the rows were counted.
            for topic_id, is_message, time_ns, raw in self._database.execute(ROWS.format("data")):
                if is_message and topic_id in keys and start_ns <= time_ns < stop_ns:
                    yield topic_id, time_ns, raw

    def _spans(self) -> Spans:
        """Count the rows of each topic that can be read.

        Rows are counted here and not by SQLite, which would sort them together with their data.
        """
        try:
            tables = self._database.execute(TABLES).fetchall()
        except sqlite3.DatabaseError:
            self.is_indexed = False
            # A file that is shorter than its header says can be read only with this (sqlite.org/recovery.html).
            self._database.execute("PRAGMA writable_schema = ON")
            tables = self._database.execute(TABLES).fetchall()
        if not {("topics",), ("messages",)} <= set(tables):
            raise ValueError("found no tables 'topics' and 'messages', as ROS 2 writes them")
        spans: Spans = {}
        try:
            for topic_id, is_message, time_ns, _ in self._database.execute(ROWS.format("1")):
                row_span = Span(1, time_ns, time_ns) if is_message else Span(1)
                key = topic_id, is_message
                spans[key] = spans.get(key, Span()).join(row_span)
        except sqlite3.DatabaseError:  # What was read before the damage is kept.
            self.is_indexed = False
        return spans
