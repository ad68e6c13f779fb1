"""A recording: one or several files of ROS as one series of messages."""

from __future__ import annotations

import heapq
import os
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.storage_mcap import DECOMPRESSORS

from semcal_cli.bags.mcap_file import McapFile
from semcal_cli.bags.messages import NS, Message
from semcal_cli.bags.ros1_file import Ros1File
from semcal_cli.bags.sqlite_file import SqliteFile
from semcal_cli.bags.storage import Span, Storage
from semcal_cli.errors import InputError
from semcal_cli.files.reading import is_folder, read_start

MAGIC: dict[bytes, type[Any]] = {
    b"#ROSBAG V": Ros1File,
    b"\x89MCAP0\r\n": McapFile,
    b"SQLite format 3\0": SqliteFile,
}
"""Readers by the first bytes of a file."""
SUFFIXES = (".bag", ".mcap", ".db3")
METADATA = "metadata.yaml"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
"""First bytes of a message of ROS 2 that is compressed by itself; others start with CDR's 0."""
STEP_NS = NS // 2
"""How far behind damaged messages reading goes on; it doubles until there is something to read."""


class Folder(DirectoryReader):
    """A folder of ROS 2 with its `metadata.yaml`: several files, which may be compressed, or whose messages may be."""

    STORAGE_PLUGINS: Any = {"mcap": McapFile, "sqlite3": SqliteFile}


@dataclass(frozen=True)
class Topic:
    """A topic of a recording."""

    name: str
    """Name of the topic."""
    type: str
    """Name of the type of its messages."""
    span: Span
    """Number and times of its messages."""

    @property
    def rate_hz(self) -> float:
        """Messages a second; 0 if it has fewer than two."""
        duration_ns = self.span.last_ns - self.span.first_ns
        return (self.span.num_messages - 1) * NS / duration_ns if duration_ns > 0 else 0.0


@dataclass(frozen=True)
class _Part:
    """An open file of a recording."""

    path: Path
    storage: Storage
    spans: dict[int, Span]
    """Number and times of the messages of each connection."""
    is_ros1: bool = False


