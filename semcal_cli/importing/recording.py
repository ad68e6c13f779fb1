"""The request to a data set and the recording that it returns."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypeVar, get_origin

import numpy as np
import numpy.typing as npt

from semcal_cli.config.nanoseconds import NS
from semcal_cli.config.point_files import AS_USUAL, PointForm
from semcal_cli.config.setting import settings_of
from semcal_cli.config.synchronization import Synchronization
from semcal_cli.errors import InputError, counted, describe
from semcal_cli.geometry.arrays import Points, Pose
from semcal_cli.importing.dataset_tree import need_folder, speeds_mps
from semcal_cli.importing.ontologies import Ontology
from semcal_cli.importing.stamps import are_covered
from semcal_cli.importing.sweep_odometry import SIGMA

Kind = TypeVar("Kind")


@dataclass(frozen=True)
class Request:
    """What the user asks of a data set."""

    root: Path
    """Folder of the data set."""
    sequence: str | None = None
    """Name of the sequence; None for the only one."""
    camera: str | None = None
    """Name of the camera; None for the data set's default."""
    version: str | None = None
    """Folder of nuScenes' tables, release of CARLA, or what the data set of a plugin declares to read."""
    rectified: bool | None = None
    """Whether KITTI-360's images are the rectified ones or the raw ones; None for the camera's default."""
    lidar: str | None = None
    """Name of the LiDAR, in data sets of plugins that declare to read it; None for the data set's default."""

    def __post_init__(self) -> None:
        """Check that the folder exists.

        Raises:
            InputError: the folder does not exist.
        """
        need_folder(self.root)


@dataclass(frozen=True)
class Cloud:
    """A point cloud that had to be converted."""

    points: Points
    """(N, 4) x, y, z in metres in the LiDAR frame, and the intensity, 0 where unknown."""
    labels: npt.NDArray[np.uint32] | None
    """(N,) ids of the points; None without labels."""


Guard: TypeAlias = Callable[[Callable[[], Cloud]], Callable[[], Cloud]]
"""Wraps the function of a plugin's conversion, so that its errors name the plugin."""


@dataclass(frozen=True)
class Conversion:
    """Conversion of a cloud that the data set does not store in the form that a drive needs."""

    cloud: Callable[[], Cloud]
    """Function that makes the cloud."""
    has_labels: bool
    """Whether the cloud has labels that are written with it."""
    file: Path
    """File that the points come from."""
    in_order: bool
    """Whether the points are those of the file, in its order. If not, no other label file can fit."""


@dataclass(frozen=True)
class SourceFrame:
    """A sweep and the image taken with it, as files of the data set."""

    name: str
    """Number or name of the frame in the data set."""
    points: Path | Conversion
    """File of the cloud, or the conversion that makes it."""
    point_labels: Path | None = None
    """File of the point labels."""
    image_labels: Path | None = None
    """File of the label image."""
    image: Path | None = None
    """File of the image."""
    points_stamp: float | None = None
    """Time of the sweep, in seconds."""
    image_stamp: float | None = None
    """Time of the image, in seconds."""
    cloud_has_labels: bool = False
    """Whether the file of the cloud has a field of labels."""
    speed_mps: float | None = None
    """Speed of the rig, in metres per second."""
    T_camera_lidar: Pose | None = None
    """Reference transform (4, 4) of this frame, if it includes the motion between sweep and image."""
    label_names: tuple[str, ...] = ()
    """Further names, without suffix, that a label file of this frame may have."""

    @property
    def gap_s(self) -> float:
        """Time between the sweep and the image, in seconds; 0 where a stamp is unknown."""
        if self.points_stamp is None or self.image_stamp is None:
            return 0.0
        return abs(self.points_stamp - self.image_stamp)

    @property
    def cloud_file(self) -> Path | None:
        """The file that holds the points in their order, or None."""
        if isinstance(self.points, Conversion):
            return self.points.file if self.points.in_order else None
        return self.points

    @property
    def has_point_labels(self) -> bool:
        """Whether the points have labels, in a file of their own, in the cloud's or from the conversion."""
        has_converted_labels = isinstance(self.points, Conversion) and self.points.has_labels
        return has_converted_labels or self.cloud_has_labels or self.point_labels is not None


