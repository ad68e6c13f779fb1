"""Reader of MCAP files, with or without their summary (mcap.dev/spec)."""

from __future__ import annotations

import re
import struct
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack
from heapq import heappop, heappush
from io import BytesIO
from pathlib import Path
from typing import IO
from zlib import crc32

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, RecordLengthLimitExceeded
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, McapRecord, Message as McapMessage, MessageIndex, Schema
from mcap.stream_reader import StreamReader
from mcap.summary import Summary

from semcal_cli.config.file_limits import (
    MAX_CHUNK_DEFINITIONS,
    MAX_CHUNK_RECORDS,
    MAX_HELD_BYTES,
    MAX_SUMMARY_BYTES,
    MAX_UNPACKED_BYTES,
)
from semcal_cli.errors import InputError
from semcal_cli.files.input_files import open_file, size_of
from semcal_cli.importing.bags.foxglove import reader
from semcal_cli.importing.bags.messages import Message, Span, Topic
from semcal_cli.importing.bags.unpacking import Meter, unpack

MAGIC_BYTES = 8
MESSAGE = int(Opcode.MESSAGE)
RECORDS: dict[int, type[Schema] | type[Channel]] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel}
"""Kinds of the records of a chunk: messages, as a number that is compared faster, and others."""
MAX_INDEX_BYTES = 1 << 26
"""Largest size of the indexes of a chunk that are read."""
RECORD_HEAD, MESSAGE_HEAD = struct.Struct("<BQ"), struct.Struct("<HIQQ")
"""Head of a record, and of a message in it: channel, sequence, time of receipt and of publication."""
FOOTER = struct.Struct("<BQQQI8s")
"""The last record with the final magic bytes; its third number is where the summary begins."""


