"""Transforms from files of any known format, one module each; each states its direction as an equation."""

from pathlib import Path
from typing import Any, Protocol

from semcal_cli.documents import describe, read_document
from semcal_cli.drive import drive_file
from semcal_cli.errors import InputError
from semcal_cli.formats import rellis3d, semcal
from semcal_cli.poses import Pose


class Reader(Protocol):
    """What a module of this package offers."""

    KNOWN_AS: str
    """The format and the key that tells it, for the message that lists what is known."""

    def recognises(self, document: dict[Any, Any]) -> bool:
        """Whether the document is of this format."""

    def read(self, document: dict[Any, Any], path: Path) -> Pose:
        """Read T_camera_lidar from a recognised document; `path` is for complaints."""


READERS: tuple[Reader, ...] = (semcal, rellis3d)


def read_transform(path: Path) -> Pose:
    """Read the transform of any known file, or of a drive's folder.

    Returns:
        T_camera_lidar (4, 4) float64, p_camera = T_camera_lidar @ p_lidar, metres.

    Raises:
        InputError: the content is of no known format, or wrong.
    """
    file = drive_file(path)
    document = read_document(file)
    for reader in READERS:
        if reader.recognises(document):
            return reader.read(document, file)
    found = ", ".join(describe(key) for key in list(document)[:5]) or "none"
    known = "; ".join(reader.KNOWN_AS for reader in READERS)
    raise InputError(f"{file}: found top-level keys {found}, needed one of: {known}")
