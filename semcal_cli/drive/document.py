"""The drive: the input of a calibration, described by a `drive.yaml`."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, Field, PrivateAttr, field_validator, model_validator
from typing_extensions import Unpack

from semcal_cli.config import MAX_POINTS
from semcal_cli.config.data_suffixes import kind_of_data
from semcal_cli.config.point_files import (
    MAX_UNIT_S,
    SECONDS_PER_UNIT,
    NamedUnit,
    PointColumn,
    PointForm,
    PointType,
)
from semcal_cli.config.synchronization import Synchronization
from semcal_cli.drive.camera import Camera
from semcal_cli.drive.class_ids import Classes, Color, Ignore
from semcal_cli.drive.frame_ids import FrameIds
from semcal_cli.drive.frames import FILES, Frame
from semcal_cli.drive.held_arrays import ArrayInput, HeldArrays, document_of
from semcal_cli.drive.lidar import Lidar
from semcal_cli.drive.networks import LabelNetworks
from semcal_cli.drive.stated_motion import Motion
from semcal_cli.errors import InputError, MisplacedError, describe, mismatch, shell
from semcal_cli.files.array_forms import SweepCloud
from semcal_cli.files.documents import FORMATS, read_document
from semcal_cli.files.image_levels import ImageLevels
from semcal_cli.files.input_files import is_folder, read_start
from semcal_cli.files.validation import (
    RigidTransform,
    StrictModel,
    Version,
    check_distinct,
    length,
    validate,
)
from semcal_cli.geometry.arrays import Numbers, Points

DRIVE_FILE = "drive.yaml"
RIG_FILE = "rig.yaml"
"""File of a rig of several cameras; see `semcal_cli.many.rig`."""
SUFFIXES = (".yaml", ".yml")
"""Suffixes of a drive's file; any other name is its folder."""
RIG = "semcal_rig"
"""Version key of a rig."""
RIG_FOUND = (
    "found a rig, which only `semcal calibrate`, `verify`, `inspect`, `report` and `overlay` accept, expected the "
    "drive of one of its cameras"
)
EXAMPLE_RIG = f"{{{RIG}: 1, cameras: {{left: left_drive, right: right_drive}}}}"
CALIBRATIONS = {"semcal_calibration", "semcal_transform", "semcal_fleet", "semcal_rig_calibration"}
"""Version keys of files with a transform, found in place of a drive if arguments are in the wrong order."""
IMPORT_COMMAND = shell(
    *("import", "folder", "--points", "GLOB", "--images", "GLOB", "--camera-info", "FILE", "-o", "my_drive")
)
"""Command that makes a drive of clouds and images."""
START_BYTES = 1024
"""Number of bytes searched for a zero, which no text has."""
DEFAULT_CLOCK_SIGMA_S = 0.02
"""Standard deviation of the clock of a camera without a trigger, in seconds."""
MAX_OFFSET_S = 1.0
TimeOffset = Annotated[float, Field(ge=-MAX_OFFSET_S, le=MAX_OFFSET_S)]
"""Offset of two clocks, in seconds. Sweeps and images that are farther apart are not pairs."""


def _check_unit(unit: object) -> object:
    is_length = isinstance(unit, int | float) and not isinstance(unit, bool) and 0.0 < unit <= MAX_UNIT_S
    if not is_length and not (isinstance(unit, str) and unit in SECONDS_PER_UNIT):
        raise mismatch(
            describe(unit), f"{', '.join(SECONDS_PER_UNIT)}, or its length in seconds, such as 0.1"
        )
    return unit


TimeUnit = Annotated[NamedUnit | Annotated[float, Field(gt=0.0, le=MAX_UNIT_S)], BeforeValidator(_check_unit)]


