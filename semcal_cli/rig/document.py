"""The rig: several cameras and one LiDAR, described by a `rig.yaml`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import chain, pairwise
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, PrivateAttr, field_validator, model_validator

from semcal_cli.config import MAX_POINTS
from semcal_cli.drive.document import DRIVE_FILE, RIG, RIG_FILE, Drive, read_drive
from semcal_cli.errors import InputError, describe, mismatch, one_of
from semcal_cli.files.documents import read_document
from semcal_cli.files.reading import is_folder, read_bytes
from semcal_cli.files.validation import FileName, StatedTransform, StrictModel, Version, validate
from semcal_cli.geometry.poses import Pose, inverse, nearest_rigid
from semcal_cli.rig.clouds import connected_cameras

RESULT = "rig_calibration"
"""Name of the result of the whole rig, beside the results of its cameras."""
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")


class Rig(StrictModel):
    """Content of a rig.yaml. Each camera has a drive of its own, and the drives name the same clouds."""

    semcal_rig: Version
    """Version of this format."""
    cameras: Annotated[dict[str, FileName], Field(min_length=2)]
    """Drive of each camera: its folder or its file, relative to the rig.yaml."""
    T_camera_camera: dict[str, dict[str, StatedTransform]] = {}
    """Reference transforms between cameras, for comparison only. The transform under a and then b is T_a_b with
    p_a = T_a_b * p_b, in metres, as a stereo calibration gives it."""

    _path: Path = PrivateAttr(default=Path(RIG_FILE))

    @field_validator("cameras")
    @classmethod
    def _check_names(cls, cameras: dict[str, str]) -> dict[str, str]:
        for name in cameras:
            # The results are files with these names.
            if not NAME.fullmatch(name) or len(name) > 100:
                raise mismatch(describe(name), "a name of letters, digits, _, - and . for a camera")
            if name.lower() == RESULT:
                raise mismatch(describe(name), "a name other than that of the rig's own result")
        folded: dict[str, str] = {}
        for name in cameras:
            if folded.setdefault(name.lower(), name) != name:
                raise mismatch(
                    f"{folded[name.lower()]!r} and {name!r}", "names that differ in more than case"
                )
        return cameras

    @model_validator(mode="after")
    def _check_references(self) -> Rig:
        for to, others in self.T_camera_camera.items():
            for name in (to, *others):
                if name not in self.cameras:
                    needed = one_of(name, self.cameras)
                    raise ValueError(f"T_camera_camera: found camera {describe(name)}, needed {needed}")
            if to in others:
                raise ValueError(f"T_camera_camera: found {to!r} beside itself, needed two cameras")
            for other in others:
                if to in self.T_camera_camera.get(other, {}):
                    raise ValueError(
                        f"T_camera_camera: found {to!r} and {other!r} both ways, needed one of them"
                    )
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
                    f"{self._path}: cameras: found {drive.path} for {owner!r} and {name!r}, needed a drive for each"
                )
        stated = {name: drive.lidar for name, drive in drives.items() if drive.lidar is not None}
        for first, name in pairwise(stated):
            if stated[first] != stated[name]:
                raise InputError(
                    f"{self._path}: cameras: found another lidar in the drive of {name!r} than in that of {first!r}, "
                    "needed one LiDAR"
                )
        self._check_clouds(drives)
        return drives

    def _check_clouds(self, drives: Mapping[str, Drive]) -> None:
        """Check that all cameras are connected by clouds."""
        first, *others = connected_cameras(drives) or [[]]
        if others:
            apart, rest = (" and ".join(map(repr, names)) for names in (chain.from_iterable(others), first))
            raise InputError(
                f"{self._path}: cameras: found no cloud of {apart} among those of {rest}, "
                "needed drives that name the same clouds, since the cameras of a rig belong to one LiDAR"
            )

    def reference(self, to: str, other: str) -> Pose | None:
        """Return the reference T_to_other (4, 4) of two cameras, whichever way the file states it; None without one."""
        if (T := self.T_camera_camera.get(to, {}).get(other)) is not None:
            return nearest_rigid(np.array(T))
        if (T := self.T_camera_camera.get(other, {}).get(to)) is not None:
            return inverse(nearest_rigid(np.array(T)))
        return None


def find_rig(path: Path) -> Path | None:
    """Find the rig.yaml that a path names.

    Args:
        path: A file, or a folder with a rig.yaml and no drive.yaml.

    Returns:
        The rig.yaml; None if the path names a drive.

    Raises:
        InputError: the file does not exist or cannot be parsed.
    """
    if is_folder(path):
        file = path / RIG_FILE
        return file if file.exists() and not (path / DRIVE_FILE).exists() else None
    # A file without the word need not be parsed, which takes time for a long drive.
    return path if RIG.encode() in read_bytes(path) and RIG in read_document(path) else None


def read_rig(path: Path) -> Rig:
    """Read and check a rig.

    Raises:
        InputError: the file is wrong; the message names the file, the key, what was found and what was needed.
    """
    rig = validate(Rig, read_document(path), path)
    rig._path = path
    return rig
