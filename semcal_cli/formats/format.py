"""The interface of a format of transforms, a source file, and the options for what a file leaves open."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from semcal_cli.drive.document import Camera
from semcal_cli.errors import InputError
from semcal_cli.files.dialect import document_text
from semcal_cli.files.documents import parse_any
from semcal_cli.files.reading import read_bytes
from semcal_cli.files.streams import STANDARD_INPUT, read_standard_input
from semcal_cli.formats.names import (
    cameras_among,
    check_two,
    has_camera_word,
    has_lidar_word,
    has_optical_word,
    is_ambiguous,
)
from semcal_cli.formats.values import rigid
from semcal_cli.geometry.poses import (
    OPTICAL_AXES,
    Pose,
    inverse,
    nearest_rigid,
    pose_from_quaternion,
    quaternion_xyzw,
)

Direction: TypeAlias = Literal["lidar-to-camera", "camera-to-lidar"]
"""Direction of a matrix: p_camera = T p_lidar, or p_lidar = T p_camera."""
CameraFrame: TypeAlias = Literal["optical", "body"]
"""Axes of a camera's frame. Optical: x right, y down, z forward. Body: x forward, y left, z up (ROS REP 103)."""

LIDAR, CAMERA, CAMERA_BODY = "lidar", "camera_optical_frame", "camera_link"
"""Default names of the frames."""

T_BODY_OPTICAL = np.eye(4)
T_BODY_OPTICAL[:3, :3] = OPTICAL_AXES


@dataclass(frozen=True)
class FormatOptions:
    """Options of the user for what a file leaves open."""

    direction: Direction | None = None
    frame: CameraFrame | None = None
    """Axes of the camera's frame in the file."""
    camera: str | None = None
    """Name in the file of the camera's frame, entry or token."""
    lidar: str | None = None
    """Name in the file of the LiDAR's frame, entry or token."""
    file: Path | None = None
    """Path of the file to write or edit, if there is one."""
    intrinsics: Camera | None = None
    """Camera whose intrinsics are written beside the transform, where the format has a place for them. Into a file of
    the user's they are set where the file has them already."""
    time_offset_s: float | None = None
    """Time by which pictures are later than their stamps, in seconds, to be set in a drive of the user's; None leaves
    what the drive says."""
    on_note: Callable[[str], None] | None = None
    """Called with what was set of the intrinsics and of the clock in a file of the user's, or why nothing was, and
    with a warning of a transform that is not trusted."""
    on_repair: Callable[[str], None] | None = None
    """Called for each invalid rotation that the nearest rotation replaces; None refuses such files."""


@dataclass(frozen=True)
class Source:
    """A file that may hold a transform."""

    path: Path
    content: bytes

    @classmethod
    def read(cls, path: Path) -> Source:
        """Read a file, or standard input by the name of `STANDARD_INPUT`.

        Raises:
            InputError: the file is missing, or too large to hold a transform.
        """
        return cls(path, read_standard_input() if path == STANDARD_INPUT else read_bytes(path))

    @property
    def text(self) -> str:
        """Content of the file as text.

        Raises:
            InputError: the content is not UTF-8.
        """
        try:
            return self.content.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise InputError(f"{self.path}: byte {error.start} is not UTF-8, needed text") from None

    @cached_property
    def document(self) -> Any:
        """Content of the file as JSON or YAML, chosen by its suffix.

        Raises:
            InputError: the content is not well-formed, or too large.
        """
        if self.path.suffix.lower() != ".json" and len(self.content) > MAX_YAML_BYTES:
            raise InputError(
                f"{self.path}: found {len(self.content):,} bytes of YAML, needed at most {MAX_YAML_BYTES:,}"
            )
        if self.path == STANDARD_INPUT and self.text.lstrip().startswith(("{", "[")):
            # It has no suffix. What is no JSON may be YAML in braces.
            with suppress(InputError):
                return parse_any(self.text, self.path.with_suffix(".json"))
        return parse_any(self.text, self.path)

    @cached_property
    def mapping(self) -> dict[Any, Any]:
        """The document if it is a mapping, else an empty mapping, for recognising formats."""
        found = self._quietly()
        return found if isinstance(found, dict) else {}

    @cached_property
    def records(self) -> list[dict[Any, Any]]:
        """The document if it is a list of mappings, else an empty list, for recognising formats."""
        found = self._quietly()
        is_so = isinstance(found, list) and all(isinstance(item, dict) for item in found)
        return found if is_so else []

    def _quietly(self) -> Any:
        try:
            return self.document
        except InputError:
            return None


