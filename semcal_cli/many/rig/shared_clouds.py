"""Whether the drives of a rig belong together: those of one LiDAR share clouds, those of one camera its intrinsics."""

from __future__ import annotations

import os
from collections.abc import Hashable, Iterable, Mapping, Sequence
from hashlib import sha256
from itertools import chain, pairwise
from pathlib import Path
from typing import TypeAlias

from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError
from semcal_cli.files.input_files import open_file, size_of

SAMPLE_BYTES = 65_536
"""Number of bytes in the middle of a file that, with its size, identify copies. No two sweeps agree in them."""
_CameraGroup: TypeAlias = tuple[list[str], set[Hashable]]
"""Names of cameras, and what identifies their clouds."""


def check_distinct_drives(rig: Path, drives: Mapping[str, Drive]) -> None:
    """Check that no drive is listed twice in the file of a rig.

    Raises:
        InputError: one is.
    """
    owners: dict[Path, str] = {}
    for name, drive in drives.items():
        owner = owners.setdefault(drive.path.resolve(), name)
        if owner != name:
            raise InputError(
                f"{rig}: cameras: found {drive.path} for {owner!r} and {name!r}, expected a drive for each"
            )


def check_one_lidar(key: str, drives: Mapping[str, Drive], constrained: Iterable[Sequence[str]]) -> None:
    """Check that drives are of one LiDAR.

    Args:
        key: The file and the key that list them, for messages.
        drives: Drive of each camera.
        constrained: Names of sensors that constraints tie, whatever their clouds.

    Raises:
        InputError: they describe different LiDARs, or share no clouds.
    """
    lidars = {name: drive.lidar for name, drive in drives.items() if drive.lidar is not None}
    for first, name in pairwise(lidars):
        if lidars[first] != lidars[name]:
            raise InputError(
                f"{key}: found different `lidar` blocks in the drives of {first!r} and {name!r}, "
                "expected the same LiDAR"
            )
    tied = [[name for name in names if name in drives] for names in constrained]
    groups = _merge_overlapping(
        (names, set[Hashable](names)) for names in [*connected_cameras(drives), *tied]
    )
    group, *other_groups = [list(dict.fromkeys(names)) for names, _ in groups if names] or [[]]
    if other_groups:
        separate, connected = (
            " and ".join(map(repr, names)) for names in (chain.from_iterable(other_groups), group)
        )
        raise InputError(
            f"{key}: found no cloud of {separate} among those of {connected}, "
            "expected drives that name the same clouds, or `constraints` between them: the cameras of a rig share "
            "one LiDAR"
        )


def check_cameras(rig: Path, views: Mapping[str, tuple[str, Drive]]) -> None:
    """Check that the drives of one camera with several LiDARs have the same intrinsics.

    Args:
        rig: File of the rig.
        views: Camera and drive of each result.

    Raises:
        InputError: two differ.
    """
    first: dict[str, str] = {}
    for name, (camera, drive) in views.items():
        other = first.setdefault(camera, name)
        intrinsics = [each.camera.model_copy(update={"mask": None}) for each in (drive, views[other][1])]
        if intrinsics[0] != intrinsics[1]:
            raise InputError(
                f"{rig}: lidars: found different `camera` blocks in the drives of {other!r} and {name!r}, "
                "expected the same camera"
            )


def connected_cameras(drives: Mapping[str, Drive]) -> list[list[str]]:
    """Group the cameras that share clouds, directly or through other cameras.

    A cloud is shared if two drives name the same file or copies of it. Files are opened only where cameras share none
    by name. A group with unreadable clouds is then left out, since nothing can be said about it.

    Args:
        drives: Drive of each camera.

    Returns:
        Names of the cameras of each group, in the order of the drives.
    """
    files = {
        name: {cloud_path(drive, frame.points) for frame in drive.frames} for name, drive in drives.items()
    }
    groups = _merge_overlapping(([name], set[Hashable](files[name])) for name in drives)
    if len(groups) > 1:
        clouds = [(names, set().union(*(files[name] for name in names))) for names, _ in groups]
        groups = _merge_overlapping(
            (names, {_content_key(path) for path in paths})
            for names, paths in clouds
            if all(os.access(path, os.R_OK) and path.is_file() for path in paths)
        )
    order = list(drives)
    return sorted(
        (sorted(names, key=order.index) for names, _ in groups), key=lambda names: order.index(names[0])
    )


def cloud_path(drive: Drive, name: str) -> Path:
    """Resolve the name of a cloud in a drive, including links."""
    return Path(os.path.realpath(drive.resolve(name)))


def _content_key(path: Path) -> tuple[int, bytes]:
    """Identify the content of a cloud: the size of its file, and the hash of the bytes in its middle."""
    with open_file(path) as file:
        size = size_of(file)
        file.seek(max((size - SAMPLE_BYTES) // 2, 0))
        return size, sha256(file.read(SAMPLE_BYTES)).digest()


def _merge_overlapping(groups: Iterable[_CameraGroup]) -> list[_CameraGroup]:
    """Join the groups whose clouds overlap."""
    merged: list[_CameraGroup] = []
    for names, clouds in groups:
        disjoint = []
        for other_names, other_clouds in merged:
            if clouds.isdisjoint(other_clouds):
                disjoint.append((other_names, other_clouds))
            else:
                names, clouds = other_names + names, clouds | other_clouds
        merged = [*disjoint, (names, clouds)]
    return merged