def join_frames(
    clouds: Mapping[str, Path | Conversion],
    *,
    missing: str,
    needs: tuple[str, ...] = ("image",),
    **values: Mapping[Any, Any],
) -> list[SourceFrame]:
    """Join each cloud with the values that have its name or its number into a frame.

    Args:
        clouds: Clouds by the names of their frames.
        missing: Message of the error if there is no frame.
        needs: Fields of which a frame needs at least one.
        values: Values of fields of `SourceFrame`, by the names of the frames, or by their numbers if these are numeric.

    Raises:
        InputError: there is no frame.
    """
    frames = []
    for name, points in clouds.items():
        keys: tuple[str | int, ...] = (name, int(name)) if name.isdecimal() else (name,)
        fields = {field: column[key] for field, column in values.items() for key in keys if key in column}
        if fields.keys() & set(needs):
            frames.append(SourceFrame(name, points, **fields))
    if not frames:
        raise InputError(missing)
    return frames


@dataclass(frozen=True)
class Recording:
    """One sequence of a data set as one of its cameras sees it."""

    camera: Mapping[str, Any]
    """The `camera:` block of a drive."""
    frames: Sequence[SourceFrame]
    """Frames in order of time."""
    T_camera_lidar: Pose | None = None
    """Reference transform (4, 4), p_camera = T_camera_lidar * p_lidar; None if unknown or if each frame has its own."""
    lidar: Mapping[str, Any] | None = None
    """The `lidar:` block of a drive, if the scan pattern is known."""
    frame_ids: Mapping[str, str] | None = None
    """The `frame_ids:` block of a drive, if the data name their coordinate frames."""
    point_classes: Ontology | None = None
    """Classes of the point labels."""
    image_classes: Ontology | None = None
    """Classes of the label images."""
    ids_in_red: bool = False
    """Whether the label images are colours whose red is the id, and whose green and blue are 0."""
    point_form: PointForm = AS_USUAL
    """Columns of `.bin` clouds and unit of point times, where they are not the usual ones."""
    motion: Mapping[str, Any] | None = None
    """The `motion:` block of a drive, if the motion of the LiDAR is known; without `poses`, if those follow."""
    synchronization: Synchronization = "unknown"
    """What ties the images to the moments of the sweeps."""
    remarks: tuple[str, ...] = ()
    """Sentences that the user should read."""
    read: tuple[Path, ...] = ()
    """YAML files that were read, which a drive.yaml must not overwrite."""
    labels_by: str | None = "DIR"
    """Placeholder of the values of --point-labels and --image-labels in messages; None if `semcal label` makes them."""
    poses: Mapping[int, Pose] | None = None
    """Poses (4, 4) of the LiDAR by their times in nanoseconds, ascending, which are written beside the drive.yaml."""
    time_offset_s: float = 0.0
    """Time by which images are later than their stamps say, in seconds."""
    time_offset_sigma_s: float | None = None
    """Its standard deviation, in seconds; None for the default of a drive."""


def with_poses(
    recording: Recording,
    frames: Sequence[SourceFrame],
    poses: Mapping[int, Pose],
    motion: Mapping[str, Any],
    remark: str,
) -> Recording:
    """Add poses of the LiDAR to a recording, with the `motion:` block without them, and keep the frames they cover."""
    remarks = [remark]
    if left_out := len(recording.frames) - len(frames):
        remarks.append(f"left out {counted(left_out, 'frame')} without poses around them")
    return replace(
        recording, frames=frames, poses=poses, motion=motion, remarks=(*recording.remarks, *remarks)
    )