class Drive(StrictModel):
    """Content of a drive.yaml. The files that it names are opened when they are loaded."""

    semcal_drive: Version
    """Version of this format."""
    camera: Camera
    """Camera of the drive. Its intrinsics are assumed to be right unless they are estimated together with the pose."""
    lidar: Lidar | None = None
    """Scan pattern of the LiDAR, estimated from the points if absent, its own points, where its rays start, and how it
    turns."""
    frame_ids: FrameIds | None = None
    """Names of the coordinate frames, as the recording has them; `semcal convert` writes them."""
    frames: Annotated[tuple[Frame, ...], length(1)]
    """Frames of one rig."""
    ignore: Ignore = Ignore()
    """Ids that carry no information."""
    classes: Classes | None = None
    """Names of classes and the raw ids merged into each."""
    palette: Annotated[dict[str, Color], Field(min_length=1, max_length=255)] | None = None
    """Red, green and blue of each class in colour-coded label images; other colours carry no information."""
    point_columns: Annotated[tuple[PointColumn, ...], length(3, 64)] | None = None
    """Columns of the `.bin` files of points; `_` is one that is not used. If absent: x y z intensity, and ring in a
    `.pcd.bin`, if the numbers are in these columns."""
    point_type: PointType = "f4"
    """Type of the numbers in `.bin` files of points: float32 (f4) or float64 (f8), little endian."""
    time_unit: TimeUnit | None = None
    """Unit of the times of points: s, ms, us, ns, or its length in seconds, such as 0.1 for times from 0 to 1 in sweeps
    of 0.1 s. If absent, whole numbers are nanoseconds and others seconds."""
    motion: Motion | None = None
    """Motion of the LiDAR, which moves points to the time of the image."""
    synchronization: Synchronization = "unknown"
    """What ties the images to the moments of the sweeps: `hardware`, if the LiDAR triggers the camera or one signal
    triggers both; `stamps`, if each was paired by its recorded time; `unknown`, if nothing is known."""
    time_offset_s: TimeOffset = 0.0
    """Time by which images are later than image_stamp says, in seconds; negative if they are earlier. It has
    an effect only with a motion."""
    time_offset_sigma_s: Annotated[float, Field(ge=0.0, le=MAX_OFFSET_S)] = DEFAULT_CLOCK_SIGMA_S
    """Standard deviation of `time_offset_s`, in seconds, as known beforehand; 0 if the camera is triggered. If the
    drive states its motion, it is part of the interval, as far as the frames do not determine the offset."""
    networks: LabelNetworks | None = None
    """Networks that made the labels, as written by `semcal label`; a result repeats them."""
    T_camera_lidar: RigidTransform | None = None
    """Known transform, p_camera = T_camera_lidar * p_lidar: for comparisons, and a start where labels do not find the
    mounting."""

    _path: Path = PrivateAttr(default=Path(DRIVE_FILE))
    _max_points: int = PrivateAttr(default=MAX_POINTS)
    _arrays: HeldArrays | None = PrivateAttr(default=None)
    _sweep_gap_s: float | None = PrivateAttr(default=None)
    _image_levels: ImageLevels = PrivateAttr(default=ImageLevels())

    def model_post_init(self, _context: object) -> None:
        """Measure how far sweeps are apart: a copy with fewer frames keeps that of all frames."""
        stamps = {frame.points: frame.points_stamp for frame in self.frames if frame.points_stamp is not None}
        ordered = sorted(set(stamps.values()))
        gaps = sorted(after - before for before, after in pairwise(ordered))
        self._sweep_gap_s = gaps[len(gaps) // 2] if gaps else None

    @classmethod
    def from_arrays(cls, **arrays: Unpack[ArrayInput]) -> Drive:
        """Make a drive from arrays instead of files. Nothing is copied, and nothing is written.

        Messages and results name the arrays, such as `points[3]`, in place of files.

        Args:
            arrays: The arrays and the keys of a drive.yaml: see `ArrayInput`.

        Raises:
            InputError: an argument is missing or wrong; the message names it, what was found and what was needed.
        """
        document, held_arrays = document_of(arrays)
        path = Path(arrays.get("name", "arrays"))
        drive = validate(cls, document, path)
        if (
            drive.motion is not None
            and drive.motion.poses is not None
            and drive.motion.poses not in held_arrays.by_name
        ):
            raise InputError(
                f"{path}: motion.poses: found {drive.motion.poses!r}, expected 'poses', the array"
            )
        if drive.lidar is not None and drive.lidar.own_points is not None:
            needed = "expected none: arrays have no fields; pass the LiDAR's own points alone"
            raise InputError(f"{path}: lidar.own_points: found {drive.lidar.own_points.field!r}, {needed}")
        drive._path, drive._arrays = path, held_arrays
        return drive

    @field_validator("point_columns")
    @classmethod
    def _check_columns(cls, columns: tuple[PointColumn, ...] | None) -> tuple[PointColumn, ...] | None:
        used = [column for column in columns or "xyz" if column != "_"]
        if missing := [axis for axis in "xyz" if axis not in used]:
            raise mismatch(f"no {missing[0]}", "x, y and z")
        if twice := [column for column in used if used.count(column) > 1]:
            raise mismatch(f"{twice[0]} twice", "each column once; _ is a column that is not used")
        return columns

    @model_validator(mode="after")
    def _check_form(self) -> Drive:
        """Check that what is stated about `.bin` files is used."""
        if self.point_columns is None and self.point_type != "f4":
            raise mismatch(f"point_type {self.point_type} without point_columns", "both, or neither")
        names = [frame.points.lower() for frame in self.frames]
        if self.point_columns is not None and not any(name.endswith(".bin") for name in names):
            raise mismatch("point_columns and no .bin file of points", "none: other files say what they hold")
        return self

    @field_validator("palette")
    @classmethod
    def _check_colors(cls, palette: dict[str, tuple[int, ...]] | None) -> dict[str, tuple[int, ...]] | None:
        check_distinct({name: [f"color {list(color)}"] for name, color in (palette or {}).items()})
        return palette

    @property
    def path(self) -> Path:
        """The file that was read."""
        return self._path

    @property
    def argument(self) -> Path:
        """The drive as an argument of a command: its folder, unless its file has another name than usual."""
        return self.path.parent if self.path.name == DRIVE_FILE else self.path

    @property
    def root(self) -> Path:
        """The folder that the paths in the file are relative to."""
        return self._path.parent

    @property
    def max_points(self) -> int:
        """Size of the largest sweep that is read, in points."""
        return self._max_points

    @property
    def sweep_gap_s(self) -> float | None:
        """Median time from one sweep to the next, in seconds; None without stamps of two sweeps."""
        return self._sweep_gap_s

    @property
    def first_stamp(self) -> float | None:
        """Stamp of the first frame, in seconds; None without stamps."""
        frame = self.frames[0]
        return frame.points_stamp if frame.points_stamp is not None else frame.image_stamp

    def point_times(self, cloud: SweepCloud) -> tuple[Numbers, bool] | None:
        """Return when the points of a sweep were measured, where its file or the spin of the LiDAR tells it.

        Returns:
            Times (N,) in seconds, and whether they follow from the spin, as seconds after `points_stamp`, instead of
            being those of the file. None if neither tells them, or if `motion` states that sweeps are deskewed. Times
            of a file that are all alike tell nothing.
        """
        if self.motion is not None and self.motion.point_times == "deskewed":
            return None
        if cloud.time is not None and np.ptp(cloud.time) != 0.0:
            return cloud.time, False
        if self.lidar is None or self.lidar.spin is None:
            return None
        return self.lidar.spin.times(self.rays(cloud.points)), True

    @property
    def point_form(self) -> PointForm:
        """What the drive states about its files of points."""
        own_points = None if self.lidar is None else self.lidar.own_values
        return PointForm(self.point_columns, self.point_type, self.time_unit, own_points)

    @property
    def arrays(self) -> HeldArrays | None:
        """The arrays in place of files; None for a drive from files."""
        return self._arrays

    @property
    def image_levels(self) -> tuple[int, int] | None:
        """Values of 16-bit images that are shown as black and as white; None without such images."""
        return self._image_levels.get()

    def files(self) -> Iterator[str]:
        """List the names of all files of the drive."""
        for frame in self.frames:
            yield from filter(None, (getattr(frame, key) for key in FILES))
        if self.motion and self.motion.poses:
            yield self.motion.poses
        if isinstance(self.camera.mask, str):
            yield self.camera.mask

    def resolve(self, relative: str) -> Path:
        """Locate a file of the drive. Absolute names stay as they are; neither `~` nor `$VAR` is expanded."""
        return self.root / relative

    @property
    def origin_m(self) -> tuple[float, ...]:
        """Where the rays of the LiDAR start (3,), metres, LiDAR frame."""
        return (0.0, 0.0, 0.0) if self.lidar is None else self.lidar.origin_m

    def rays(self, points: Points) -> Points:
        """Compute the vectors (N, 3) from where the LiDAR's rays start to points (N, 3), metres, LiDAR frame."""
        return points if self.lidar is None else self.lidar.rays(points)

    def name_of(self, frame: Frame, key: str, needed: str) -> str:
        """Return the name of a file, or of an array, that a frame must have.

        Raises:
            InputError: the frame has none; `needed` says what was needed.
        """
        name: str | None = getattr(frame, key)
        if name is None:
            raise InputError(f"{self.path}: {frame.key(key)}: found nothing, expected {needed}")
        return name

    def file_of(self, frame: Frame, key: str, needed: str) -> Path:
        """Locate a file that a frame must have; raises `InputError` as `name_of` does."""
        return self.resolve(self.name_of(frame, key, needed))


def drive_file(path: Path) -> Path:
    """Locate the drive.yaml of a drive, given by its folder or by the file."""
    return path / DRIVE_FILE if is_folder(path) else path


def read_drive(path: Path | str, max_points: int = MAX_POINTS) -> Drive:
    """Read and check a drive, given by its folder or by its drive.yaml.

    Args:
        path: The folder or the file.
        max_points: Size of the largest sweep that may be read from its files, now or later.

    Raises:
        InputError: the drive is wrong; the message names the file, the key, what was found and what was needed.
        MisplacedError: the file holds a transform.
    """
    path = Path(path)
    file = drive_file(path)
    if is_folder(path) and not file.exists():
        if (path / RIG_FILE).exists():
            raise InputError(f"{path / RIG_FILE}: {RIG_FOUND}")
        what = f"a folder without a {DRIVE_FILE} that is no known data set either"
        raise InputError(f"{path}: found {what}; `semcal import --help` lists what makes a drive")
    _check_no_data(file)
    document = read_document(file)
    if RIG in document:
        raise InputError(f"{file}: {RIG_FOUND}")
    if file.name == RIG_FILE:
        raise InputError(f"{file}: found no key {RIG}, expected a rig such as {EXAMPLE_RIG}")
    if CALIBRATIONS & document.keys():
        raise MisplacedError(f"{file}: found a calibration, expected a drive")
    drive = validate(Drive, document, file)
    drive._path, drive._max_points = file, max_points
    drive._image_levels = ImageLevels([drive.resolve(frame.image) for frame in drive.frames if frame.image])
    return drive


def _check_no_data(file: Path) -> None:
    """Refuse a file of data, such as a point cloud, that is given in the place of a drive."""
    is_binary = b"\0" in read_start(file, START_BYTES)
    kind = kind_of_data(file)
    if kind is None and is_binary and file.suffix.lower() not in FORMATS:
        kind = "a file that is not text"
    if kind is not None:
        needed = f"a {DRIVE_FILE} or its folder"
        raise InputError(
            f"{file}: found {kind}, expected {needed}; `{IMPORT_COMMAND}` makes one of clouds and images"
        )


def output_drive_file(output: Path) -> Path:
    """Locate the drive.yaml of a drive to write, given by its folder or by the file; neither has to exist."""
    return output if output.suffix in SUFFIXES else output / DRIVE_FILE
