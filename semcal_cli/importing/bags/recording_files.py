"""How the files of a recording are known: by their first bytes, their suffixes, and the metadata of a folder.

This module imports none of the libraries that read recordings.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from semcal_cli.errors import InputError
from semcal_cli.files.input_files import is_folder, read_start

ROS1_MAGIC, MCAP_MAGIC, SQLITE_MAGIC = b"#ROSBAG V", b"\x89MCAP0\r\n", b"SQLite format 3\0"
"""First bytes of the files of a recording."""
MAGIC_BYTES = 16
"""Number of bytes that tell which of them a file has."""
SUFFIXES = (".bag", ".mcap", ".db3", ".zstd")
METADATA = "metadata.yaml"
METADATA_KEY = b"rosbag2_bagfile_information"
METADATA_START = 4096
"""Number of bytes of the metadata in which their key is searched for."""


def is_recording(path: Path) -> bool:
    """Return whether a file, or a folder by its files, looks like a recording; it may be damaged."""
    with suppress(InputError, OSError):
        if not is_folder(path):
            start = read_start(path, MAGIC_BYTES)
            has_magic = start.startswith((ROS1_MAGIC, MCAP_MAGIC, SQLITE_MAGIC))
            return has_magic or path.suffix.lower() in SUFFIXES
        metadata = path / METADATA
        if metadata.exists() and METADATA_KEY in read_start(metadata, METADATA_START):
            return True
        return any(file.suffix in SUFFIXES and file.is_file() for file in path.iterdir())
    return False
