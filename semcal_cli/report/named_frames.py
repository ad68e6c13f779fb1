"""Names of the files of frames, after the frames."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from semcal_cli.drive.document import Drive
from semcal_cli.observations.frame_naming import frame_names

UNSAFE = re.compile(r"[^\w.+-]")
"""What the name of a file has not, of the name of a frame: such as the slashes between folders."""
MAX_STEM = 100


def frame_paths(folder: Path, drive: Drive, suffix: str = ".png") -> list[Path]:
    """Name the files of the frames of a drive in a folder: see `named_paths`."""
    return named_paths(folder, frame_names([frame.points for frame in drive.frames]), suffix)


def named_paths(folder: Path, names: Sequence[str], suffix: str = ".png") -> list[Path]:
    """Name files in a folder after frames; a name that is in use gets the position of the frame."""
    paths: dict[Path, None] = {}
    for position, name in enumerate(names):
        stem = UNSAFE.sub("_", name)[-MAX_STEM:].lstrip(".") or "frame"
        path = folder / f"{stem}{suffix}"
        paths[path if path not in paths else folder / f"{stem}-{position:06d}{suffix}"] = None
    return list(paths)
