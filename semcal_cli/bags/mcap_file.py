"""An MCAP of ROS 2, also without its summary (mcap.dev/spec)."""

from __future__ import annotations

import os
import struct
from collections import Counter
from collections.abc import Iterator
from io import BytesIO
from typing import BinaryIO

from rosbags.rosbag2 import storage_mcap as mcap

from semcal_cli.bags.storage import Span, described_damage

RECORD = struct.Struct("<BQ")
"""Operation and length of a record."""
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 0x02, 0x03, 0x04, 0x05, 0x06
MESSAGE_INDEX, CHUNK_INDEX = 0x07, 0x08
MESSAGE_START = struct.Struct("<HIQ")
"""Channel, sequence and log time, with which a message starts."""
INDEX_START_BYTES, MAX_INDEX_BYTES = 6, 1 << 26
"""Channel and length, with which an index of messages starts, and its largest size."""


class McapFile(mcap.McapReader):
    """An MCAP of ROS 2."""

    damage: str | None = None
    """Description of what is missing; None if nothing is."""
    is_indexed = True
    """Whether a time can be looked up without reading all that stands before it."""

    def _open(self) -> None:
        error = None
        try:
            super()._open()
        except Exception as caught:  # Errors of any kind, see `Ros1File.open`.
            error = caught
        if error is None and any(chunk.channel_count for chunk in self.chunks):
            return  # The library counts messages by their indexes, which are optional.
        if not self.data_start:
            assert error is not None
            raise error
        missing, num_bad = self._index_again()
        if error is not None:
            self.damage = described_damage("its index", missing, num_bad)
        self.is_indexed = bool(self.chunks)

    def _index_again(self) -> tuple[int, int]:
        """Index the whole chunks of the file; return the bytes that are missing, and the number of damaged chunks."""
        file = self.bio
        assert file is not None
        size = os.fstat(file.fileno()).st_size
        for half_read in (self.schemas, self.channels, self.connections, self.chunks):
            half_read.clear()
        summary, counts, loose, num_bad = BytesIO(), list[Counter[int]](), Counter[int](), 0
        times: list[int] = []
        end, is_cut_off = self.data_start, True
        for operation, place, start, end in _records(file, self.data_start, size):
            if operation in (SCHEMA, CHANNEL):
                summary.write(_read(file, place, end))
            elif operation == MESSAGE:
                _count(_read(file, start, end), loose, times)
            elif operation == CHUNK:
                counted = _take_chunk(_read(file, start, end), place, end, summary)
                num_bad += counted is None
                counts += [] if counted is None else [counted]
            elif operation == FOOTER:
                is_cut_off = False
                break
        summary.write(RECORD.pack(FOOTER, 0))
        self.bio, self.data_end = summary, 0
        try:
            self.read_index()
        finally:
            self.bio, self.data_end = file, end
        for chunk, counted in zip(self.chunks, counts, strict=True):
            chunk.channel_count.update(counted)
        total = sum(counts, loose)
        times += [
            time for chunk in self.chunks for time in (chunk.message_start_time, chunk.message_end_time)
        ]
        first, last = (min(times), max(times)) if times else (0, 0)
        self.statistics = mcap.Statistics(
            total.total(), len(self.schemas), len(self.channels), 0, 0, len(counts), first, last, dict(total)
        )
        self.connections = [each._replace(msgcount=total[each.id]) for each in self.connections]
        return (size - end if is_cut_off else 0), num_bad

    def spans(self) -> dict[int, Span]:
        """Count the messages of each connection; without an index, the times are those of the chunks that hold them."""
        assert self.statistics is not None
        found: dict[int, Span] = {}
        of_channel: dict[int, list[mcap.ChunkInfo]] = {}
        for chunk in self.chunks:
            for key, count in chunk.channel_count.items():
                if count:
                    of_channel.setdefault(key, []).append(chunk)
        for key, chunks in of_channel.items():
            first = min(chunks, key=lambda chunk: chunk.message_start_time)
            last = max(chunks, key=lambda chunk: chunk.message_end_time)
            count = sum(chunk.channel_count[key] for chunk in chunks)
            found[key] = Span(count, self._times(first, key)[0], self._times(last, key)[1])
        if not self.chunks:
            ends = self.statistics.start_time, self.statistics.end_time
            found = {key: Span(n, *ends) for key, n in self.statistics.channel_message_counts.items()}
        return {each.id: found.get(each.id, Span(0, 0, 0)) for each in self.connections}

    def _times(self, chunk: mcap.ChunkInfo, channel: int) -> tuple[int, int]:
        """Read the first and last time of a channel in a chunk from its index; those of the chunk without an index."""
        place = chunk.message_index_offsets.get(channel)
        assert self.bio is not None
        try:
            operation, length = RECORD.unpack(_read(self.bio, place or 0, (place or 0) + RECORD.size))
            if place is None or operation != MESSAGE_INDEX or length > MAX_INDEX_BYTES:
                raise ValueError
            entries = _read(self.bio, place + RECORD.size, place + RECORD.size + length)[INDEX_START_BYTES:]
            times = [time for time, _ in struct.iter_unpack("<QQ", entries)]
            return min(times), max(times)
        except (ValueError, struct.error):
            return chunk.message_start_time, chunk.message_end_time


def _records(file: BinaryIO, place: int, size: int) -> Iterator[tuple[int, int, int, int]]:
    """Yield operation, place, start and end of the content of each whole record."""
    while place + RECORD.size <= size:
        operation, length = RECORD.unpack(_read(file, place, place + RECORD.size))
        start = place + RECORD.size
        if start + length > size:
            return
        yield operation, place, start, start + length
        place = start + length


def _take_chunk(content: bytes, place: int, end: int, summary: BytesIO) -> Counter[int] | None:
    """Add the schemas and channels of a chunk, and the chunk, to a summary; return the messages of each channel."""
    counts, times = Counter[int](), list[int]()
    try:
        *_, size, crc = mcap.deserialize_qqqi(content[:28])
        rest = BytesIO(content[28:])
        compression = mcap.read_string(rest)
        (num_bytes,) = mcap.deserialize_uint64(mcap.read_exact(rest, 8))
        records = BytesIO(
            mcap.decompress(mcap.read_exact(rest, num_bytes), compression, size, crc & 0xFFFFFFFF)
        )
        found = BytesIO()
        for operation, inner, start, stop in _records(records, 0, size):
            if operation in (SCHEMA, CHANNEL):
                found.write(_read(records, inner, stop))
            elif operation == MESSAGE:
                _count(_read(records, start, start + MESSAGE_START.size), counts, times)
    except Exception:  # Errors of any kind, see `Ros1File.open`.
        return None
    name = compression.encode()
    index = struct.pack("<QQQQIQ", min(times, default=0), max(times, default=0), place, end - place, 0, 0)
    index += struct.pack("<I", len(name)) + name + struct.pack("<QQ", num_bytes, size)
    summary.write(found.getvalue() + RECORD.pack(CHUNK_INDEX, len(index)) + index)
    return counts


def _count(message: bytes, counts: Counter[int], times: list[int]) -> None:
    channel, _, time = MESSAGE_START.unpack_from(message)
    counts[channel] += 1
    times.append(time)


def _read(file: BinaryIO, start: int, end: int) -> bytes:
    file.seek(start)
    return file.read(end - start)