def with_trajectory(
    recording: Recording,
    poses: Mapping[int, Pose],
    source: Path,
    *,
    point_times: Literal["relative", "absolute", "deskewed"],
    sweep_s: float = 0.0,
) -> Recording:
    """Add the trajectory of the LiDAR, which moves each sweep to the time of its image, and the speed at each frame.

    Args:
        recording: A recording whose frames have both stamps.
        poses: Poses (4, 4) of the LiDAR by their times in nanoseconds, ascending.
        source: File of the poses.
        point_times: What the times of points refer to, as `point_times` of a drive's motion.
        sweep_s: Time before and after the stamp of a sweep in which its points may have been measured, in seconds.

    Raises:
        InputError: there is no frame with poses before and after its sweep and its image.
    """
    stamps_ns = [*poses]
    frames = [frame for frame in recording.frames if is_covered(frame, stamps_ns, sweep_s)]
    if not frames:
        raise InputError(f"{source}: found no poses before and after the sweep and the image of any frame")
    stamps_s = np.array([frame.points_stamp for frame in frames])
    times_s, positions = np.array(stamps_ns) / NS, np.array([T[:3, 3] for T in poses.values()])
    at_sweeps = np.column_stack([np.interp(stamps_s, times_s, axis) for axis in positions.T])
    speeds = speeds_mps(at_sweeps, np.diff(stamps_s)).tolist()
    frames = [replace(frame, speed_mps=speed) for frame, speed in zip(frames, speeds, strict=True)]
    motion = {"point_times": point_times, "sigma": SIGMA}
    return with_poses(recording, frames, poses, motion, f"sweeps are moved to their images by {source.name}")


def is_covered(frame: SourceFrame, stamps_ns: Sequence[int], sweep_s: float) -> bool:
    """Return whether poses with these ascending stamps cover the image of a frame and the time around its sweep."""
    if frame.points_stamp is None or frame.image_stamp is None:
        return False
    moments_s = (frame.points_stamp - sweep_s, frame.points_stamp + sweep_s, frame.image_stamp)
    return are_covered(stamps_ns, (round(moment_s * NS) for moment_s in moments_s))


def check_recording(recording: object, guard: Guard) -> Recording:
    """Check a recording whose types no type checker checked.

    Args:
        recording: What the function of a plugin returned.
        guard: Wraps the function of a conversion, which runs later.

    Raises:
        TypeError: something is of another type, or a number is not finite.
        ValueError: there is no frame.
    """
    valid = _check_fields("", recording, Recording)
    for key in ("camera", "lidar", "frame_ids", "motion"):
        if (block := getattr(valid, key)) is not None:
            _check_block(key, block)
    if not valid.frames:
        raise ValueError("frames: found none, needed at least one")
    return replace(
        valid, frames=[_check_frame(index, frame, guard) for index, frame in enumerate(valid.frames)]
    )


def _check_frame(index: int, frame: object, guard: Guard) -> SourceFrame:
    valid = _check_fields(f"frames[{index}]", frame, SourceFrame)
    if not isinstance(valid.points, Conversion):
        return valid
    make = _check_fields(f"frames[{index}].points", valid.points, Conversion).cloud
    cloud = guard(lambda: _check_fields("cloud", make(), Cloud))
    return replace(valid, points=replace(valid.points, cloud=cloud))


def _check_fields(where: str, value: object, kind: type[Kind]) -> Kind:
    """Check the class of an object, and its fields against the annotations of the class."""
    if not isinstance(value, kind):
        raise TypeError(f"{where}: found {describe(value)}, expected a {kind.__name__}".removeprefix(": "))
    record_type: type = kind
    for key, setting in settings_of(record_type, with_others=True).items():
        if not setting.allows(content := getattr(value, key)):
            if isinstance(content, tuple) and get_origin(setting.kind) is tuple:
                index = [setting.entry.allows(entry) for entry in content].index(False)
                key, content, setting = f"{key}[{index}]", content[index], setting.entry
            needed = setting.needed(content) + " or None" * setting.is_optional
            raise TypeError(f"{where}.{key}: found {describe(content)}, expected {needed}".removeprefix("."))
    return value


def _check_block(key: str, block: Mapping[str, Any]) -> None:
    try:
        json.dumps(dict(block))
    except TypeError as error:
        raise TypeError(f"{key}: {error}; expected numbers, text, lists and mappings") from None
