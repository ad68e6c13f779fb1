"""The interface of a format of transforms and lenses, a source file, and the options for what a file leaves open."""

from __future__ import annotations

import codecs
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, get_args

from semcal_cli.config.directions import CameraFrame, Direction
from semcal_cli.drive.camera import Camera
from semcal_cli.drive.frame_ids import FrameIds
from semcal_cli.errors import InputError
from semcal_cli.files.documents import document_text, parse_any
from semcal_cli.files.input_files import read_bytes
from semcal_cli.files.output_files import STANDARD_INPUT, read_standard_input
from semcal_cli.formats.node import Node
from semcal_cli.geometry.arrays import Matrix, Pose

ARGUMENTS = {name: name for name in ("direction", "frame", "camera", "lidar", "to", "base")} | {
    "base_direction": "base_direction",
    "base_frame": "base_frame",
    "from": "name",
    "repair": "on_repair",
}
"""What a program calls the options for what a file leaves open, the names of formats, and a frame of the vehicle."""


class Base(NamedTuple):
    """The pose of the LiDAR in a frame of its vehicle."""

    T_base_lidar: Pose
    """(4, 4) float64, p_base = T_base_lidar @ p_lidar, metres."""
    name: str
    """Name of the frame, such as `base_link`."""


@dataclass(frozen=True)
class FormatOptions:
    """The user's options for what a file leaves open."""

    direction: Direction | None = None
    frame: CameraFrame | None = None
    """Axes of the camera frame in the file."""
    camera: str | None = None
    """Name of the camera's frame, entry or token in the file."""
    lidar: str | None = None
    """Name of the LiDAR's frame, entry or token in the file."""
    frame_ids: FrameIds | None = None
    """Names of the frames in the recording, for those that `camera` and `lidar` do not name."""
    base: Base | None = None
    """Frame of the vehicle from which the transform to the camera is written, in place of the LiDAR's."""
    file: Path | None = None
    """Path of the file to write, if there is one."""
    intrinsics: Camera | None = None
    """Camera whose intrinsics are written with the transform, if the format can hold them."""
    on_note: Callable[[str], None] | None = None
    """Called with a line that says why the intrinsics are left out or how the transform is written, and with a warning
    about a transform that is not trusted."""
    on_repair: Callable[[str], None] | None = None
    """Called for each invalid rotation that is replaced by the nearest rotation; None refuses such files."""
    is_written: bool = False
    """Whether the file is written."""
    covariance: Matrix | None = None
    """Covariance (6, 6) to write, if the format holds one: of a twist (rho, phi) on the left of T_camera_lidar, metres
    and radians, along the camera's axes; None if it is not known or not believed."""
    names: Mapping[str, str] = field(default_factory=ARGUMENTS.copy)
    """What messages call the options: a program's arguments, or the options that a command has; see `option`."""

    def __post_init__(self) -> None:
        """Check the values that a program passes; the command line checks its own options.

        Raises:
            InputError: a value is not one of the allowed words, or not a name.
        """
        for name, words in (("direction", get_args(Direction)), ("frame", get_args(CameraFrame))):
            if getattr(self, name) not in (None, *words):
                raise InputError(
                    f"{name}: found {getattr(self, name)!r}, expected one of: {', '.join(words)}"
                )
        for name in ("camera", "lidar"):
            if not isinstance(getattr(self, name), str | None):
                raise InputError(f"{name}: found {getattr(self, name)!r}, expected a name")

    def option(self, name: str) -> str:
        """Return what a message calls an option: the caller's own name for it, or that in `semcal convert`."""
        return self.names.get(name, f"--{name.replace('_', '-')}")

    def hint(self, *names: str) -> str:
        """Return the end of a message that asks for options: which command takes them if the caller does not."""
        return "" if self.names.keys() >= {*names} else "; `semcal convert` takes this option"

    def note(self, line: str) -> None:
        """Pass a line to `on_note`, if there is one."""
        if self.on_note is not None:
            self.on_note(line)


Edits: TypeAlias = list[tuple[int, int, str]]
"""Parts of a text by their beginnings and ends, each with the text that replaces it."""


class CameraBlock(NamedTuple):
    """The camera block of a drive, as read from another tool's file."""

    block: dict[str, Any]
    """The `camera:` block of a drive, not yet checked."""
    keys: Mapping[str, str]
    """The file's own names for the keys of the block, for messages."""


