"""Reader of `.bag` files of ROS 1, by their index (wiki.ros.org/Bags/Format/2.0).

The index is read once and held as arrays, and each message where the index says, so that a hostile index takes no more
memory and time than its size.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Collection, Iterator
from contextlib import ExitStack
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli.config.file_limits import (
    MAX_CONNECTIONS,
    MAX_INDEX_ENTRIES,
    MAX_RECORD_FIELDS,
    MAX_RECORD_HEADER,
    MAX_UNPACKED_BYTES,
)
from semcal_cli.config.nanoseconds import NS
from semcal_cli.errors import InputError
from semcal_cli.files.input_files import open_file, size_of
from semcal_cli.importing.bags.messages import Message, Span, Topic
from semcal_cli.importing.bags.unpacking import Meter, unpack

VERSION = b"#ROSBAG V2.0\n"
MESSAGE, BAG, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7
"""Kinds of records, `op` of their headers."""
WHOLE = {1: struct.Struct("<B"), 4: struct.Struct("<I"), 8: struct.Struct("<Q")}
TIME = struct.Struct("<II")
ENTRY = np.dtype([("seconds", "<u4"), ("nanoseconds", "<u4"), ("offset", "<u4")])
"""An entry of the index: the time of receipt of a message, and its place in the chunk."""
MAX_BETWEEN = 100
"""Maximum number of records between the place that the index states and the message."""
Fields = dict[bytes, bytes]


class _Chunk(NamedTuple):
    """A part of the file with messages."""

    compression: str
    place: int
    """Where its data begin."""
    num_bytes: int
    """Size of its data in the file."""


class _Index(NamedTuple):
    """The messages of a connection, in order of receipt."""

    times_ns: npt.NDArray[np.int64]
    chunks: npt.NDArray[np.int64]
    """Number of the chunk of each."""
    offsets: npt.NDArray[np.int64]


class Ros1File:
    """A `.bag`."""

    damage: str | None = None
    is_indexed = True

    def __init__(self, path: Path, stack: ExitStack) -> None:
        """Open the bag, until `stack` closes it.

        Raises:
            ValueError: its index is not whole, or is missing.
            InputError: its index has too many messages or connections.
        """
        self._path, self._file = path, stack.enter_context(open_file(path))
        self._size = size_of(self._file)
        self._meter = Meter(path, self._size)
        self._chunks: list[_Chunk] = []
        self._unpacked: tuple[int, bytes] = -1, b""
        if self._file.read(len(VERSION)) != VERSION:
            raise ValueError("found another version of ROS 1's format, needed 2.0")
        header, _ = _record(self._file, BAG)
        if header.get(b"encryptor"):
            raise ValueError("found an encrypted recording")
        place, num_connections, num_chunks = (
            _whole(header, name) for name in (b"index_pos", b"conn_count", b"chunk_count")
        )
        if not place:
            raise ValueError("found no index")
        if num_connections > MAX_CONNECTIONS:
            raise InputError(
                f"{path}: found {num_connections:,} connections, needed at most {MAX_CONNECTIONS:,}"
            )
        self._file.seek(place)
        self._topics = dict(self._connection() for _ in range(num_connections))
        self._indexes = self._read_indexes([self._chunk_place() for _ in range(num_chunks)])
        spans: dict[Topic, Span] = {}
        for key, topic in self._topics.items():
            times = self._indexes[key].times_ns if key in self._indexes else np.empty(0, np.int64)
            span = Span(len(times), int(times[0]), int(times[-1])) if len(times) else Span()
            spans[topic] = spans.get(topic, Span()).join(span)
        self.topics = [Topic(topic.name, topic.type, span, is_ros1=True) for topic, span in spans.items()]

    def messages(self, topics: Collection[Topic], start_ns: int, stop_ns: int) -> Iterator[Message]:
        """Yield the messages of some topics from `start_ns` to before `stop_ns`, in the order of receipt.

        Raises:
            ValueError: a chunk or a message is damaged, or too large.
            InputError: more is read in all than is allowed.
        """
        parts, keys = [], [key for key, topic in self._topics.items() if topic in topics]
        for key in keys:
            if key in self._indexes:
                index = self._indexes[key]
                first, last = np.searchsorted(index.times_ns, [start_ns, stop_ns])
                parts.append(_Index(*(column[first:last] for column in index)))
        if not parts:
            return
        times, chunks, offsets = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        for entry in np.argsort(times, kind="stable").tolist():
            time_ns = int(times[entry])
            key, raw = self._message(int(chunks[entry]), int(offsets[entry]), time_ns)
            if key not in keys:
                raise ValueError("found a message of another topic than the index states")
            yield Message(self._topics[key], time_ns, raw)

    def _connection(self) -> tuple[int, Topic]:
        """Read a connection: its number and its topic."""
        header, length = _record(self._file, CONNECTION)
        if length > MAX_UNPACKED_BYTES:
            raise ValueError(f"found a connection of {length:,} bytes, needed at most {MAX_UNPACKED_BYTES:,}")
        kind = _fields(_exactly(self._file, length))[b"type"].decode()
        name = re.sub("(?<=.)/+$", "", re.sub("/+", "/", header[b"topic"].decode()))
        kind = re.sub(r"^(\w+)/(\w+)$", r"\1/msg/\2", kind)
        return _whole(header, b"conn"), Topic(name, kind, is_ros1=True)

    def _chunk_place(self) -> tuple[int, int]:
        """Read where a chunk begins, and the number of connections in it."""
        header, length = _record(self._file, CHUNK_INFO)
        self._file.seek(length, 1)
        return _whole(header, b"chunk_pos"), _whole(header, b"count")

    def _read_indexes(self, places: list[tuple[int, int]]) -> dict[int, _Index]:
        """Read the index behind each chunk, by connections."""
        parts: dict[int, list[_Index]] = {}
        num_entries = num_bytes = 0
        for number, (place, num_connections) in enumerate(places):
            self._file.seek(place)
            header, length = _record(self._file, CHUNK)
            compression = header[b"compression"].decode()
            self._chunks.append(_Chunk(compression, self._file.tell(), length))
            self._file.seek(length, 1)
            for _ in range(num_connections):
                start = self._file.tell()
                header, length = _record(self._file, INDEX)
                num_bytes += self._file.tell() - start + length
                num_entries += length // ENTRY.itemsize
                if num_entries > MAX_INDEX_ENTRIES:
                    found = f"an index of more than {MAX_INDEX_ENTRIES:,} messages"
                    raise InputError(
                        f"{self._path}: found {found}, needed fewer: `rosbag filter` keeps some topics"
                    )
                if num_bytes > self._size:
                    raise InputError(
                        f"{self._path}: found an index that is used several times, expected one a chunk"
                    )
                entries = np.frombuffer(_exactly(self._file, length), ENTRY)
                times_ns = entries["seconds"].astype(np.int64) * NS + entries["nanoseconds"]
                chunks = np.full(len(entries), number)
                index = _Index(times_ns, chunks, entries["offset"].astype(np.int64))
                parts.setdefault(_whole(header, b"conn"), []).append(index)
        indexes = {}
        for key, pieces in parts.items():
            joined = [np.concatenate(columns) for columns in zip(*pieces, strict=True)]
            order = np.argsort(joined[0], kind="stable")
            indexes[key] = _Index(*(column[order] for column in joined))
        return indexes

    def _message(self, number: int, offset: int, time_ns: int) -> tuple[int, bytes]:
        """Read a message: its connection and its bytes."""
        chunk = self._chunks[number]
        source: BinaryIO
        if chunk.compression == "none":
            source, end = self._file, chunk.place + chunk.num_bytes
            source.seek(chunk.place + offset)
        else:
            data = self._unpack(number)
            source, end = BytesIO(data), len(data)
            source.seek(offset)
        for _ in range(MAX_BETWEEN):
            header, length = _record(source)
            self._meter.add(length)
            if source.tell() + length > end or length > MAX_UNPACKED_BYTES:
                raise ValueError("found a message that is cut off or too large")
            if (kind := _whole(header, b"op")) == MESSAGE:
                if _time_ns(header) != time_ns:
                    raise ValueError("found a message of another time than the index states")
                return _whole(header, b"conn"), _exactly(source, length)
            if kind != CONNECTION:
                break
            source.seek(length, 1)
        raise ValueError("found no message where the index has one")

    def _unpack(self, number: int) -> bytes:
        """Unpack a chunk, and count it; the last one is kept."""
        if self._unpacked[0] != number:
            chunk = self._chunks[number]
            if chunk.num_bytes > MAX_UNPACKED_BYTES:
                raise ValueError(
                    f"found a chunk of {chunk.num_bytes:,} bytes, needed at most {MAX_UNPACKED_BYTES:,}"
                )
            self._file.seek(chunk.place)
            data = unpack(chunk.compression, _exactly(self._file, chunk.num_bytes))
            self._meter.add(len(data))
            self._unpacked = number, data
        return self._unpacked[1]


def _record(file: BinaryIO, kind: int | None = None) -> tuple[Fields, int]:
    """Read the header of a record and the length of its data, which follow.

    Raises:
        ValueError: it is damaged, or of another kind.
    """
    (length,) = WHOLE[4].unpack(_exactly(file, 4))
    if length > MAX_RECORD_HEADER:
        raise ValueError(
            f"found the header of a record of {length:,} bytes, needed at most {MAX_RECORD_HEADER:,}"
        )
    header = _fields(_exactly(file, length))
    if kind is not None and _whole(header, b"op") != kind:
        raise ValueError("found a record of another kind than the index states")
    (length,) = WHOLE[4].unpack(_exactly(file, 4))
    return header, length


def _fields(header: bytes) -> Fields:
    """Read the fields of a header, each with its length before it."""
    fields: Fields = {}
    place = 0
    while place < len(header):
        (length,) = WHOLE[4].unpack_from(header, place)
        name, equals, value = header[place + 4 : place + 4 + length].partition(b"=")
        place += 4 + length
        if not equals or place > len(header) or len(fields) == MAX_RECORD_FIELDS:
            raise ValueError("found a damaged header of a record")
        fields[name] = value
    return fields


def _whole(header: Fields, name: bytes) -> int:
    """Read a whole number of a header."""
    value = header.get(name, b"")
    if len(value) not in WHOLE:
        raise ValueError(f"found no {name.decode()} in the header of a record")
    number: int = WHOLE[len(value)].unpack(value)[0]
    return number


def _time_ns(header: Fields) -> int:
    seconds, nanoseconds = TIME.unpack(header.get(b"time", b""))
    return int(seconds * NS + nanoseconds)


def _exactly(file: BinaryIO, num_bytes: int) -> bytes:
    content = file.read(num_bytes)
    if len(content) < num_bytes:
        raise ValueError("found a record that is cut off")
    return content
