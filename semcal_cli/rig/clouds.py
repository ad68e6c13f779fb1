"""Clouds that the drives of a rig share, which show that its cameras belong to one LiDAR."""

from __future__ import annotations

import os
from collections.abc import Hashable, Mapping
from collections.abc import Set as AbstractSet
from hashlib import sha256
from pathlib import Path

from semcal_cli.drive.document import Drive
from semcal_cli.files.reading import open_file, size_of

SAMPLE_BYTES = 65_536
"""Bytes in the middle of a file by which copies are recognised, with the file's size. No two sweeps agree in them."""


def connected_cameras(drives: Mapping[str, Drive]) -> list[list[str]]:
    """Group the cameras that share clouds, directly or through other cameras.

    A cloud is shared if two drives name one file, or copies of one file. Files are opened only where cameras share none
    by name. A group with clouds that cannot be read is left out then, since nothing can be said of it.

    Args:
        drives: Drive of each camera.

    Returns:
        Names of the cameras of each group, in the order of the drives.
    """
    files = {name: _files(drive) for name, drive in drives.items()}
    groups = _grouped({(name,): files[name] for name in files})
    if len(groups) > 1:
        clouds = {tuple(group): set().union(*(files[name] for name in group)) for group in groups}
        readable = {
            group: paths
            for group, paths in clouds.items()
            if all(os.access(path, os.R_OK) and path.is_file() for path in paths)
        }
        groups = _grouped({group: {_content(path) for path in paths} for group, paths in readable.items()})
    order = list(drives)
    return sorted(
        (sorted(group, key=order.index) for group in groups), key=lambda group: order.index(group[0])
    )


def _files(drive: Drive) -> set[Path]:
    return {Path(os.path.realpath(drive.resolve(frame.points))) for frame in drive.frames}


def _content(path: Path) -> tuple[int, bytes]:
    """Identify the content of a cloud: the size of its file, and the hash of the bytes in its middle."""
    with open_file(path) as file:
        size = size_of(file)
        file.seek(max((size - SAMPLE_BYTES) // 2, 0))
        return size, sha256(file.read(SAMPLE_BYTES)).digest()


def _grouped(clouds: Mapping[tuple[str, ...], AbstractSet[Hashable]]) -> list[list[str]]:
    """Join the groups of cameras whose clouds overlap."""
    joined: list[tuple[list[str], set[Hashable]]] = []
    for names, own in clouds.items():
        group, of_group = list(names), set[Hashable](own)
        apart = []
        for other, of_other in joined:
            if of_group.isdisjoint(of_other):
                apart.append((other, of_other))
            else:
                group, of_group = other + group, of_group | of_other
        joined = [*apart, (group, of_group)]
    return [group for group, _ in joined]