MAX_YAML_BYTES = 1_000_000
"""Largest size of a YAML file with a transform."""

FRAMES = ("frame", "camera", "lidar")
"""Options that files with named frames leave open."""
Put: TypeAlias = Callable[[Any, Pose, FormatOptions], None]


@dataclass(frozen=True)
class Format:
    """A format of transforms, or of a camera's intrinsics, with its reader and writer."""

    name: str
    equation: str
    """Equation of the stored transform, and the place of its numbers in the file."""
    recognises: Callable[[Source], bool]
    read: Callable[[Source, FormatOptions], Pose]
    """Reads T_camera_lidar; raises `InputError` if the file is wrong or leaves something open."""
    write: Callable[[Pose, FormatOptions], bytes]
    """Makes a new file of T_camera_lidar; raises `InputError` if an option is missing."""
    put: Put | None = None
    """Replaces the transform in a document and leaves the rest; None if files of the format cannot be edited."""
    asks: tuple[str, ...] = ()
    """Options among `direction`, `frame`, `camera` and `lidar` that its files leave open."""
    has_transform: bool = True
    """Whether its files hold a transform; one without holds only intrinsics."""


def document_writer(put: Put, *, as_json: bool = False) -> Callable[[Pose, FormatOptions], bytes]:
    """Make a writer that puts a transform into an empty document, written as JSON if asked or if the suffix says so."""

    def write(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
        document: dict[str, Any] = {}
        put(document, T_camera_lidar, options)
        is_json = as_json or (options.file is not None and options.file.suffix.lower() == ".json")
        return document_text(document, "json" if is_json else "yaml").encode()

    return write


def no_new_file(name: str, relative_to: str, file: str) -> Callable[[Pose, FormatOptions], bytes]:
    """Refuse to write a new file, where poses of camera and LiDAR mean something only beside each other.

    Args:
        name: The format's name.
        relative_to: Name of the frame that poses are relative to.
        file: Name of the files that a transform can be put into.
    """

    def write(T_camera_lidar: Pose, options: FormatOptions) -> bytes:
        needed = f"needed --into a {file} with the LiDAR's own entry"
        raise InputError(f"--to {name}: poses are relative to the {relative_to}, {needed}")

    return write


def checked(where: str, T: Pose, options: FormatOptions) -> Pose:
    """Check a transform that a file states, and remove its rounding; if repairs are allowed, take the nearest one.

    Raises:
        InputError: the transform is not rigid, or farther than any rig.
    """
    if options.on_repair is None or not np.isfinite(T).all():
        try:
            return rigid(where, T)
        except InputError as error:
            repair = "; --repair takes the nearest rotation" if "needed a rotation" in str(error) else ""
            raise InputError(f"{error}{repair}") from None
    _, scales, _ = np.linalg.svd(T[:3, :3])
    nearest = nearest_rigid(T)
    is_rotation = np.linalg.det(nearest[:3, :3]) > 0.0 and scales[-1] > LEAST_SCALE * scales[0]
    if is_rotation and np.abs(scales - 1.0).max() > ROUNDING:
        options.on_repair(
            f"{where}: found no rotation (determinant {np.prod(scales):.4g}, rows stretched by {scales[-1]:.4g} to "
            f"{scales[0]:.4g}), took the nearest"
        )
        return rigid(where, nearest)
    return rigid(where, T)


ROUNDING = 1e-6
LEAST_SCALE = 1e-3
"""Least ratio of the rows' scales; rows with a smaller one come from no rotation, and none is near."""


def from_rows(where: str, values: npt.ArrayLike, options: FormatOptions) -> Pose:
    """Make a transform from the 12 or 16 numbers of its rows.

    Raises:
        InputError: the numbers are not a rigid transform.
    """
    rows = np.array(values, np.float64).reshape(-1, 4)
    return checked(
        where, np.vstack([rows[:3], rows[3:] if len(rows) == 4 else [[0.0, 0.0, 0.0, 1.0]]]), options
    )


def from_quaternion(where: str, xyzw: list[float], xyz: list[float], options: FormatOptions) -> Pose:
    """Make a transform from a unit quaternion and a translation in metres.

    Raises:
        InputError: the quaternion is not of unit norm, or the translation farther than any rig.
    """
    norm = math.hypot(*xyzw)
    if options.on_repair is not None and norm > 0.0 and abs(norm - 1.0) > ROUNDING:
        options.on_repair(f"{where}: found a quaternion of norm {norm:.6g}, scaled it to 1")
        xyzw = [value / norm for value in xyzw]
    try:
        return rigid(where, pose_from_quaternion(xyzw, xyz))
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None


def from_rpy(where: str, rpy_rad: list[float], xyz: list[float]) -> Pose:
    """Make a transform from URDF angles, R = Rz(yaw) Ry(pitch) Rx(roll) in radians, and a translation in metres."""
    from scipy.spatial.transform import Rotation

    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", rpy_rad).as_matrix()
    T[:3, 3] = xyz
    return rigid(where, T)


def xyz(T: Pose) -> list[float]:
    """Translation in metres."""
    values: list[float] = T[:3, 3].tolist()
    return values


def wxyz(T: Pose) -> list[float]:
    """Unit quaternion, w first."""
    x, y, z, w = quaternion_xyzw(T).tolist()
    return [w, x, y, z]


def turned(where: str, T: Pose, options: FormatOptions) -> Pose:
    """Apply the user's direction to a transform whose file does not state one: T_camera_lidar, or its inverse.

    Raises:
        InputError: the user does not state the direction either.
    """
    if options.direction is None:
        option = "--to-direction" if where.startswith("--to") else "--direction"
        needed = f"needed {option} lidar-to-camera (p_camera = T p_lidar) or camera-to-lidar"
        raise InputError(f"{where}: found a transform of no stated direction, {needed}")
    return T if options.direction == "lidar-to-camera" else inverse(T)


def between(where: str, T_parent_child: Pose, parent: str, child: str, options: FormatOptions) -> Pose:
    """Convert a transform between two named frames, p_parent = T p_child, to T_camera_lidar.

    Raises:
        InputError: the names do not tell which frame is the camera's, or whether it is an optical one, and the user
            does not state it.
    """
    camera = camera_frame(where, parent, child, options)
    T_lidar_camera = T_parent_child if camera == child else inverse(T_parent_child)
    return inverse(T_lidar_camera @ optical_axes(where, camera, options))


def camera_frame(where: str, parent: str, child: str, options: FormatOptions, prefix: str = "--") -> str:
    """Find which of two frames is the camera's; the other one is the LiDAR's. Option names begin with `prefix`.

    Raises:
        InputError: the names do not tell, and the user does not state it.
    """
    if parent == child:
        raise InputError(f"{where}: found frame {parent!r} as parent and as child, needed two frames")
    found = f"{where}: found frames {parent!r} and {child!r}"
    cameras = cameras_among((parent, child), options.lidar)
    is_told = len(cameras) == 1 and not is_ambiguous(cameras[0])
    camera = options.camera or (cameras[0] if is_told else None)
    if camera not in (parent, child):
        raise InputError(f"{found}, needed {prefix}camera to name the camera's")
    lidar = parent if camera == child else child
    if options.lidar not in (None, lidar):
        raise InputError(f"{found}, needed {options.lidar!r} as {prefix}lidar says")
    if options.lidar is None and (not has_lidar_word(lidar) or has_camera_word(lidar)):
        raise InputError(
            f"{where}: found frame {lidar!r}, needed {prefix}lidar {lidar} if it is the LiDAR's own"
        )
    return camera


def optical_axes(where: str, camera: str, options: FormatOptions, prefix: str = "--") -> Pose:
    """T_frame_optical of a camera's frame, by its name or by the user's option.

    Raises:
        InputError: neither the name nor an option tells the axes.
    """
    frame = options.frame or ("optical" if has_optical_word(camera) else None)
    if frame is None:
        needed = (
            f"needed {prefix}frame optical (x right, y down, z forward) or body (x forward, y left, z up)"
        )
        raise InputError(f"{where}: found the camera's frame {camera!r}, {needed}")
    return np.eye(4) if frame == "optical" else T_BODY_OPTICAL


def named(T_camera_lidar: Pose, options: FormatOptions) -> tuple[Pose, str, str]:
    """T_lidar_frame of the camera's frame to write, and the names of the LiDAR's and the camera's frame."""
    for name in filter(None, (options.lidar, options.camera)):
        if not name.isprintable():
            raise InputError(f"--to-camera, --to-lidar: found {name!r}, needed a name that can be printed")
    is_body = options.frame == "body"
    T = inverse(T_camera_lidar) @ (inverse(T_BODY_OPTICAL) if is_body else np.eye(4))
    lidar, camera = options.lidar or LIDAR, options.camera or (CAMERA_BODY if is_body else CAMERA)
    check_two("--to-camera, --to-lidar", camera, lidar, "two names")
    return T, lidar, camera
