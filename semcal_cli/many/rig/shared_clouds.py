"""Whether the drives of a rig belong together: those of one LiDAR share clouds, those of one camera its intrinsics.

Sweeps of one LiDAR are none of another one, unless the drives name other points of the same clouds, and images of one
camera none of another one.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from functools import cache
from hashlib import sha256
from itertools import chain, combinations, pairwise
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
                f"{rig}: found the drive {drive.path} for {owner!r} and {name!r}, expected a drive for each"
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
    groups = merge_overlapping((names, set[Hashable](names)) for names in [*connected_cameras(drives), *tied])
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


def check_lidars(rig: Path, views: Mapping[str, tuple[str, str, Drive]]) -> None:
    """Check that the drives of each LiDAR have sweeps of its own, and those of each camera its own images.

    Args:
        rig: File of the rig.
        views: Camera, LiDAR and drive of each result, those of the first LiDAR first.

    Raises:
        InputError: a drive has the sweeps of another LiDAR or the images of another camera.
    """
    clouds = {
        name: _sizes(drive, (frame.points for frame in drive.frames)) for name, (*_, drive) in views.items()
    }
    images = {
        name: _sizes(drive, (frame.image for frame in drive.frames if frame.image is not None))
        for name, (*_, drive) in views.items()
    }
    key_of = cache(content_key)
    for (other, (its_camera, its_lidar, _)), (name, (camera, lidar, _)) in combinations(views.items(), 2):
        if lidar == its_lidar:
            continue
        are_apart = _name_other_points(views[name][2], views[other][2])
        if not are_apart and _are_of_one(clouds[name], clouds[other], key_of):
            raise InputError(
                f"{rig}: lidars.{lidar}.cameras: found clouds of {its_lidar!r} in the drive of {camera!r}, expected "
                "sweeps of another LiDAR, or `lidar.own_points` with ranges of one field that do not overlap"
            )
        if camera != its_camera and _are_of_one(images[name], images[other], key_of):
            raise InputError(
                f"{rig}: lidars.{lidar}.cameras.{camera}: found images of {its_camera!r}, expected those of {camera!r}"
            )


def _name_other_points(drive: Drive, other: Drive) -> bool:
    """Return whether two drives state that their LiDARs have other points of clouds that hold those of both."""
    own, others = (None if one.lidar is None else one.lidar.own_points for one in (drive, other))
    return own is not None and others is not None and own.is_apart_from(others)


def _sizes(drive: Drive, names: Iterable[str]) -> dict[Path, int]:
    """Return the sizes, in bytes, of the files of a drive that can be read."""
    paths = {cloud_path(drive, name) for name in names}
    return {path: path.stat().st_size for path in paths if os.access(path, os.R_OK) and path.is_file()}


def _are_of_one(
    files: Mapping[Path, int], others: Mapping[Path, int], key_of: Callable[[Path], Hashable]
) -> bool:
    """Return whether one of the files is also among others, or most of them are copies of these.

    Args:
        files: Sizes of the files.
        others: Sizes of the others.
        key_of: Identifies the content of a file.
    """
    if not files.keys().isdisjoint(others):
        return True
    sizes = {*files.values()}.intersection(others.values())
    other_keys = {key_of(path) for path, size in others.items() if size in sizes}
    copies = [path for path, size in files.items() if size in sizes and key_of(path) in other_keys]
    return len(copies) > len(files) / 2


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
    groups = merge_overlapping(([name], set[Hashable](files[name])) for name in drives)
    if len(groups) > 1:
        clouds = [(names, set().union(*(files[name] for name in names))) for names, _ in groups]
        groups = merge_overlapping(
            (names, {content_key(path) for path in paths})
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


def content_key(path: Path) -> tuple[int, bytes]:
    """Identify the content of a cloud: the size of its file, and the hash of the bytes in its middle."""
    with open_file(path) as file:
        size = size_of(file)
        file.seek(max((size - SAMPLE_BYTES) // 2, 0))
        return size, sha256(file.read(SAMPLE_BYTES)).digest()


def merge_overlapping(groups: Iterable[_CameraGroup]) -> list[_CameraGroup]:
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
