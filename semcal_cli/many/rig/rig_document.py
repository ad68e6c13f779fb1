"""The rig: several cameras and one LiDAR, described by a `rig.yaml`."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Hashable, Iterable, Mapping
from hashlib import sha256
from itertools import chain, pairwise
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
from pydantic import Field, PrivateAttr, field_validator, model_validator

from semcal_cli.config import MAX_POINTS
from semcal_cli.config.file_limits import MAX_CAMERAS
from semcal_cli.drive.document import DRIVE_FILE, RIG, RIG_FILE, Drive, read_drive
from semcal_cli.errors import InputError, describe, mismatch, one_of
from semcal_cli.files.documents import read_document
from semcal_cli.files.input_files import is_folder, open_file, read_bytes, size_of
from semcal_cli.files.validation import FileName, StatedTransform, StrictModel, Version, length, validate
from semcal_cli.geometry.arrays import Numbers, Pose
from semcal_cli.geometry.poses import inverse, nearest_rigid

RESULT = "rig_calibration"
"""Name of the result of the whole rig, next to the results of its cameras."""
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
MAX_CONSTRAINTS = 30
"""Largest number of constraints, each of which is compared with all others."""
MAX_SIGMA_M, MAX_SIGMA_DEG = 10.0, 180.0
"""Largest standard deviations of a constraint: more says nothing."""
MIN_SIGMA_M, MIN_SIGMA_DEG = 1e-6, 1e-5
"""Smallest ones: less is round-off of stated transforms."""
SAMPLE_BYTES = 65_536
"""Number of bytes in the middle of a file that, with its size, identify copies. No two sweeps agree in them."""
_CameraGroup: TypeAlias = tuple[list[str], set[Hashable]]
"""Names of cameras, and what identifies their clouds."""


class Constraint(StrictModel):
    """Known transform between two cameras, as from a stereo calibration, with its standard deviations."""

    source: str = Field(alias="from")
    """Camera from whose frame the transform leads."""
    to: str
    """Camera to whose frame it leads."""
    T_to_from: StatedTransform
    """The transform in metres, p_to = T_to_from * p_from."""
    sigma_m: Annotated[float, Field(ge=MIN_SIGMA_M, le=MAX_SIGMA_M)]
    """Standard deviation of the position along each axis, in metres."""
    sigma_deg: Annotated[float, Field(ge=MIN_SIGMA_DEG, le=MAX_SIGMA_DEG)]
    """Standard deviation of the rotation about each axis, in degrees."""

    @property
    def cameras(self) -> frozenset[str]:
        """Both cameras."""
        return frozenset({self.source, self.to})

    @property
    def pose(self) -> Pose:
        """The transform (4, 4), without round-off in its rotation."""
        return nearest_rigid(np.array(self.T_to_from))

    @property
    def variances(self) -> Numbers:
        """Variances (6,) of a twist on the left of the transform, square metres and radians."""
        return np.repeat([self.sigma_m, math.radians(self.sigma_deg)], 3) ** 2


class Rig(StrictModel):
    """Content of a rig.yaml. Each camera has its own drive, and the drives name the same clouds."""

    semcal_rig: Version
    """Version of this format."""
    cameras: Annotated[dict[str, FileName], Field(min_length=2, max_length=MAX_CAMERAS)]
    """Drive of each camera: its folder or its file, relative to the rig.yaml."""
    T_camera_camera: dict[str, dict[str, StatedTransform]] = {}
    """Reference transforms between cameras, for comparison only. The entry b under a is T_a_b in metres, with
    p_a = T_a_b * p_b, as from a stereo calibration."""

    constraints: Annotated[tuple[Constraint, ...], length(0, MAX_CONSTRAINTS)] = ()
    """Known transforms between cameras, to which their calibrations are adjusted."""

    _path: Path = PrivateAttr(default=Path(RIG_FILE))

    @field_validator("cameras")
    @classmethod
    def _check_names(cls, cameras: dict[str, str]) -> dict[str, str]:
        for name in cameras:
            # The results are files with these names.
            if not NAME.fullmatch(name):
                raise mismatch(describe(name), "a camera name of letters, digits, _, - and .")
            if name.lower() == RESULT:
                raise mismatch(describe(name), "a name that differs from that of the rig's own result")
        by_lower_case: dict[str, str] = {}
        for name in cameras:
            if by_lower_case.setdefault(name.lower(), name) != name:
                raise mismatch(
                    f"{by_lower_case[name.lower()]!r} and {name!r}", "names that differ in more than case"
                )
        return cameras

    @model_validator(mode="after")
    def _check_references(self) -> Rig:
        for to, other_cameras in self.T_camera_camera.items():
            for name in (to, *other_cameras):
                if name not in self.cameras:
                    needed = one_of(name, self.cameras)
                    raise ValueError(f"T_camera_camera: found camera {describe(name)}, expected {needed}")
            if to in other_cameras:
                raise ValueError(
                    f"T_camera_camera: found {to!r} under itself, expected two different cameras"
                )
            for other in other_cameras:
                if to in self.T_camera_camera.get(other, {}):
                    raise ValueError(
                        f"T_camera_camera: found {to!r} and {other!r} in both directions, expected one of them"
                    )
        return self

    @model_validator(mode="after")
    def _check_constraints(self) -> Rig:
        pairs = set[frozenset[str]]()
        for index, constraint in enumerate(self.constraints):
            pair = constraint.cameras
            for name in sorted(pair):
                if name not in self.cameras:
                    raise ValueError(
                        f"constraints[{index}]: found camera {describe(name)}, expected {one_of(name, self.cameras)}"
                    )
            if len(pair) < 2:
                raise ValueError(
                    f"constraints[{index}]: found {constraint.to!r} twice, expected two different cameras"
                )
            if pair in pairs:
                raise ValueError(
                    f"constraints[{index}]: found a second one of {constraint.to!r} and {constraint.source!r}, "
                    "expected one for two cameras"
                )
            pairs.add(pair)
        return self

    @property
    def path(self) -> Path:
        """The file that was read."""
        return self._path

    def read_drives(self, max_points: int = MAX_POINTS) -> dict[str, Drive]:
        """Read and check the drive of each camera.

        Args:
            max_points: Points of the largest sweep that is read.

        Raises:
            InputError: a drive is wrong, two cameras have the same drive, two drives describe different LiDARs, or
                cameras share no clouds.
        """
        folder = self._path.parent
        drives = {name: read_drive(folder / drive, max_points) for name, drive in self.cameras.items()}
        owners: dict[Path, str] = {}
        for name, drive in drives.items():
            owner = owners.setdefault(drive.path.resolve(), name)
            if owner != name:
                raise InputError(
                    f"{self._path}: cameras: found {drive.path} for {owner!r} and {name!r}, expected a drive for each"
                )
        lidars = {name: drive.lidar for name, drive in drives.items() if drive.lidar is not None}
        for first, name in pairwise(lidars):
            if lidars[first] != lidars[name]:
                raise InputError(
                    f"{self._path}: cameras: found different `lidar` blocks in the drives of {first!r} and {name!r}, "
                    "expected the same LiDAR"
                )
        constrained = [[constraint.source, constraint.to] for constraint in self.constraints]
        groups = _merge_overlapping(
            (names, set[Hashable](names)) for names in [*connected_cameras(drives), *constrained]
        )
        group, *other_groups = [list(dict.fromkeys(names)) for names, _ in groups] or [[]]
        if other_groups:
            separate, connected = (
                " and ".join(map(repr, names)) for names in (chain.from_iterable(other_groups), group)
            )
            raise InputError(
                f"{self._path}: cameras: found no cloud of {separate} among those of {connected}, "
                "expected drives that name the same clouds, or `constraints` between them: the cameras of a rig share "
                "one LiDAR"
            )
        return drives

    def reference(self, to: str, other: str) -> Pose | None:
        """Return the reference T_to_other (4, 4) of two cameras, stated in either direction; None without one."""
        if (T := self.T_camera_camera.get(to, {}).get(other)) is not None:
            return nearest_rigid(np.array(T))
        if (T := self.T_camera_camera.get(other, {}).get(to)) is not None:
            return inverse(nearest_rigid(np.array(T)))
        return None


def find_rig(path: Path) -> Rig | None:
    """Read the rig that a path names.

    Args:
        path: A file, or a folder with a rig.yaml and no drive.yaml.

    Returns:
        The rig; None if the path names a drive.

    Raises:
        InputError: the file does not exist or is wrong.
    """
    if is_folder(path):
        file = path / RIG_FILE
        return read_rig(file) if file.exists() and not (path / DRIVE_FILE).exists() else None
    # A file without the key is not parsed, which would take time for a long drive.
    if RIG.encode() not in read_bytes(path):
        return None
    document = read_document(path)
    return _rig_of(document, path) if RIG in document else None


def read_rig(path: Path) -> Rig:
    """Read and check a rig.

    Raises:
        InputError: the file is wrong; the message names the file, the key, what was found and what was needed.
    """
    return _rig_of(read_document(path), path)


def _rig_of(document: Mapping[str, Any], path: Path) -> Rig:
    rig = validate(Rig, document, path)
    rig._path = path
    return rig


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
