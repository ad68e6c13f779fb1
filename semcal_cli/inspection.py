"""What a drive holds, frame by frame, and what looks wrong with it: before a calibration is tried."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.camera import core_camera
from semcal_cli.classes import NO_CLASS
from semcal_cli.drive import Drive, Frame
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.initialization import InitializationConfig, initialize
from semcal_cli.observations import Observations, load_observations, read_observations
from semcal_cli.pictures import read_picture

MAX_FRAMES = 200
"""So many frames of a drive are looked at: they fit in memory."""
MAX_GAP_S = 0.05
"""Sweep and picture of a frame that are farther apart are suspicious: at 10 m/s that is half a metre."""
MANY_CLASSES = 64
"""No segmentation has so many: a side with more holds instances, or colours."""
MAX_OFF_CENTER = 0.25
"""A principal point farther from the picture's middle than this share of it is suspicious."""
MAX_IGNORED = 0.9
"""A side most of which carries no information is suspicious."""
MAX_MOTION_PX = 1.0
"""Points that a motion displaces farther, without being put back, are suspicious."""
NUM_PROBED = 4
"""Of so many frames, pictures are measured, and clouds are registered as they are and mirrored ..."""
MIN_MIRROR_MARGIN = 2.0
"""... and a cloud is mirrored if that explains the labels better by so many standard errors."""


@dataclass(frozen=True)
class FrameReport:
    """What one frame holds."""

    points: str
    """File of the sweep."""
    num_points: int
    num_no_returns: int
    point_classes: Mapping[str, int]
    """Returns of each class."""
    num_points_ignored: int
    image_classes: Mapping[str, int]
    """Pixels of each class."""
    num_pixels_ignored: int
    gap_s: float | None
    """Time between sweep and picture, if both have stamps."""
    suspicions: tuple[str, ...]


@dataclass(frozen=True)
class DriveReport:
    """What a drive holds."""

    drive: str
    num_frames: int
    """Of the whole drive."""
    frames: tuple[FrameReport, ...]
    """Those that were looked at."""
    pattern: str
    """How the LiDAR scans, as found in the points."""
    elevations_deg: tuple[float, float]
    """Lowest and highest 0.2 % of the points left out."""
    azimuths_deg: float
    """How much of a turn the points fill."""
    field_of_view_deg: tuple[float, float]
    """The camera's, across the middle of the picture and down it."""
    shared_classes: tuple[str, ...]
    """Names that both sides have. They need none in common."""
    suspicions: tuple[str, ...]

    @property
    def is_suspicious(self) -> bool:
        """Whether anything looks wrong."""
        return bool(self.suspicions) or any(frame.suspicions for frame in self.frames)


def inspect(drive: Drive, max_frames: int = MAX_FRAMES) -> DriveReport:
    """Look through a drive; of a longer one, through so many frames, evenly spaced.

    Raises:
        InputError: no frame can be read.
        CalibrationError: one side carries a single class over the whole drive.
    """
    num_frames = len(drive.frames)
    drive = _with_frames(drive, _spread(num_frames, max_frames))
    observations, complaints = _load(drive)
    places = iter(range(observations.num_frames))
    frames = tuple(
        _unreadable_frame(frame, complaints[index])
        if index in complaints
        else _inspect_frame(frame, observations.of_frames([next(places)]))
        for index, frame in enumerate(drive.frames)
    )
    elevations, azimuths = _field_of_points(observations.points)
    shared = set(observations.point_class_names) & set(observations.image_class_names)
    return DriveReport(
        drive=str(drive.path),
        num_frames=num_frames,
        frames=frames,
        pattern=_pattern(observations),
        elevations_deg=elevations,
        azimuths_deg=azimuths,
        field_of_view_deg=_field_of_view(drive),
        shared_classes=tuple(name for name in observations.point_class_names if name in shared),
        suspicions=(
            *_camera_suspicions(drive),
            *_picture_suspicions(drive),
            *_class_suspicions(observations),
            *_motion_suspicions(observations),
            *_mirror_suspicions(observations),
        ),
    )


def _spread(num_frames: int, count: int) -> list[int]:
    """Evenly spaced indices, all if there are no more than `count`."""
    return sorted({round(index) for index in np.linspace(0, num_frames - 1, min(num_frames, count))})


def _with_frames(drive: Drive, indices: Sequence[int]) -> Drive:
    return drive.model_copy(update={"frames": tuple(drive.frames[index] for index in indices)})


def _load(drive: Drive) -> tuple[Observations, Mapping[int, str]]:
    """Load the frames that can be read; complaints about the others."""
    try:
        return load_observations(drive), {}
    except InputError as error:
        first = error
    complaints = {}
    for index in range(len(drive.frames)):
        try:
            read_observations(_with_frames(drive, [index]))
        except InputError as error:
            complaints[index] = str(error)
        except CalibrationError:
            pass  # a frame of one class is no obstacle to others
    readable = [index for index in range(len(drive.frames)) if index not in complaints]
    if not (readable and complaints):
        raise first
    return load_observations(_with_frames(drive, readable)), complaints


def _unreadable_frame(frame: Frame, complaint: str) -> FrameReport:
    return FrameReport(frame.points, 0, 0, {}, 0, {}, 0, None, (f"cannot be used: {complaint}",))


