"""What a drive holds, frame by frame, and what looks wrong with it: before a calibration is tried."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.config import InitializationConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import Drive, Frame
from semcal_cli.drive.frame_selection import evenly_spaced
from semcal_cli.drive.motion import motion_error_px
from semcal_cli.drive.observations import Observations
from semcal_cli.drive.reading import count_labels, load_observations, read_clouds, read_label_images
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.files.images import read_image
from semcal_cli.initialization.search import initialize

MAX_GAP_S = 0.05
"""Sweep and picture of a frame that are farther apart are suspicious: at 10 m/s that is half a metre."""
MANY_CLASSES = 64
"""No segmentation has so many: a side with more holds instances, or colours."""
MAX_OFF_CENTER = 0.12
"""A principal point farther from the picture's middle than this share of it is suspicious."""
MIN_VIEW_DEG = 1.0
"""A lens that sees less is none."""
MAX_RANGE_M = 1000.0
"""Points that are, in the middle, farther than this are not in the LiDAR's frame."""
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
    point_classes: Mapping[str, int] | None
    """Returns of each class; None without labels."""
    num_points_ignored: int
    image_classes: Mapping[str, int] | None
    """Pixels of each class; None without labels."""
    num_pixels_ignored: int
    gap_s: float | None
    """Time between sweep and picture, if both have stamps."""
    suspicions: tuple[str, ...]


@dataclass(frozen=True)
class DriveReport:
    """What a drive holds."""

    drive: str
    frames: tuple[FrameReport, ...]
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


def inspect(drive: Drive) -> DriveReport:
    """Look through a drive, frame by frame, with labels or without.

    Raises:
        InputError: no sweep can be read.
    """
    contents = [_read(drive, index) for index in range(len(drive.frames))]
    readable = [index for index, content in enumerate(contents) if content.num_points]
    if not readable:
        raise InputError(contents[0].complaints[0])
    probed = _with_frames(drive, evenly_spaced(readable, NUM_PROBED))
    clouds = read_clouds(probed)
    points = [cloud.points for cloud in clouds]
    elevations, azimuths = _field_of_points(points)
    of_points = _names(content.point_classes for content in contents)
    of_pixels = _names(content.image_classes for content in contents)
    return DriveReport(
        drive=str(drive.path),
        frames=tuple(map(_report, drive.frames, contents)),
        pattern=_pattern(points),
        elevations_deg=elevations,
        azimuths_deg=azimuths,
        field_of_view_deg=_field_of_view(drive),
        shared_classes=tuple(name for name in of_points or () if name in (of_pixels or ())),
        suspicions=(
            *_camera_suspicions(drive),
            *_image_suspicions(drive),
            *_range_suspicions(points),
            *_class_suspicions(of_points, of_pixels),
            *_motion_suspicions(motion_error_px(probed, clouds)),
            *_mirror_suspicions(probed),
        ),
    )


@dataclass(frozen=True)
class _Content:
    """What the files of a frame hold."""

    num_points: int = 0
    num_no_returns: int = 0
    point_classes: Mapping[str, int] | None = None
    num_points_ignored: int = 0
    image_classes: Mapping[str, int] | None = None
    num_pixels_ignored: int = 0
    complaints: tuple[str, ...] = ()


def _read(drive: Drive, index: int) -> _Content:
    """Read a frame, as far as that goes."""
    alone = _with_frames(drive, [index])
    content = _Content()
    try:
        (cloud,) = read_clouds(alone)
        content = replace(content, num_points=len(cloud.points), num_no_returns=cloud.num_no_returns)
        labels = cloud.labels if cloud.label_shares is None else cloud.label_shares
        if labels is not None:
            counts, num_ignored = count_labels(drive, "points", labels)
            content = replace(content, point_classes=counts, num_points_ignored=num_ignored)
    except InputError as error:
        content = replace(content, complaints=(str(error),))
    if alone.frames[0].image_labels is None:
        return content
    try:
        (label_image,) = read_label_images(alone)
        counts, num_ignored = count_labels(drive, "image", label_image)
        return replace(content, image_classes=counts, num_pixels_ignored=num_ignored)
    except InputError as error:
        return replace(content, complaints=(*content.complaints, str(error)))


