"""The rig: several cameras and one LiDAR or more, described by a `rig.yaml`."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field, PrivateAttr, field_validator, model_validator

from semcal_cli.config import MAX_POINTS
from semcal_cli.config.data_suffixes import kind_of_data
from semcal_cli.config.file_limits import MAX_CAMERAS
from semcal_cli.drive.document import DRIVE_FILE, RIG, RIG_FILE, Drive, read_drive
from semcal_cli.errors import describe, mismatch, one_of
from semcal_cli.files.documents import read_document
from semcal_cli.files.input_files import is_folder, read_bytes
from semcal_cli.files.validation import FileName, StatedTransform, StrictModel, Version, length, validate
from semcal_cli.geometry.arrays import Numbers, Pose
from semcal_cli.geometry.poses import inverse, nearest_rigid
from semcal_cli.importing.recognition import recognise
from semcal_cli.many.rig.shared_clouds import (
    check_cameras,
    check_distinct_drives,
    check_lidars,
    check_one_lidar,
)

RESULT = "rig_calibration"
"""Name of the result of the whole rig, next to the results of its cameras."""
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
MAX_CONSTRAINTS = 30
"""Largest number of constraints, each of which is compared with all others."""
MAX_SIGMA_M, MAX_SIGMA_DEG = 10.0, 180.0
"""Largest standard deviations of a constraint: more says nothing."""
MIN_SIGMA_M, MIN_SIGMA_DEG = 1e-6, 1e-5
"""Smallest ones: less is round-off of stated transforms."""
MAX_LIDARS = 20
"""Largest number of further LiDARs."""
FIRST_LIDAR = "lidar"
"""Name of the first LiDAR in constraints and results of a rig of several LiDARs."""
References: TypeAlias = dict[str, dict[str, StatedTransform]]
"""Reference transforms between sensors: the entry b under a is T_a_b, p_a = T_a_b * p_b, metres."""


class Constraint(StrictModel):
    """Known transform between two sensors, as from a stereo calibration, with its standard deviations."""

    source: str = Field(alias="from")
    """Camera or LiDAR from whose frame the transform leads; the first LiDAR is `lidar`."""
    to: str
    """Camera or LiDAR to whose frame it leads."""
    T_to_from: StatedTransform
    """The transform in metres, p_to = T_to_from * p_from."""
    sigma_m: Annotated[float, Field(ge=MIN_SIGMA_M, le=MAX_SIGMA_M)]
    """Standard deviation of the position along each axis, in metres."""
    sigma_deg: Annotated[float, Field(ge=MIN_SIGMA_DEG, le=MAX_SIGMA_DEG)]
    """Standard deviation of the rotation about each axis, in degrees."""

    @property
    def sensors(self) -> frozenset[str]:
        """Both sensors."""
        return frozenset({self.source, self.to})

    @property
    def pose(self) -> Pose:
        """The transform (4, 4), without round-off in its rotation."""
        return nearest_rigid(np.array(self.T_to_from))

    @property
    def variances(self) -> Numbers:
        """Variances (6,) of a twist on the left of the transform, square metres and radians."""
        return np.repeat([self.sigma_m, math.radians(self.sigma_deg)], 3) ** 2


class FurtherLidar(StrictModel):
    """A further LiDAR of a rig, with the drives of the cameras that see what it measures."""

    cameras: Annotated[dict[str, FileName], Field(min_length=1, max_length=MAX_CAMERAS)]
    """Drive of each camera with the sweeps of this LiDAR: its folder or its file, relative to the rig.yaml. A camera
    that sees the first LiDAR's points, too, has the same name there."""
    is_registered: bool = Field(default=False, alias="register")
    """Whether its sweeps are also registered with those of the first LiDAR, where they overlap. This needs the extra
    `registration`."""


class LidarView(NamedTuple):
    """A camera with one LiDAR: a drive of its own."""

    camera: str
    lidar: str
    drive: str
    """Its folder or its file, relative to the rig.yaml."""