class Bag:
    """An open recording; a context manager.

    Messages come in the order in which they were received. What is damaged is left out, and told in `remarks`.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        """Open all files.

        Raises:
            InputError: a path is missing, or is no recording, or nothing of it is whole.
        """
        self.paths = paths
        self.remarks: list[str] = []
        self._stack = ExitStack()
        self._damaged: dict[str, int] = {}
        try:
            self._parts = [part for path in paths for part in self._open(path)]
            self._check_distinct()
            self.topics = self._topics()
            counted = [topic.span for topic in self.topics if topic.span.num_messages]
            if not counted:
                raise InputError(
                    f"{paths[0]}: found a recording without messages, needed sweeps and pictures"
                )
        except BaseException:
            self._stack.close()
            raise
        for part in self._parts:
            if part.storage.damage:
                self.remarks.append(f"{part.path}: found a damaged recording; missing: {part.storage.damage}")
        self.start_ns = min(span.first_ns for span in counted)
        self.end_ns = max(span.last_ns for span in counted)

    def __enter__(self) -> Bag:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    @property
    def files(self) -> list[Path]:
        """The files of the recording."""
        metadata = [path / METADATA for path in self.paths if is_folder(path)]
        return [*(part.path for part in self._parts), *metadata]

    @property
    def is_indexed(self) -> bool:
        """Whether a time can be looked up in all files without reading what stands before it."""
        return all(part.storage.is_indexed for part in self._parts)

    def of_types(self, types: Collection[str]) -> list[Topic]:
        """List the topics of some types that have messages."""
        return [topic for topic in self.topics if topic.type in types and topic.span.num_messages]

    def messages(
        self, topics: Collection[Topic], start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[Message]:
        """Yield the messages of some topics from `start_ns` to before `stop_ns`, and leave out damaged ones."""
        wanted = {(topic.name, topic.type) for topic in topics}
        start = self.start_ns if start_ns is None else start_ns
        stop = self.end_ns + 1 if stop_ns is None else stop_ns
        parts = [self._part_messages(part, wanted, start, stop) for part in self._parts]
        yield from heapq.merge(*parts, key=lambda message: message.received_ns)

    def damage_remarks(self) -> list[str]:
        """Say what could not be read so far."""
        found = [
            f"{reason} ({count:,} times)" if count > 1 else reason for reason, count in self._damaged.items()
        ]
        return [*self.remarks, *(f"found damaged data, left out: {each}" for each in found)]

    def _part_messages(
        self, part: _Part, wanted: Collection[tuple[str, str]], start: int, stop: int
    ) -> Iterator[Message]:
        connections = [each for each in part.storage.connections if (each.topic, each.msgtype) in wanted]
        step = STEP_NS
        while connections and start < stop:
            try:
                for connection, received, raw in part.storage.messages(connections, start, stop):
                    if not isinstance(received, int) or not isinstance(raw, bytes | bytearray | memoryview):
                        raise ValueError("found a row that is no message")
                    start = max(start, received)
                    is_compressed = not part.is_ros1 and bytes(raw[:4]) == ZSTD_MAGIC
                    data = DECOMPRESSORS["zstd"](raw, 0) if is_compressed else raw
                    yield Message(connection.topic, connection.msgtype, received, bytes(data), part.is_ros1)
                    step = STEP_NS
                return
            except Exception as error:  # Hostile bytes raise errors of any kind in the library.
                reason = f"{part.path.name}: {_told(error)}"
                self._damaged[reason] = self._damaged.get(reason, 0) + 1
                start, step = start + step, 2 * step

    def _open(self, path: Path) -> list[_Part]:
        if not is_folder(path):
            return [self._open_file(path)]
        if (path / METADATA).exists():
            read_start(path / METADATA, 0)
            folder = Folder(path)
            self._stack.callback(_closed, folder)
            try:
                folder.open()
                storages: list[Any] = folder.storages
                return [_Part(each.path, each, each.spans()) for each in storages]
            except Exception as error:  # Hostile bytes raise errors of any kind in the library.
                self.remarks.append(f"{path / METADATA}: {_told(error)}; its files are read without it")
        files = sorted(file for file in path.iterdir() if file.suffix in SUFFIXES)
        if not files:
            raise InputError(f"{path}: found no {', '.join(SUFFIXES)} in this folder, needed a recording")
        return [self._open_file(file) for file in files]

    def _open_file(self, path: Path) -> _Part:
        start = read_start(path, max(map(len, MAGIC)))
        reader = next((reader for magic, reader in MAGIC.items() if start.startswith(magic)), None)
        if reader is None:
            found = f"{path.stat().st_size:,} bytes of no known format"
            raise InputError(f"{path}: found {found}, needed a .bag of ROS 1, an MCAP or a .db3 of ROS 2")
        storage = reader(path)
        self._stack.callback(_closed, storage)
        try:
            storage.open()
            return _Part(path, storage, storage.spans(), is_ros1=reader is Ros1File)
        except Exception as error:  # Hostile bytes raise errors of any kind in the library.
            raise InputError(f"{path}: found a recording that cannot be read: {_told(error)}") from None

    def _check_distinct(self) -> None:
        seen: set[str] = set()
        for part in self._parts:
            real = os.path.realpath(part.path)
            if real in seen:
                raise InputError(
                    f"{part.path}: found twice among the parts of the recording, needed each once"
                )
            seen.add(real)

    def _topics(self) -> list[Topic]:
        found: dict[tuple[str, str], Span] = {}
        for part in self._parts:
            for each in part.storage.connections:
                key, span = (each.topic, each.msgtype), part.spans[each.id]
                if not all(isinstance(name, str) for name in key):
                    continue  # The names of a damaged database can be anything.
                before = found.get(key, Span(0, 0, 0))
                found[key] = _joined(before, span) if min(before, span).num_messages else max(before, span)
        return [Topic(*key, span) for key, span in sorted(found.items())]


def _joined(a: Span, b: Span) -> Span:
    return Span(a.num_messages + b.num_messages, min(a.first_ns, b.first_ns), max(a.last_ns, b.last_ns))


def _closed(storage: Any) -> None:
    with suppress(Exception):  # A file that was not opened whole cannot always be closed.
        storage.close()


def _told(error: Exception) -> str:
    """Say in a few words what the library found."""
    text = str(error).strip().rstrip(".") or type(error).__name__
    return text if len(text) <= 120 else f"{text[:117]}..."