def _inspect_frame(frame: Frame, observations: Observations) -> FrameReport:
    point_classes, pixel_classes = observations.point_classes[0], observations.image_classes[0]
    points = _count(point_classes, observations.point_class_names)
    pixels = _count(pixel_classes, observations.image_class_names)
    stamps = frame.points_stamp, frame.image_stamp
    gap_s = None if None in stamps else abs(stamps[0] - stamps[1])  # type: ignore[operator]
    ignored = [int(np.count_nonzero(classes == NO_CLASS)) for classes in (point_classes, pixel_classes)]
    return FrameReport(
        points=frame.points,
        num_points=len(point_classes),
        num_no_returns=observations.num_no_returns[0],
        point_classes=points,
        num_points_ignored=ignored[0],
        image_classes=pixels,
        num_pixels_ignored=ignored[1],
        gap_s=gap_s,
        suspicions=(
            *_side_suspicions("points", points, ignored[0] / max(point_classes.size, 1)),
            *_side_suspicions("pixels", pixels, ignored[1] / pixel_classes.size),
            *([] if gap_s is None or gap_s <= MAX_GAP_S else [f"sweep and picture are {gap_s:.3f} s apart"]),
        ),
    )


def _count(classes: npt.NDArray[np.uint8], names: Sequence[str]) -> dict[str, int]:
    counts = np.bincount(classes.ravel(), minlength=NO_CLASS + 1)[: len(names)]
    return {name: int(count) for name, count in zip(names, counts, strict=True) if count}


def _side_suspicions(side: str, counts: Mapping[str, int], ignored: float) -> list[str]:
    found = []
    if len(counts) < 2:
        found.append(f"{side} of {' and '.join(counts) or 'no class'} only")
    if ignored > MAX_IGNORED:
        found.append(f"{ignored:.0%} of the {side} carry no information")
    return found


def _pattern(observations: Observations) -> str:
    try:
        rows, columns, _, cell_height = _core.estimate_grid(observations.core)
    except CalibrationError as error:
        return str(error)
    if columns == round(math.tau / cell_height):
        return f"no channels; its points fill cells of {math.degrees(cell_height):.2f} degrees"
    return f"{rows} channels of about {columns:,} returns a turn"


def _field_of_points(points: Sequence[npt.NDArray[np.float32]]) -> tuple[tuple[float, float], float]:
    """Elevations between which the points lie, and how much of a turn they fill; degrees."""
    x, y, z = np.concatenate(points).T
    low, high = np.degrees(np.quantile(np.arctan2(z, np.hypot(x, y)), (0.002, 0.998))).tolist()
    filled = np.bincount((np.degrees(np.arctan2(y, x)) + 180.0).astype(int) % 360, minlength=360)
    return (low, high), float(np.count_nonzero(filled))


def _field_of_view(drive: Drive) -> tuple[float, float]:
    """Angles across and down the picture through the principal point, degrees; as far as the lens reaches."""
    camera = drive.camera
    lens = core_camera(camera)
    (_, _, cx), (_, _, cy), _ = camera.K
    right, bottom = camera.width - 0.5, camera.height - 0.5
    rays = lens.unproject(np.array([[-0.5, cy], [right, cy], [cx, -0.5], [cx, bottom]]))
    angles = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    left, right, top, bottom = np.degrees(np.where(np.isnan(angles), lens.limit, angles)).tolist()
    return left + right, top + bottom


def _camera_suspicions(drive: Drive) -> list[str]:
    camera = drive.camera
    found = []
    for name, center, size in (
        ("cx", camera.K[0][2], camera.width),
        ("cy", camera.K[1][2], camera.height),
    ):
        if abs(center - 0.5 * size) > MAX_OFF_CENTER * size:
            found.append(
                f"{name} of K is {center:g} in a picture of {size}: K may belong to pictures of another size"
            )
    return found


def _picture_suspicions(drive: Drive) -> list[str]:
    named = [frame.image for frame in drive.frames if frame.image is not None]
    found = []
    for name in (named[index] for index in _spread(len(named), NUM_PROBED)):
        try:
            height, width, _ = read_picture(drive.resolve(name)).shape
        except InputError as error:
            found.append(str(error))
            continue
        if (width, height) != (drive.camera.width, drive.camera.height):
            size = f"{drive.camera.width} x {drive.camera.height}"
            found.append(f"{name} is {width} x {height}, the camera's pictures are {size}")
    return found


def _class_suspicions(observations: Observations) -> list[str]:
    sides = {"points": observations.point_class_names, "pixels": observations.image_class_names}
    return [
        f"{len(names)} classes of {side}: instance ids or colours, perhaps"
        for side, names in sides.items()
        if len(names) > MANY_CLASSES
    ]


def _motion_suspicions(observations: Observations) -> list[str]:
    error_px = observations.motion_error_px
    if error_px is None or error_px <= MAX_MOTION_PX:
        return []
    return [f"motion during a sweep displaces half of the points by {error_px:.1f} pixels or more"]


def _mirror_suspicions(observations: Observations) -> list[str]:
    """Register a few frames as they are and with y negated: no camera sees the mirror image of its scene."""
    few = observations.of_frames(_spread(observations.num_frames, NUM_PROBED))
    flip = np.array([1.0, -1.0, 1.0], np.float32)
    mirrored = replace(few, points=[points * flip for points in few.points])
    try:
        best, other = (initialize(each, InitializationConfig(), seed=0)[0] for each in (few, mirrored))
    except (CalibrationError, InputError):
        return []
    sigma = math.hypot(best.sigma_nats, other.sigma_nats)
    ahead = other.corrected_nats - best.corrected_nats
    if ahead <= MIN_MIRROR_MARGIN * sigma:
        return []
    return [
        f"the clouds seem mirrored: with y negated, labels share {other.corrected_nats:.2f} nats instead of "
        f"{best.corrected_nats:.2f}"
    ]