class McapFile:
    """An MCAP of ROS 1, of ROS 2, or of Foxglove's schemas."""

    def __init__(self, path: Path, stack: ExitStack) -> None:
        """Open the file, until `stack` closes it, and read its index, or all of it if there is none.

        The library raises errors of any kind if the file is not an MCAP.
        """
        self._path = path
        self._file = stack.enter_context(open_file(path))
        self._size = size_of(self._file)
        self.damage: str | None = None
        self._topics: dict[int, Topic] = {}
        self._chunks: list[ChunkIndex] = []
        self._times: dict[int, dict[int, tuple[int, int]]] = {}
        self._missing, self._num_bad = 0, 0
        self._meter = Meter(path, self._size)
        library = SeekingReader(self._file, validate_crcs=True, record_size_limit=self._size)
        library.get_header()
        is_whole, summary = True, None
        try:
            is_whole = not self._has_large_summary()
            summary = library.get_summary() if is_whole else None
        except Exception:  # Hostile bytes raise errors of any kind in the library.
            is_whole = False
        self.is_indexed = summary is not None and _is_index(summary)
        if summary is not None and self.is_indexed:
            self._take_index(summary)
        else:
            self._count(is_whole)
        self.topics = list(self._topics.values())

    def messages(self, topics: Collection[Topic], start_ns: int, stop_ns: int) -> Iterator[Message]:
        """Yield the messages of some topics from `start_ns` to before `stop_ns`.

        They come in order of receipt; without an index, in the order of the file.

        Raises:
            ValueError: a chunk is damaged, or too large; without an index, those are left out.
        """
        channels = {key for key, topic in self._topics.items() if topic in topics}
        records = self._indexed(channels, start_ns, stop_ns) if self.is_indexed else self._records(channels)
        for record in records:
            if (
                isinstance(record, McapMessage)
                and record.channel_id in channels
                and start_ns <= record.log_time < stop_ns
            ):
                yield Message(self._topics[record.channel_id], record.log_time, record.data)

    def _indexed(self, channels: Collection[int], start_ns: int, stop_ns: int) -> Iterator[McapRecord]:
        """Yield the messages of the chunks that hold some channels at some time, in order of receipt."""
        chunks = [
            chunk
            for chunk in self._chunks
            if chunk.message_start_time < stop_ns
            and chunk.message_end_time >= start_ns
            and (
                not chunk.message_index_offsets or not chunk.message_index_offsets.keys().isdisjoint(channels)
            )
        ]
        heap: list[tuple[int, int, int, McapMessage]] = []
        num_held = 0
        for chunk_number, chunk in enumerate(sorted(chunks, key=lambda chunk: chunk.message_start_time)):
            while heap and heap[0][0] < chunk.message_start_time:
                earliest = heappop(heap)[-1]
                num_held -= len(earliest.data)
                yield earliest
            self._file.seek(chunk.chunk_start_offset)
            record = next(self._reader(self._file).records)
            if not isinstance(record, Chunk):
                raise ValueError("found no chunk where the index has one")
            for index, message in enumerate(self._chunk_records(record, channels)):
                if isinstance(message, McapMessage):
                    heappush(heap, (message.log_time, chunk_number, index, message))
                    num_held += len(message.data)
            if num_held > MAX_HELD_BYTES + MAX_UNPACKED_BYTES:
                held = f"chunks of the same time with more than {num_held:,} bytes of messages"
                raise InputError(f"{self._path}: found {held}, needed fewer: `mcap sort` sorts a recording")
        while heap:
            yield heappop(heap)[-1]

    def _reader(self, file: IO[bytes]) -> StreamReader:
        """Read the records from here on. A chunk is one record, so that it is unpacked up to a limit."""
        return StreamReader(
            file, skip_magic=True, emit_chunks=True, validate_crcs=True, record_size_limit=self._size
        )

    def _take_index(self, summary: Summary) -> None:
        """Take the topics of a summary, with the times of messages from the indexes of their chunks."""
        assert summary.statistics is not None
        self._chunks = summary.chunk_indexes
        chunks_of: dict[int, list[ChunkIndex]] = {channel: [] for channel in summary.channels}
        for chunk in summary.chunk_indexes:
            for channel in chunk.message_index_offsets or summary.channels:
                chunks_of.setdefault(channel, []).append(chunk)
        for channel, record in summary.channels.items():
            count, span = summary.statistics.channel_message_counts.get(channel, 0), Span()
            if count and chunks_of[channel]:
                span = Span(count, *self._ends_ns(channel, chunks_of[channel]))
            self._topics[channel] = _topic(record, summary.schemas, span)

    def _ends_ns(self, channel: int, chunks: Sequence[ChunkIndex]) -> tuple[int, int]:
        """Find the times of the first and the last message of a channel, from the chunks that can hold them."""
        first_end = min(chunk.message_end_time for chunk in chunks)
        last_start = max(chunk.message_start_time for chunk in chunks)
        ends = []
        for chunk in chunks:
            if chunk.message_start_time <= first_end or chunk.message_end_time >= last_start:
                if chunk.chunk_start_offset not in self._times:
                    self._times[chunk.chunk_start_offset] = self._read_times(chunk)
                chunk_ends = chunk.message_start_time, chunk.message_end_time
                ends.append(self._times[chunk.chunk_start_offset].get(channel, chunk_ends))
        return min(first for first, _ in ends), max(last for _, last in ends)

    def _read_times(self, chunk: ChunkIndex) -> dict[int, tuple[int, int]]:
        """Read the first and the last time of each channel in a chunk; none without a whole index."""
        self._file.seek(min(chunk.message_index_offsets.values(), default=0))
        content = BytesIO(self._file.read(min(chunk.message_index_length, MAX_INDEX_BYTES)))
        times_by_channel: dict[int, tuple[int, int]] = {}
        try:
            for record in StreamReader(content, skip_magic=True).records:
                if isinstance(record, MessageIndex) and record.records:
                    times = [time for time, _ in record.records]
                    times_by_channel[record.channel_id] = min(times), max(times)
        except Exception:  # The end of what was read, or hostile bytes.
            pass
        return times_by_channel

    def _count(self, is_whole: bool) -> None:
        """Read the whole file for its topics, their times, and what is missing."""
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        spans: dict[int, Span] = {}
        for record in self._records():
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, McapMessage):
                time = record.log_time
                spans[record.channel_id] = spans.get(record.channel_id, Span()).join(Span(1, time, time))
        for key, channel in channels.items():
            self._topics[key] = _topic(channel, schemas, spans.get(key, Span()))
        missing = [] if is_whole else ["its index"]
        missing += [f"the last {self._missing:,} bytes, which are incomplete"] if self._missing else []
        missing += [f"{self._num_bad:,} damaged chunks"] if self._num_bad else []
        self.damage = ", ".join(missing) or None

    def _has_large_summary(self) -> bool:
        """Return whether there is a summary that is too large to be read into memory."""
        if self._size < FOOTER.size:
            return False
        self._file.seek(self._size - FOOTER.size)
        kind, _, start, *_ = FOOTER.unpack(self._file.read(FOOTER.size))
        return bool(kind == Opcode.FOOTER and 0 < start < self._size - MAX_SUMMARY_BYTES)

    def _chunk_records(self, chunk: Chunk, channels: Collection[int] | None) -> Iterator[McapRecord]:
        """Yield the schemas and channels of a chunk, and then its messages, if all of it is whole.

        It is unpacked up to the size that it states.

        Args:
            chunk: The chunk.
            channels: Channels whose messages are yielded; None for all.

        Raises:
            ValueError: it states more bytes than are allowed, holds more than it states, is damaged, or has too many
                records.
            InputError: more was unpacked in all than is allowed.
        """
        if chunk.uncompressed_size > MAX_UNPACKED_BYTES:
            problem = f"found a chunk that states {chunk.uncompressed_size:,} bytes"
            raise ValueError(f"{problem}, needed at most {MAX_UNPACKED_BYTES:,}")
        self._meter.add(chunk.uncompressed_size)
        data = unpack(chunk.compression, chunk.data, chunk.uncompressed_size)
        if chunk.uncompressed_crc and crc32(data) != chunk.uncompressed_crc:
            raise ValueError("found a chunk whose checksum is wrong")
        definitions, num_records = [], 0
        try:
            for kind, start, end in _records_in(data):
                num_records += 1
                if num_records > MAX_CHUNK_RECORDS:
                    raise ValueError(f"found a chunk of more than {MAX_CHUNK_RECORDS:,} records")
                if end > len(data):
                    raise ValueError("found a record that goes beyond its chunk")
                if kind == MESSAGE and end - start < MESSAGE_HEAD.size:
                    raise ValueError(
                        f"found a message of {end - start} bytes, needed {MESSAGE_HEAD.size} or more"
                    )
                if kind in RECORDS:
                    definitions.append(_definition(kind, data[start:end]))
                    if len(definitions) > MAX_CHUNK_DEFINITIONS:
                        problem = f"a chunk of more than {MAX_CHUNK_DEFINITIONS:,} schemas and channels"
                        raise ValueError(f"found {problem}")
        finally:
            self._meter.add(0, num_records)
        yield from definitions
        for kind, start, end in _records_in(data):
            if kind == MESSAGE:
                channel, sequence, log_time, publish_time = MESSAGE_HEAD.unpack_from(data, start)
                if channels is None or channel in channels:
                    content = data[start + MESSAGE_HEAD.size : end]
                    yield McapMessage(channel, log_time, content, publish_time, sequence)

    def _records(self, channels: Collection[int] | None = None) -> Iterator[McapRecord]:
        """Yield the records of the file, and those of its whole chunks, in their order."""
        self._missing, self._num_bad, end = 0, 0, MAGIC_BYTES
        with open_file(self._path) as file:
            file.seek(end)
            while True:
                try:
                    for record in self._reader(file).records:
                        if isinstance(record, Chunk):
                            yield from self._chunk_records(record, channels)
                        else:
                            self._meter.add(0)
                            yield record
                        end = file.tell()
                    return
                except InputError:
                    raise
                except (EndOfFile, RecordLengthLimitExceeded, struct.error):
                    self._missing = self._size - end
                    return
                except Exception:  # A chunk that cannot be unpacked; the next record follows it.
                    self._num_bad += 1