class Rig(StrictModel):
    """Content of a rig.yaml. Each camera has its own drive, and the drives name the same clouds."""

    semcal_rig: Version
    """Version of this format."""
    cameras: Annotated[dict[str, FileName], Field(min_length=1, max_length=MAX_CAMERAS)]
    """Drive of each camera with the first LiDAR: its folder or its file, relative to the rig.yaml. A rig of one LiDAR
    has at least two cameras."""
    T_camera_camera: References = {}
    """Reference transforms between cameras, for comparison only. The entry b under a is T_a_b in metres, with
    p_a = T_a_b * p_b, as from a stereo calibration."""

    constraints: Annotated[tuple[Constraint, ...], length(0, MAX_CONSTRAINTS)] = ()
    """Known transforms between cameras or LiDARs, to which their calibrations are adjusted."""
    lidars: Annotated[dict[str, FurtherLidar], Field(max_length=MAX_LIDARS)] = {}
    """Further LiDARs by name. The first one is `lidar`."""
    T_lidar_lidar: References = {}
    """Reference transforms between LiDARs, like T_camera_camera. They are also where a registration starts if no camera
    sees both LiDARs."""
    match_images: bool = False
    """Whether the images of cameras of the first LiDAR are matched where they overlap. A camera that is not trusted,
    and that they contradict, is calibrated again from where they place it; those that are not trusted are then moved
    to what they and the images say together."""

    _path: Path = PrivateAttr(default=Path(RIG_FILE))

    @field_validator("cameras")
    @classmethod
    def _check_cameras(cls, cameras: dict[str, str]) -> dict[str, str]:
        _check_names(cameras, "camera")
        return cameras

    @field_validator("lidars")
    @classmethod
    def _check_lidars(cls, lidars: dict[str, FurtherLidar]) -> dict[str, FurtherLidar]:
        _check_names(lidars, "LiDAR")
        for lidar in lidars.values():
            _check_names(lidar.cameras, "camera")
        return lidars

    @model_validator(mode="after")
    def _check_sensors(self) -> Rig:
        if len(self.cameras) < 2 and not self.lidars:
            raise ValueError(f"cameras: {mismatch(f'a mapping of {len(self.cameras)}', 'at least 2')}")
        further = [view_name(camera, name) for name, lidar in self.lidars.items() for camera in lidar.cameras]
        if len(further) > MAX_CAMERAS:
            raise ValueError(f"lidars: {mismatch(f'{len(further)} drives', f'at most {MAX_CAMERAS}')}")
        if self.constraints and not self.lidars and FIRST_LIDAR in self.cameras:
            raise ValueError(f"cameras: {mismatch(repr(FIRST_LIDAR), 'another name beside `constraints`')}")
        try:
            _check_cases([*self.sensors, *further])
        except ValueError as error:
            raise ValueError(f"lidars: {error}") from None
        return self

    @model_validator(mode="after")
    def _check_references(self) -> Rig:
        _check_references("T_camera_camera", self.T_camera_camera, "camera", self.all_cameras)
        _check_references("T_lidar_lidar", self.T_lidar_lidar, "LiDAR", [FIRST_LIDAR, *self.lidars])
        return self

    @model_validator(mode="after")
    def _check_constraints(self) -> Rig:
        pairs = set[frozenset[str]]()
        kind, kinds = ("camera or LiDAR", "sensors") if self.lidars else ("camera", "cameras")
        for index, constraint in enumerate(self.constraints):
            pair = constraint.sensors
            for name in sorted(pair):
                if name not in self.sensors:
                    raise ValueError(
                        f"constraints[{index}]: found {kind} {describe(name)}, expected {one_of(name, self.sensors)}"
                    )
            if len(pair) < 2:
                raise ValueError(
                    f"constraints[{index}]: found {constraint.to!r} twice, expected two different {kinds}"
                )
            if pair in pairs:
                raise ValueError(
                    f"constraints[{index}]: found a second one of {constraint.to!r} and {constraint.source!r}, "
                    f"expected one for two {kinds}"
                )
            pairs.add(pair)
        return self

    @model_validator(mode="after")
    def _check_tied(self) -> Rig:
        reached = self._reached()
        for name in self.lidars:
            if name not in reached:
                raise ValueError(
                    f"lidars.{name}: found nothing that ties it to the first LiDAR, expected a camera that sees both, "
                    "`constraints`, or `register: true` and T_lidar_lidar"
                )
        return self

    @property
    def path(self) -> Path:
        """The file that was read."""
        return self._path

    @property
    def views(self) -> dict[str, LidarView]:
        """Each camera with each LiDAR that it sees, by the names of their results."""
        first = {name: LidarView(name, FIRST_LIDAR, drive) for name, drive in self.cameras.items()}
        return first | {
            view_name(camera, name): LidarView(camera, name, drive)
            for name, lidar in self.lidars.items()
            for camera, drive in lidar.cameras.items()
        }

    @property
    def all_cameras(self) -> list[str]:
        """Names of the cameras of all LiDARs."""
        further = (camera for lidar in self.lidars.values() for camera in lidar.cameras)
        return list(dict.fromkeys([*self.cameras, *further]))

    @property
    def sensors(self) -> list[str]:
        """Names of all cameras, and of all LiDARs if there are several."""
        return [*self.all_cameras, *([FIRST_LIDAR, *self.lidars] if self.lidars else [])]

    def read_drives(self, max_points: int = MAX_POINTS) -> dict[str, Drive]:
        """Read and check the drive of each camera with each LiDAR, by the names of their results.

        Args:
            max_points: Points of the largest sweep that is read.

        Raises:
            InputError: a drive is wrong, two cameras have the same drive, two drives of one LiDAR describe different
                ones or share no clouds, two drives of one camera describe different ones, or a drive has the sweeps of
                another LiDAR or the images of another camera.
        """
        folder, views = self._path.parent, self.views
        drives = {name: read_drive(folder / view.drive, max_points) for name, view in views.items()}
        constrained = [[constraint.source, constraint.to] for constraint in self.constraints]
        check_distinct_drives(self._path, drives)
        for lidar in (FIRST_LIDAR, *self.lidars):
            own = {view.camera: drives[name] for name, view in views.items() if view.lidar == lidar}
            key = "cameras" if lidar == FIRST_LIDAR else f"lidars.{lidar}.cameras"
            check_one_lidar(f"{self._path}: {key}", own, constrained)
        check_cameras(self._path, {name: (view.camera, drives[name]) for name, view in views.items()})
        if self.lidars:
            view_drives = {name: (view.camera, view.lidar, drives[name]) for name, view in views.items()}
            check_lidars(self._path, view_drives)
        return drives

    def reference(self, to: str, other: str) -> Pose | None:
        """Return the reference T_to_other (4, 4) of two cameras or LiDARs, stated in either direction, or None."""
        references = self.T_camera_camera | self.T_lidar_lidar
        if (T := references.get(to, {}).get(other)) is not None:
            return nearest_rigid(np.array(T))
        if (T := references.get(other, {}).get(to)) is not None:
            return inverse(nearest_rigid(np.array(T)))
        return None

    def _reached(self) -> set[str]:
        """Return the sensors that something ties to the first LiDAR."""
        ties = [{view.camera, view.lidar} for view in self.views.values()]
        ties += [{*constraint.sensors} for constraint in self.constraints]
        ties += [
            {FIRST_LIDAR, name}
            for name, lidar in self.lidars.items()
            if lidar.is_registered and self.reference(FIRST_LIDAR, name) is not None
        ]
        reached = {FIRST_LIDAR}
        for _ in ties:
            reached = reached.union(*(tie for tie in ties if not reached.isdisjoint(tie)))
        return reached