@dataclass(frozen=True)
class Source:
    """A file that may hold a transform."""

    path: Path
    content: bytes

    @classmethod
    def read(cls, path: Path) -> Source:
        """Read a file, or standard input if the path is `STANDARD_INPUT`.

        Raises:
            InputError: the file is missing, or too large to hold a transform.
        """
        return cls(path, read_standard_input() if path == STANDARD_INPUT else read_bytes(path))

    @property
    def text(self) -> str:
        """Content of the file as text.

        Raises:
            InputError: the content is not UTF-8.
        """
        try:
            return self.content.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise InputError(f"{self.path}: byte {error.start} is not UTF-8, expected text") from None

    @cached_property
    def document(self) -> Any:
        """Content of the file as JSON or YAML, chosen by its suffix.

        Raises:
            InputError: the content is not well-formed, or too large.
        """
        if self.path.suffix.lower() != ".json" and len(self.content) > MAX_YAML_BYTES:
            raise InputError(
                f"{self.path}: found {len(self.content):,} bytes of YAML, needed at most {MAX_YAML_BYTES:,}"
            )
        if self.path == STANDARD_INPUT and self.text.lstrip().startswith(("{", "[")):
            # Standard input has no suffix. What is not JSON may be YAML in braces.
            with suppress(InputError):
                return parse_any(self.text, self.path.with_suffix(".json"))
        return parse_any(self.text, self.path)

    @property
    def node(self) -> Node:
        """The document with the name of its file, for messages; raises as `document` does."""
        return Node(str(self.path), self.document)

    @cached_property
    def mapping(self) -> dict[Any, Any]:
        """The document if it is a mapping, else an empty mapping, for recognising formats."""
        return self._readable if isinstance(self._readable, dict) else {}

    @cached_property
    def records(self) -> list[dict[Any, Any]]:
        """The document if it is a list of mappings, else an empty list, for recognising formats."""
        document = self._readable
        return (
            document
            if isinstance(document, list) and all(isinstance(item, dict) for item in document)
            else []
        )

    @cached_property
    def start(self) -> str:
        """The text without leading white space, for recognising formats; empty if the content is not text."""
        with suppress(InputError):
            return self.text.lstrip()
        return ""

    @property
    def xml(self) -> ET.Element:
        """Content of the file as XML without declarations, so that no small file can expand into a large document.

        Raises:
            InputError: the content is not well-formed, or declares entities or a document type.
        """
        if declaration := DECLARATION.search(self.text):
            raise InputError(
                f"{self.path}: found <!{declaration.group(1)}, expected XML without declarations"
            )
        try:
            return ET.fromstring(self.text.lstrip())
        except ET.ParseError as error:
            line = error.position[0]
            raise InputError(f"{self.path}: line {line}: is not well-formed XML") from None
        except RecursionError:
            raise InputError(f"{self.path}: is nested too deeply") from None
        except ValueError as error:
            raise InputError(f"{self.path}: {error}") from None

    def looks_like_xml(self, element: str) -> bool:
        """Return whether the file begins like XML and has such an element, without parsing it."""
        return self.start.startswith("<") and f"<{element}" in self.start

    @property
    def _readable(self) -> Any:
        with suppress(InputError):
            return self.document
        return None


def edited(source: Source, edits: Edits) -> bytes:
    """Replace parts of the text of a file, and return the content of the new file.

    Raises:
        InputError: two parts overlap.
    """
    text, ordered = source.text, sorted(edits)
    for (_, end, first), (start, _, second) in pairwise(ordered):
        if start < end:
            line = text.count("\n", 0, start) + 1
            raise InputError(
                f"{source.path}: line {line}: found one place for {first!r} and {second!r}, expected two"
            )
    for start, end, replacement in reversed(ordered):
        text = f"{text[:start]}{replacement}{text[end:]}"
    mark = codecs.BOM_UTF8 if source.content.startswith(codecs.BOM_UTF8) else b""
    return mark + text.encode()


DECLARATION = re.compile(r"<!(DOCTYPE|ENTITY)", re.IGNORECASE)
MAX_YAML_BYTES = 1_000_000
"""Maximum size of a YAML file with a transform."""

FRAMES = ("frame", "camera", "lidar")
"""Options that files with named frames leave open."""


@dataclass(frozen=True)
class Format:
    """A format of transforms, or of a camera's intrinsics, with its reader and writer."""

    name: str
    equation: str
    """Equation of the stored transform, and where its numbers are in the file."""
    recognises: Callable[[Source], bool]
    read: Callable[[Source, FormatOptions], Pose]
    """Reads T_camera_lidar; raises `InputError` if the file is wrong or leaves something open."""
    make: Callable[[Pose, FormatOptions], bytes | dict[str, Any]] | None = None
    """Makes a file of T_camera_lidar: its content, or the document of a YAML or JSON file; None if files of the format
    are only read."""
    asks: tuple[str, ...] = ()
    """Those of `direction`, `frame`, `camera` and `lidar` that its files leave open."""
    has_transform: bool = True
    """Whether its files hold a transform; the others hold only intrinsics."""
    as_json: bool = False
    """Whether a document is written as JSON, whatever the suffix of its file."""
    edit: Callable[[Source, Pose, str | None, FormatOptions], Edits] | None = None
    """Finds what to replace in the text of a file so that it holds T_camera_lidar, under a name if one is given; None
    if files of the format are not edited, or only under a key, as documents are."""
    set_camera: Callable[[Source, Pose, FormatOptions], tuple[Any, Pose]] | None = None
    """Finds the entry of the camera in a document with poses on a base, and computes the pose T_base_camera of that
    entry for which the transform between the sensors is T_camera_lidar; raises `InputError` if files of the format are
    only read."""
    read_lens: Callable[[Source, str | None, str | None], CameraBlock | None] | None = None
    """Reads the intrinsics of a camera, given its name and the camera model that the user chooses, if any. Returns None
    if the file is of another format."""

    def write(self, T_camera_lidar: Pose, options: FormatOptions) -> bytes:
        """Make the content of a file.

        Raises:
            InputError: an option is missing, or files of the format are only read.
        """
        if self.make is None:
            raise InputError(f"found format {self.name}, which is only read, expected one that is written")
        content = self.make(T_camera_lidar, replace(options, is_written=True))
        if isinstance(content, bytes):
            return content
        is_json = self.as_json or (options.file is not None and options.file.suffix.lower() == ".json")
        return document_text(content, "json" if is_json else "yaml").encode()