def _report(frame: Frame, content: _Content) -> FrameReport:
    stamps = frame.points_stamp, frame.image_stamp
    gap_s = None if None in stamps else abs(stamps[0] - stamps[1])  # type: ignore[operator]
    return FrameReport(
        points=frame.points,
        num_points=content.num_points,
        num_no_returns=content.num_no_returns,
        point_classes=content.point_classes,
        num_points_ignored=content.num_points_ignored,
        image_classes=content.image_classes,
        num_pixels_ignored=content.num_pixels_ignored,
        gap_s=gap_s,
        suspicions=(
            *content.complaints,
            *_side_suspicions("points", content.point_classes, content.num_points_ignored),
            *_side_suspicions("pixels", content.image_classes, content.num_pixels_ignored),
            *([] if gap_s is None or gap_s <= MAX_GAP_S else [f"sweep and picture are {gap_s:.3f} s apart"]),
        ),
    )


def _with_frames(drive: Drive, indices: Sequence[int]) -> Drive:
    return drive.model_copy(update={"frames": tuple(drive.frames[index] for index in indices)})


def _names(counts: Iterable[Mapping[str, int] | None]) -> list[str] | None:
    """Classes of one side, over all frames; None if it has no labels."""
    found = [names for names in counts if names is not None]
    return list(dict.fromkeys(chain.from_iterable(found))) if found else None


def _side_suspicions(side: str, counts: Mapping[str, int] | None, num_ignored: int) -> list[str]:
    if counts is None:
        return []
    found = []
    if len(counts) < 2:
        found.append(f"{side} of {' and '.join(counts) or 'no class'} only")
    ignored = num_ignored / max(num_ignored + sum(counts.values()), 1)
    if ignored > MAX_IGNORED:
        found.append(f"{ignored:.0%} of the {side} carry no information")
    return found


def _pattern(points: Sequence[npt.NDArray[np.float32]]) -> str:
    try:
        grid = _core.estimate_grid(points)
    except CalibrationError as error:
        return str(error)
    if grid.columns == round(math.tau / grid.cell_height):
        return f"no channels; its points fill cells of {math.degrees(grid.cell_height):.2f} degrees"
    return f"{grid.rows} channels of about {grid.columns:,} returns a turn"


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
    if min(_field_of_view(drive)) < MIN_VIEW_DEG:
        found.append("the lens sees next to nothing: K, distortion or parameters are wrong")
    return found


def _range_suspicions(points: Sequence[npt.NDArray[np.float32]]) -> list[str]:
    middle_m = float(np.median(np.linalg.norm(np.concatenate(points), axis=1)))
    if middle_m <= MAX_RANGE_M:
        return []
    return [f"half of the points are {middle_m:,.0f} m away or more: clouds have to be in the LiDAR frame"]


def _image_suspicions(drive: Drive) -> list[str]:
    named = [frame.image for frame in drive.frames if frame.image is not None]
    found = []
    for name in evenly_spaced(named, NUM_PROBED):
        try:
            height, width, _ = read_image(drive.resolve(name)).shape
        except InputError as error:
            found.append(str(error))
            continue
        if (width, height) != (drive.camera.width, drive.camera.height):
            size = f"{drive.camera.width} x {drive.camera.height}"
            found.append(f"{name} is {width} x {height}, the camera's pictures are {size}")
    return found


def _class_suspicions(points: Sequence[str] | None, pixels: Sequence[str] | None) -> list[str]:
    found = []
    for side, names in (("points", points), ("pixels", pixels)):
        if names is None:
            found.append(f"no labels of {side} that can be read: a calibration needs them")
        elif len(names) < 2:
            found.append(f"{side} of {' and '.join(names) or 'no class'} only, over all frames")
        elif len(names) > MANY_CLASSES:
            found.append(f"{len(names)} classes of {side}: instance ids or colours, perhaps")
    return found


def _motion_suspicions(error_px: float | None) -> list[str]:
    if error_px is None or error_px <= MAX_MOTION_PX:
        return []
    return [f"motion during a sweep displaces half of the points by {error_px:.1f} pixels or more"]


def _mirror_suspicions(probed: Drive) -> list[str]:
    """Register a few frames as they are and with y negated: no camera sees the mirror image of its scene."""
    try:
        few = load_observations(probed)
        best, other = (
            initialize(each, InitializationConfig(), seed=0).hypotheses[0] for each in (few, _mirrored(few))
        )
    except (CalibrationError, InputError):
        return []
    if other.margin(best) <= MIN_MIRROR_MARGIN:
        return []
    return [
        f"the clouds seem mirrored: with y negated, labels share {other.corrected_nats:.2f} nats instead of "
        f"{best.corrected_nats:.2f}"
    ]


def _mirrored(observations: Observations) -> Observations:
    """Negate y of all points."""
    flip = np.array([1.0, -1.0, 1.0], np.float32)
    return observations.with_clouds(cloud.with_points(cloud.points * flip) for cloud in observations.clouds)