def view_name(camera: str, lidar: str) -> str:
    """Name the result of a camera with a further LiDAR."""
    return f"{camera}_on_{lidar}"


def find_rig(path: Path) -> Rig | None:
    """Read the rig that a path names.

    Args:
        path: A file, or a folder with a rig.yaml and no drive.yaml.

    Returns:
        The rig; None if the path names a drive, a recording, a data set or a file of data.

    Raises:
        InputError: the file does not exist or is wrong.
    """
    if is_folder(path):
        file = path / RIG_FILE
        return read_rig(file) if file.exists() and not (path / DRIVE_FILE).exists() else None
    # Data are not read, and a file without the key is not parsed, which would take time for a long drive.
    if kind_of_data(path) is not None or recognise(path) is not None or RIG.encode() not in read_bytes(path):
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


def _check_names(names: Iterable[str], kind: str) -> None:
    """Check names of sensors, after which results are named.

    Raises:
        ValueError: a name is no file's, or that of the rig's own result, or two differ in case only.
    """
    for name in names:
        if not NAME.fullmatch(name):
            raise mismatch(describe(name), f"a {kind} name of letters, digits, _, - and .")
        if name.lower() == RESULT:
            raise mismatch(describe(name), "a name that differs from that of the rig's own result")
    _check_cases(names)


def _check_cases(names: Iterable[str]) -> None:
    """Check that no two names are the same up to case.

    Raises:
        ValueError: two are.
    """
    by_lower_case: dict[str, str] = {}
    for name in names:
        if (other := by_lower_case.get(name.lower())) is not None:
            if other == name:
                raise mismatch(f"{name!r} for two things", "a name for each camera, LiDAR and result")
            raise mismatch(f"{other!r} and {name!r}", "names that differ in more than case")
        by_lower_case[name.lower()] = name


def _check_references(key: str, references: References, kind: str, known: Collection[str]) -> None:
    """Check that reference transforms are between sensors of a rig, each pair in one direction.

    Raises:
        ValueError: they are not.
    """
    for to, others in references.items():
        for name in (to, *others):
            if name not in known:
                raise ValueError(f"{key}: found {kind} {describe(name)}, expected {one_of(name, known)}")
        if to in others:
            raise ValueError(f"{key}: found {to!r} under itself, expected two different {kind}s")
        for other in others:
            if to in references.get(other, {}):
                raise ValueError(
                    f"{key}: found {to!r} and {other!r} in both directions, expected one of them"
                )
