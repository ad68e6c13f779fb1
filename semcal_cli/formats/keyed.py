"""Files of `key: values` lines, as KITTI's and OpenCalib's calibrations are."""

from __future__ import annotations

from pathlib import Path

from semcal_cli.files.reading import read_text
from semcal_cli.formats.node import Node
from semcal_cli.geometry.poses import Pose


class _Twice:
    """The values of a key that stands on several lines: nobody can tell which are meant."""

    def __repr__(self) -> str:
        return "it twice"


def keyed(path: Path, text: str) -> Node:
    """Take the lines of a file for a document: the numbers under each key, or a text where not all are numbers."""
    values: dict[str, object] = {}
    for key, colon, line in (line.partition(":") for line in text.splitlines()):
        if colon:
            name = key.strip()
            values[name] = _Twice() if name in values else _numbers(line)
    return Node(str(path), values)


def read_keyed(path: Path) -> Node:
    """Read a file.

    Raises:
        InputError: the file is missing, or is not text.
    """
    return keyed(path, read_text(path))


def row(T: Pose) -> str:
    """Write the first 12 numbers of a transform, by rows."""
    return " ".join(map(repr, T[:3].ravel().tolist()))


def _numbers(line: str) -> list[float] | str:
    try:
        return [float(word) for word in line.split()]
    except ValueError:
        return line.strip()
