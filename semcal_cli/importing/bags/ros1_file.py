"""Reader of `.bag` files of ROS 1, by their index."""

from __future__ import annotations

import bz2
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import lz4.frame
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader

from semcal_cli.importing.bags.messages import Message, Span, Topic
from semcal_cli.importing.bags.unpacking import Meter, unpack

COMPRESSIONS = {bz2.decompress: "bz2", lz4.frame.decompress: "lz4"}
"""Compressions of chunks, by the library's functions, which would unpack them to any size."""


class Ros1File:
    """A `.bag`."""

    damage: str | None = None
    is_indexed = True

    def __init__(self, path: Path, stack: ExitStack) -> None:
        """Open the bag, until `stack` closes it; raises errors of any kind if its index is not whole."""
        self._reader = stack.enter_context(Reader(path))
        self._meter = Meter(path, path.stat().st_size)
        for offset, chunk in self._reader.chunks.items():
            name = COMPRESSIONS.get(chunk.decompressor)
            if name is not None:
                self._reader.chunks[offset] = chunk._replace(decompressor=partial(self._unpack, name))
        connections: dict[tuple[str, str], list[Connection]] = {}
        for connection in self._reader.connections:
            connections.setdefault((connection.topic, connection.msgtype), []).append(connection)
        self.topics = [Topic(*key, self._span(group), is_ros1=True) for key, group in connections.items()]

    def messages(self, topics: Collection[Topic], start_ns: int, stop_ns: int) -> Iterator[Message]:
        """Yield the messages of some topics from `start_ns` to before `stop_ns`, in the order of receipt."""
        connections = [
            connection
            for connection in self._reader.connections
            if Topic(connection.topic, connection.msgtype, is_ros1=True) in topics
        ]
        for connection, received_ns, raw in self._reader.messages(connections, start_ns, stop_ns):
            self._meter.add(len(raw))
            yield Message(Topic(connection.topic, connection.msgtype, is_ros1=True), received_ns, raw)

    def _unpack(self, compression: str, packed: bytes) -> bytes:
        """Unpack a chunk, and count it."""
        unpacked = unpack(compression, packed)
        self._meter.add(len(unpacked))
        return unpacked

    def _span(self, connections: Sequence[Connection]) -> Span:
        """Count messages and find their times in the index, without unpacking chunks."""
        times = [entry.time for connection in connections for entry in self._reader.indexes[connection.id]]
        return Span(len(times), min(times), max(times)) if times else Span()
