"""Names of frames in sentences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import PurePosixPath

from semcal_cli.files.messages import listed


def frame_name(names: Sequence[str], index: int) -> str:
    """Name a frame by its point cloud without folder and suffix, if that tells it from all others."""
    stems = [PurePosixPath(name).stem for name in names]
    return stems[index] if stems.count(stems[index]) == 1 else names[index]


def frame_names(names: Sequence[str], indices: Iterable[int]) -> str:
    """List the names of some frames."""
    return listed(frame_name(names, index) for index in indices)
