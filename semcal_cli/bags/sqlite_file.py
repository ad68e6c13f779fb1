"""A `.db3` of ROS 2, also cut off, and a folder of such files."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Generator
from contextlib import suppress
from pathlib import Path
from typing import Any

import apsw
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from semcal_cli.bags.storage import Span


class SqliteFile(Sqlite3Reader):
    """A `.db3` of ROS 2."""

    damage: str | None = None
    """Description of what is missing; None if nothing is."""
    is_indexed = True
    """Whether a time can be looked up without reading all that stands before it."""

    def __init__(self, path: Any) -> None:
        super().__init__(path)
        self._rows: list[tuple[int, int, int]] | None = None

    def open(self) -> None:
        """Open the database; list its readable rows if it is damaged."""
        try:
            super().open()
        except Exception as error:  # Errors of any kind, see `Ros1File.open`.
            self._list_rows(error)
        log = Path(f"{self.path}-wal")
        if log.is_file() and (size := log.stat().st_size):
            more = f"what stands in {log.name}, {size:,} bytes: the recording was not closed"
            self.damage = more if self.damage is None else f"{self.damage}; {more}"

    def _list_rows(self, error: Exception) -> None:
        self.dbconn = apsw.Connection(
            f"file:{self.path}?immutable=1", flags=apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI
        )
        rows: list[tuple[int, int, int]] = []
        try:
            # A file that is shorter than its header says can be read with this alone (sqlite.org/recovery.html).
            self.dbconn.execute("PRAGMA writable_schema = ON")
            topics = list(self.dbconn.execute("SELECT id, name, type, serialization_format FROM topics"))
            with suppress(apsw.Error):  # What was read before the damage stays in `rows`.
                for row in self.dbconn.execute("SELECT id, topic_id, timestamp FROM messages NOT INDEXED"):
                    rows.append(row)
        except apsw.Error:
            self.close()
            raise error from None
        counts = Counter(topic for _, topic, _ in rows)
        nothing = MessageDefinition(MessageDefinitionFormat.NONE, "")
        self.connections = [
            Connection(key, name, kind, nothing, "", counts[key], ConnectionExtRosbag2(encoding, []), self)
            for key, name, kind, encoding in topics
        ]
        self._rows = sorted(rows, key=lambda row: row[2])
        self.damage = "its end, for the database is cut off or damaged"

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Yield connection, time and bytes of messages, in order of time."""
        if self._rows is None:
            yield from super().messages(connections, start, stop)
            return
        assert self.dbconn is not None
        wanted = {each.id: each for each in connections}
        for row, topic, time in self._rows:
            if topic in wanted and (start is None or start <= time) and (stop is None or time < stop):
                with suppress(apsw.Error):
                    ((data,),) = self.dbconn.execute("SELECT data FROM messages WHERE id = ?", (row,))
                    yield wanted[topic], time, data

    def spans(self) -> dict[int, Span]:
        """Count the messages of each connection."""
        assert self.dbconn is not None
        rows: Any = self._rows
        if rows is not None:
            times = defaultdict(list)
            for _, topic, time in rows:
                times[topic].append(time)
            found = {topic: Span(len(each), each[0], each[-1]) for topic, each in times.items()}
        else:
            numbers = "count(*), CAST(min(timestamp) AS INTEGER), CAST(max(timestamp) AS INTEGER)"
            query = f"SELECT CAST(topic_id AS INTEGER), {numbers} FROM messages GROUP BY topic_id"
            found = {key: Span(*values) for key, *values in self.dbconn.execute(query)}
        return {each.id: found.get(each.id, Span(0, 0, 0)) for each in self.connections}
