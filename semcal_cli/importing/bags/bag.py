"""A recording: one or more files of ROS or Foxglove, read as one series of messages."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any, NamedTuple, Protocol

from zstandard import ZstdDecompressor

from semcal_cli.config.data_suffixes import kind_of_data
from semcal_cli.config.nanoseconds import NS
from semcal_cli.errors import InputError, counted
from semcal_cli.files.documents import parse_document
from semcal_cli.files.input_files import is_folder, is_same_file, kind_of, open_file, read_start, read_text
from semcal_cli.formats.node import Node
from semcal_cli.importing.bags.mcap_file import McapFile
from semcal_cli.importing.bags.messages import Message, Span, Topic
from semcal_cli.importing.bags.recording_files import (
    MAGIC_BYTES,
    MCAP_MAGIC,
    METADATA,
    ROS1_MAGIC,
    SQLITE_MAGIC,
    SUFFIXES,
)
from semcal_cli.importing.bags.ros1_file import Ros1File
from semcal_cli.importing.bags.sqlite_file import SqliteFile
from semcal_cli.importing.bags.unpacking import ZSTD_MAGIC, unpack


class Storage(Protocol):
    """An open file of a recording."""

    topics: list[Topic]
    """Its topics, each with the messages of this file."""
    damage: str | None
    """Description of what is missing; None if nothing is."""
    is_indexed: bool
    """Whether messages at a time can be found without reading everything before them."""

    def messages(self, topics: Collection[Topic], start_ns: int, stop_ns: int) -> Iterator[Message]:
        """Yield the messages of some topics from `start_ns` to before `stop_ns`, in the order of receipt."""


class StorageFormat(NamedTuple):
    """A format of recordings."""

    reader: Callable[[Path, ExitStack], Storage]
    """Function that opens a file of this format, until the stack closes it."""
    repair: str
    """Command that repairs a file that the reader cannot read."""


FORMATS = {
    ROS1_MAGIC: StorageFormat(Ros1File, "rosbag reindex"),
    MCAP_MAGIC: StorageFormat(McapFile, "mcap recover"),
    SQLITE_MAGIC: StorageFormat(SqliteFile, "sqlite3 FILE .recover"),
}
"""Formats by the first bytes of a file."""
MAX_RATIO, MAX_SMALL_BYTES = 100, 1 << 30
"""A compressed file may unpack to this multiple of its size, or to this many bytes if that is more."""
PART_BYTES = 1 << 20
MAX_REMARKS = 3
"""Largest number of remarks about damage in an error."""
STEP_NS = NS // 2
"""How long after a damaged message reading resumes; it doubles until something can be read."""


class Bag:
    """An open recording; a context manager.

    Messages come in order of receipt. Damaged data are left out; `damage_remarks` lists them.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        """Open all files.

        Raises:
            InputError: a path is missing, is not a recording, or holds no whole message.
        """
        self.paths = paths
        self.remarks: list[str] = []
        self._damaged: Counter[str] = Counter()
        self._storages: dict[Path, Storage] = {}
        with ExitStack() as stack:
            for file in (file for path in paths for file in self._files_of(path)):
                if any(is_same_file(file, other) for other in self._storages):
                    raise InputError(
                        f"{file}: found twice among the parts of the recording, expected each once"
                    )
                self._storages[file] = _open(file, stack)
            self.topics = self._topics()
            counted = [topic.span for topic in self.topics if topic.span.num_messages]
            if not counted:
                raise InputError(
                    f"{paths[0]}: found a recording without messages, expected sweeps and images"
                )
            self._stack = stack.pop_all()
        for file, storage in self._storages.items():
            if storage.damage:
                self.remarks.append(f"{file}: found a damaged recording; missing: {storage.damage}")
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
        return [*self._storages, *metadata]

    @property
    def is_indexed(self) -> bool:
        """Whether messages at a time can be found in all files without reading everything before them."""
        return all(storage.is_indexed for storage in self._storages.values())

    def of_types(self, types: Collection[str]) -> list[Topic]:
        """List the topics whose messages have the content of one of these ROS types, without empty topics."""
        return [topic for topic in self.topics if topic.is_a(types) and topic.span.num_messages]

    def first(self, topic: Topic) -> Message | None:
        """Read the first message of a topic; None if none is whole."""
        return next(self.messages([topic]), None)

    def messages(
        self, topics: Collection[Topic], start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[Message]:
        """Yield the undamaged messages of some topics from `start_ns` to before `stop_ns`, in order of receipt."""
        start = self.start_ns if start_ns is None else start_ns
        stop = self.end_ns + 1 if stop_ns is None else stop_ns
        parts = [self._part_messages(file, set(topics), start, stop) for file in self._storages]
        yield from heapq.merge(*parts, key=lambda message: message.received_ns)

    def damage_remarks(self) -> list[str]:
        """List what could not be read so far."""
        reasons = [
            f"{reason} ({count:,} times)" if count > 1 else reason for reason, count in self._damaged.items()
        ]
        return [*self.remarks, *(f"left out damaged data: {reason}" for reason in reasons)]

    def refusal(self, problem: str) -> InputError:
        """Make the error of a recording that gives no drive, with what is damaged in it."""
        return InputError("; ".join([problem, *self.damage_remarks()[:MAX_REMARKS]]))

    def _part_messages(self, file: Path, topics: set[Topic], start: int, stop: int) -> Iterator[Message]:
        storage, step = self._storages[file], STEP_NS
        file_topics = topics.intersection(storage.topics)
        while file_topics and start < stop:
            try:
                for message in storage.messages(file_topics, start, stop):
                    start = max(start, message.received_ns)
                    yield _unpack_message(message)
                    step = STEP_NS
                return
            except InputError:
                raise
            except Exception as error:  # Hostile bytes raise errors of any kind in the libraries.
                self._damaged[f"{file.name}: {_shorten(error)}"] += 1
                start, step = start + step, 2 * step

    def _files_of(self, path: Path) -> list[Path]:
        """List the files of a recording: those that the metadata of a folder names, or else all in the folder."""
        if not is_folder(path):
            return [path]
        metadata = path / METADATA
        if metadata.exists():
            text = read_text(metadata)
            try:
                return _metadata_files(parse_document(text, metadata), metadata)
            except InputError as error:
                self.remarks.append(
                    f"{error}; all files of the folder are read instead; `ros2 bag reindex` writes new metadata"
                )
        files = sorted(file for file in path.iterdir() if file.suffix in SUFFIXES)
        if not files:
            raise InputError(f"{path}: found no {', '.join(SUFFIXES)} in this folder, expected a recording")
        return files

    def _topics(self) -> list[Topic]:
        spans: dict[Topic, Span] = {}
        for storage in self._storages.values():
            for topic in storage.topics:
                spans[topic] = spans.get(topic, Span()).join(topic.span)
        topics = [replace(topic, span=span) for topic, span in spans.items()]
        return sorted(topics, key=lambda topic: (topic.name, topic.type))


def _open(path: Path, stack: ExitStack) -> Storage:
    start = read_start(path, MAGIC_BYTES)
    source = path
    if start.startswith(ZSTD_MAGIC):
        source = _unpack_file(path, Path(stack.enter_context(TemporaryDirectory(prefix="semcal-"))))
        start = read_start(source, MAGIC_BYTES)
    format = next((format for magic, format in FORMATS.items() if start.startswith(magic)), None)
    if format is None:
        description = kind_of_data(path) or f"{counted(path.stat().st_size, 'byte')} of an unknown format"
        raise InputError(f"{path}: found {description}, expected a .bag of ROS 1, an MCAP or a .db3 of ROS 2")
    try:
        return format.reader(source, stack)
    except InputError:  # A library is missing, or the file is gone: nothing is damaged.
        raise
    except Exception as error:  # Hostile bytes raise errors of any kind in the libraries.
        description = f"found a recording that cannot be read: {_shorten(error)}"
        raise InputError(
            f"{path}: {description}; if it is damaged, `{format.repair}` may repair it"
        ) from None


def _metadata_files(document: dict[Any, Any], metadata: Path) -> list[Path]:
    names = Node(str(metadata), document).at("rosbag2_bagfile_information").at("relative_file_paths")
    if not isinstance(names.value, list) or not names.value:
        raise names.mismatch("a list of files")
    stated = [names.child(index, name).text() for index, name in enumerate(names.value)]
    files = [metadata.with_name(PurePath(name).name or METADATA) for name in stated]
    # Path.exists raises an error on names that are too long for the system.
    if missing := [file.name for file in files if kind_of(file) is None]:
        raise InputError(f"{names.where}: found no file {missing[0][:60]!r} in the folder")
    return files


def _unpack_message(message: Message) -> Message:
    """Unpack a message of ROS 2 that is compressed on its own; others start with CDR's 0."""
    is_plain = message.topic.is_ros1 or message.topic.decode is not None
    if is_plain or not message.raw.startswith(ZSTD_MAGIC):
        return message
    return replace(message, raw=unpack("zstd", message.raw))


def _unpack_file(path: Path, folder: Path) -> Path:
    """Unpack a compressed file to a folder, under its name without the last suffix."""
    target, num_bytes = folder / path.stem, 0
    max_bytes = max(MAX_RATIO * path.stat().st_size, MAX_SMALL_BYTES)
    try:
        with open_file(path) as packed, target.open("wb") as file:
            for part in ZstdDecompressor().read_to_iter(packed, write_size=PART_BYTES):
                num_bytes += file.write(part)
                if num_bytes > max_bytes:
                    raise ValueError(f"it unpacks to more than {max_bytes:,} bytes")
    except Exception as error:  # Hostile bytes raise errors of several kinds in the library.
        raise InputError(
            f"{path}: found a compressed file that cannot be unpacked: {_shorten(error)}"
        ) from None
    return target


def _shorten(error: Exception) -> str:
    """Shorten a library's message to a few words."""
    text = " ".join(str(error).split()).rstrip(".") or type(error).__name__
    return text if len(text) <= 120 else f"{text[:117]}..."