def _is_index(summary: Summary) -> bool:
    """Return whether a summary has all that is needed to read by it."""
    if summary.statistics is None or not summary.chunk_indexes:
        return False
    if len({chunk.chunk_start_offset for chunk in summary.chunk_indexes}) < len(summary.chunk_indexes):
        return False
    used_channels = set(summary.statistics.channel_message_counts)
    used_channels |= {channel for chunk in summary.chunk_indexes for channel in chunk.message_index_offsets}
    known_channels = {
        key for key, channel in summary.channels.items() if channel.schema_id in (0, *summary.schemas)
    }
    return used_channels <= known_channels


def _records_in(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield the kind of each record, and where its content starts and ends."""
    end = 0
    while end + RECORD_HEAD.size <= len(data):
        kind, length = RECORD_HEAD.unpack_from(data, end)
        start = end + RECORD_HEAD.size
        end = start + length
        yield kind, start, end


def _definition(kind: int, content: bytes) -> Schema | Channel:
    """Read a schema or a channel.

    Raises:
        ValueError: it is damaged.
    """
    try:
        definition: Schema | Channel = RECORDS[kind].read(ReadDataStream(BytesIO(content)))
    except Exception as error:  # Hostile bytes raise errors of any kind in the library.
        raise ValueError("found a damaged schema or channel") from error
    return definition


def _topic(channel: Channel, schemas: dict[int, Schema], span: Span) -> Topic:
    schema = schemas.get(channel.schema_id)
    name = "" if schema is None else schema.name
    match channel.message_encoding:
        case "cdr":
            return Topic(channel.topic, name, span)
        case "ros1":
            return Topic(channel.topic, re.sub(r"^(\w+)/(\w+)$", r"\1/msg/\2", name), span, is_ros1=True)
        case "protobuf" | "json" as encoding if schema is not None:
            kind, decode = reader(encoding, schema)
            return Topic(channel.topic, name, span, kind=kind, decode=decode)
    return Topic(channel.topic, f"{name} in {channel.message_encoding}", span)
