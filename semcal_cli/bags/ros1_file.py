"""A `.bag` of ROS 1, also without its index."""

from __future__ import annotations

import os
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Collection, Generator
from contextlib import suppress
from io import BytesIO
from typing import BinaryIO

from rosbags.interfaces import Connection
from rosbags.rosbag1 import reader as ros1

from semcal_cli.bags.storage import MAX_STAMP_NS, Span, described_damage

LENGTHS_BYTES = 8
"""Two lengths, of a record's header and of its data."""


class Ros1File(ros1.Reader):
    """A `.bag`."""

    damage: str | None = None
    """Description of what is missing; None if nothing is."""
    is_indexed = True
    """Whether a time can be looked up without reading all that stands before it."""

    def open(self) -> None:
        """Open the bag; index its whole chunks if its index is missing or damaged."""
        try:
            super().open()
        except OSError:
            raise
        except Exception as error:  # Hostile bytes raise errors of any kind in the library.
            self._index_again(error)

    def _index_again(self, error: Exception) -> None:
        self.bio = self.path.open("rb")
        size = os.fstat(self.bio.fileno()).st_size
        try:
            if not self.bio.readline(64).startswith(b"#ROSBAG V2.0"):
                raise error
            found: dict[int, Connection] = {}
            indexes: dict[int, list[ros1.IndexData]] = defaultdict(list)
            num_bad, end = 0, self.bio.tell()
            while (record := _record(self.bio, end, size)) is not None:
                header, data_start, end = record
                if header.get("op") == bytes([ros1.RecordType.CHUNK]):
                    num_bad += not self._take_chunk(header, data_start, end, found, indexes)
            if not found:
                raise error
        except BaseException:
            with suppress(Exception):
                self.close()
            raise
        self.indexes = {key: sorted(indexes[key]) for key in found}
        self.connections = [each._replace(msgcount=len(indexes[key])) for key, each in found.items()]
        self.damage = described_damage("its index", size - end, num_bad)

    def _take_chunk(
        self,
        header: ros1.Header,
        start: int,
        end: int,
        found: dict[int, Connection],
        indexes: dict[int, list[ros1.IndexData]],
    ) -> bool:
        """Index the messages of a chunk; return whether it is whole."""
        file = self.bio
        assert file is not None
        try:
            chunk = ros1.Chunk(end - start, start, ros1.decompressors[header.get_string("compression")])
            file.seek(start)
            content = chunk.decompressor(file.read(end - start))
            inside: dict[int, list[ros1.IndexData]] = defaultdict(list)
            records, place = BytesIO(content), 0
            while (record := _record(records, place, len(content))) is not None:
                inner, _, next_place = record
                if inner.get_uint8("op") == ros1.RecordType.CONNECTION:
                    self.bio = BytesIO(content[place:next_place])
                    connection = self.read_connection()
                    found.setdefault(connection.id, connection)
                elif inner.get_uint8("op") == ros1.RecordType.MSGDATA:
                    entry = ros1.IndexData(inner.get_time("time"), start, place)
                    inside[inner.get_uint32("conn")].append(entry)
                place = next_place
        except Exception:  # Errors of any kind, see `open`.
            return False
        finally:
            self.bio = file
        self.chunks[start] = chunk
        for key, entries in inside.items():
            indexes[key] += entries
        return True

    def messages(
        self, connections: Collection[Connection] = (), start: int | None = None, stop: int | None = None
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Yield connection, time and bytes of messages, in order of time; earlier ones are skipped by bisection."""
        whole, low, high = self.indexes, start or 0, MAX_STAMP_NS if stop is None else stop
        self.indexes = {
            key: each[bisect_left(each, low, key=_time) : bisect_left(each, high, key=_time)]
            for key, each in whole.items()
        }
        try:
            found = super().messages(connections)
            first = next(found, None)  # The library takes hold of the indexes here.
        finally:
            self.indexes = whole
        if first is not None:
            yield first
            yield from found

    def spans(self) -> dict[int, Span]:
        """Count the messages of each connection."""
        return {
            key: Span(len(each), each[0].time, each[-1].time) if each else Span(0, 0, 0)
            for key, each in self.indexes.items()
        }


def _time(entry: ros1.IndexData) -> int:
    return entry.time


def _record(file: BinaryIO, place: int, size: int) -> tuple[ros1.Header, int, int] | None:
    """Read the header of the record at a place, with the start and end of its data; None if it is not whole."""
    file.seek(place)
    if place + LENGTHS_BYTES > size:
        return None
    try:
        length = ros1.read_uint32(file)
        if place + LENGTHS_BYTES + length > size:
            return None
        file.seek(place)
        header = ros1.Header.read(file)
        num_bytes = ros1.read_uint32(file)
    except Exception:  # Errors of any kind, see `Ros1File.open`.
        return None
    start = file.tell()
    return None if start + num_bytes > size else (header, start, start + num_bytes)
