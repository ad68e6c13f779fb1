"""Reader of `.db3` files of ROS 2, even if they are cut off."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Any, TypeAlias

from semcal_cli.config.file_limits import (
    MAX_SQLITE_STEPS,
    MAX_TOPIC_NAME,
    MAX_TOPICS,
    MAX_UNPACKED_BYTES,
    MIN_ROW_BYTES,
    SQLITE_STEPS_A_BYTE,
)
from semcal_cli.errors import InputError
from semcal_cli.importing.bags.messages import Message, Span, Topic
from semcal_cli.importing.bags.unpacking import Meter

COLUMNS = {"topics": {"id", "name", "type"}, "messages": {"topic_id", "timestamp", "data"}}
"""Columns that are read of each table."""
TOPICS = f"""SELECT id, name, type FROM topics WHERE typeof(id) = 'integer' AND typeof(name) = 'text'
AND typeof(type) = 'text' AND length(name) <= {MAX_TOPIC_NAME} AND length(type) <= {MAX_TOPIC_NAME}
LIMIT {MAX_TOPICS + 1}"""
STEPS = 100_000
"""Instructions of SQLite after which they are counted."""
TABLES = "SELECT name FROM sqlite_master WHERE type = 'table' AND rootpage > 0"
"""Tables, but not views or virtual tables, whose rows could be anything and never end."""
IS_MESSAGE = f"""typeof(timestamp) = 'integer' AND typeof(data) = 'blob' AND length(data) <= {MAX_UNPACKED_BYTES}
AND typeof(topic_id) = 'integer'"""
"""Whether a row is a message: a column can hold anything. The length is read without the data."""
IN_RANGE = f"""SELECT topic_id, timestamp, {{}} FROM messages WHERE timestamp >= ? AND timestamp < ?
AND {IS_MESSAGE} AND topic_id IN ({{}}) ORDER BY timestamp"""
ROW = "SELECT data FROM messages WHERE rowid = ?"
SORTS = "USE TEMP B-TREE"
"""What SQLite says of a query that it sorts itself: it would hold all that the query selects."""
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
        self._num_bytes, self._num_steps = path.stat().st_size, 0
        self._meter = Meter(path, self._num_bytes)
        self._database.set_progress_handler(self._is_endless, STEPS)
        self._execute("PRAGMA trusted_schema = OFF")
        self._check_tables()
        rows = self._execute(TOPICS).fetchall()
        if len(rows) > MAX_TOPICS:
            raise InputError(f"{path}: found more than {MAX_TOPICS:,} topics, needed fewer")
        spans = self._spans({key for key, _, _ in rows})
        missing = [] if self.is_indexed else ["its end: the database is cut off or damaged"]
        if num_odd := sum(span.num_messages for (_, is_message), span in spans.items() if not is_message):
            missing.append(
                f"{num_odd:,} rows whose timestamp is not a whole number or whose data are not bytes, at most "
                f"{MAX_UNPACKED_BYTES:,}"
            )
        log = path.with_name(f"{path.name}-wal")
        if log.is_file() and (size := log.stat().st_size):
            missing.append(f"the content of {log.name}, {size:,} bytes: the recording was not closed")
        self.damage = "; ".join(missing) or None
        self._topics = {key: Topic(name, kind, spans.get((key, 1), Span())) for key, name, kind in rows}
        self.topics = list(self._topics.values())

    def messages(self, topics: Collection[Topic], start_ns: int, stop_ns: int) -> Iterator[Message]:
        """Yield the messages of some topics from `start_ns` to before `stop_ns`.

        They come in order of receipt; if the database is damaged, in the order of the file.
        """
        for topic_id, time_ns, raw in self._rows(topics, start_ns, stop_ns):
            self._meter.add(len(raw))
            # An index that is out of order leads to rows that were not asked for.
            if self._topics[topic_id] in topics and start_ns <= time_ns < stop_ns:
                yield Message(self._topics[topic_id], time_ns, raw)

    def _rows(self, topics: Collection[Topic], start_ns: int, stop_ns: int) -> Iterator[tuple[Any, ...]]:
        keys = [key for key, topic in self._topics.items() if topic in topics]
        if self.is_indexed:
            places, values = ",".join("?" * len(keys)), [start_ns, stop_ns, *keys]
            query = IN_RANGE.format("data", places)
            if not any(SORTS in plan for *_, plan in self._execute(f"EXPLAIN QUERY PLAN {query}", values)):
                yield from self._execute(query, values)
                return
            for topic_id, time_ns, row in self._execute(IN_RANGE.format("rowid", places), values):
                for (raw,) in self._database.execute(ROW, [row]):
                    yield topic_id, time_ns, raw
            return
        with suppress(sqlite3.Error):  # The damage was reported when the rows were counted.
            for topic_id, is_message, time_ns, raw in self._execute(ROWS.format("data")):
                if is_message and topic_id in keys and start_ns <= time_ns < stop_ns:
                    yield topic_id, time_ns, raw

    def _execute(self, query: str, values: Sequence[int] = ()) -> sqlite3.Cursor:
        """Execute a statement, whose instructions are counted anew."""
        self._num_steps = 0
        return self._database.execute(query, values)

    def _is_endless(self) -> bool:
        """Count instructions; return whether there are too many for the file, which interrupts the statement."""
        self._num_steps += STEPS
        return self._num_steps > MAX_SQLITE_STEPS + SQLITE_STEPS_A_BYTE * self._num_bytes

    def _check_tables(self) -> None:
        """Check that there are the tables of a recording, whose columns are stored and not computed.

        Raises:
            ValueError: there are not.
            sqlite3.Error: the file is not a database, or is too damaged.
        """
        try:
            tables = self._execute(TABLES).fetchall()
        except sqlite3.DatabaseError:
            self.is_indexed = False
            # A file that is shorter than its header says can be read only with this (sqlite.org/recovery.html).
            self._execute("PRAGMA writable_schema = ON")
            tables = self._execute(TABLES).fetchall()
        for table, needed in COLUMNS.items():
            if (table,) not in tables:
                raise ValueError("found no tables 'topics' and 'messages', as ROS 2 writes them")
            stored = {
                name for _, name, *_, hidden in self._execute(f"PRAGMA table_xinfo({table})") if not hidden
            }
            if missing := sorted(needed - stored):
                raise ValueError(
                    f"found no stored column {missing[0]!r} in the table {table!r}, as ROS 2 writes it"
                )

    def _spans(self, topic_ids: Collection[int]) -> Spans:
        """Count the rows of each topic that can be read.

        Rows are counted here and not by SQLite, which would sort them together with their data.
        """
        spans: Spans = {}
        num_rows = 0
        try:
            for topic_id, is_message, time_ns, _ in self._execute(ROWS.format("1")):
                row_span = Span(1, time_ns, time_ns) if is_message else Span(1)
                key = topic_id if is_message and topic_id in topic_ids else None, is_message
                spans[key] = spans.get(key, Span()).join(row_span)
                num_rows += 1
                if num_rows * MIN_ROW_BYTES > self._num_bytes:
                    raise ValueError(f"found more rows than {self._num_bytes:,} bytes can hold")
        except sqlite3.DatabaseError:  # What was read before the damage is kept.
            self.is_indexed = False
        return spans
