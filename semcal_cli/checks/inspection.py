"""Inspection of a drive before a calibration: its content, frame by frame, and what looks wrong with it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from semcal_cli import core
from semcal_cli.checks.label_alignment import check_label_alignment
from semcal_cli.checks.motion_report import report_motion
from semcal_cli.checks.pairing import find_identical_files
from semcal_cli.checks.scale import check_scale, judge_scale
from semcal_cli.config import MAX_FRAMES, InitializationConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import Drive
from semcal_cli.errors import CalibrationError, InputError, counted
from semcal_cli.estimation.search.mounting_search import search_mountings
from semcal_cli.estimation.uncertainty.intrinsics import implausible_intrinsics
from semcal_cli.files.image_files import read_image, read_size
from semcal_cli.findings.check import findings_among
from semcal_cli.geometry.arrays import Points
from semcal_cli.observations.cues.segments import KINDS, kinds_of_segments
from semcal_cli.observations.frame_selection import evenly_spaced, with_frames
from semcal_cli.observations.motion import motion_error_px, shutter_error_px
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.reading import count_labels, load_observations, read_clouds, read_label_images
from semcal_cli.observations.scenes import alike_frames, nearest_ranges

MAX_GAP_S = 0.05
"""Largest time between sweep and image without a finding; at 10 m/s it is half a metre."""
MANY_CLASSES = 64
"""Largest number of classes of a segmentation; more classes are instances or colours."""
MIN_VIEW_DEG = 1.0
"""Smallest field of view of a lens without a finding."""
MAX_RANGE_M = 1000.0
"""Largest median range of points in the LiDAR's frame."""
MAX_IGNORED = 0.9
"""Largest fraction of points or pixels without information that gives no finding."""
MAX_MOTION_PX = 1.0
"""Largest median displacement of points by uncompensated motion without a finding, in pixels."""
LABEL = "`semcal label` makes them with a network; without them a calibration needs a start (`--init`)"
"""Advice for a drive without image labels."""
NUM_PROBED = 4
"""Number of frames whose image sizes are checked and whose clouds are registered, unchanged and mirrored."""
FEW_FRAMES, USUAL_FRAMES, NARROW_DEG = 4, 20, 50.0
"""Number of frames that distinguish mountings, number for the accuracy of docs/benchmarks.md, and horizontal field of
view below which a lens needs more of them."""
MIN_MIRROR_MARGIN = 2.0
"""Number of standard errors by which mirrored clouds must explain the labels better for a finding."""
NO_VIEW = "the lens sees almost nothing: K, distortion or parameters are wrong"


@dataclass(frozen=True)
class FrameReport:
    """Content of one frame, and findings about it. Its fields are the keys of `inspect --json`."""

    points: str
    """File of the sweep."""
    num_points: int
    """Number of returns."""
    num_no_returns: int
    """Number of firings without a return."""
    point_classes: Mapping[str, int] | None
    """Number of returns of each class; None without labels."""
    num_points_ignored: int
    """Number of returns that carry no information."""
    image_classes: Mapping[str, int] | None
    """Number of pixels of each class; None without labels."""
    num_pixels_ignored: int
    """Number of pixels that carry no information."""
    gap_s: float | None
    """Time between sweep and image, in seconds; None without both stamps."""
    suspicions: tuple[str, ...]
    """Findings about the frame."""


@dataclass(frozen=True)
class DriveReport:
    """Content of a drive, and findings about it. Its fields are the keys of `inspect --json`."""

    drive: str
    """Path of the drive.yaml."""
    frames: tuple[FrameReport, ...]
    """Reports of the frames."""
    pattern: str
    """Scan pattern of the LiDAR, as found in the points."""
    elevations_deg: tuple[float, float]
    """Elevations of the points, without the lowest and the highest 0.2 %."""
    azimuths_deg: float
    """Part of a turn that the points fill, in degrees."""
    field_of_view_deg: tuple[float, float]
    """Field of view of the camera through the principal point, across and down the image."""
    shared_classes: tuple[str, ...]
    """Class names that points and pixels share. A calibration needs none."""
    median_range_m: float
    """Range within which half of the points lie, metres."""
    span_s: float | None
    """Time from the first sweep to the last, in seconds; None without stamps."""
    speeds_m_s: tuple[float, float] | None
    """Lowest and highest speed at the images; None without poses or a twist."""
    fastest_turn_deg_s: float | None
    """Fastest turn at the images, in degrees a second; None without poses or a twist."""
    suspicions: tuple[str, ...]
    """Findings about the whole drive."""
    networks: tuple[str, ...] = ()
    """Sentences about the networks that made the labels, and how far two of them differ."""
    advice: tuple[str, ...] = ()
    """Sentences about what is probably insufficient for a calibration, and what would help."""


def inspect(drive: Drive) -> DriveReport:
    """Inspect a drive, frame by frame, with labels or without.

    Raises:
        InputError: no sweep can be read.
    """
    frames, ranges = zip(*(_read(drive, index) for index in range(len(drive.frames))), strict=True)
    readable = [index for index, frame in enumerate(frames) if frame.num_points]
    if not readable:
        raise InputError(frames[0].suspicions[0])
    labelled = [
        index for index in readable if None not in (frames[index].point_classes, frames[index].image_classes)
    ]
    probed = with_frames(drive, evenly_spaced(readable, NUM_PROBED))
    clouds = read_clouds(probed)
    points = [cloud.points for cloud in clouds]
    few = _loaded(probed)
    motion = report_motion(drive)
    num_scenes = len(set(alike_frames([ranges[index] for index in readable])))
    median_range_m = float(np.median(np.linalg.norm(np.concatenate(points), axis=1)))
    elevations, azimuths = _field_of_points(points)
    field_of_view = _field_of_view(drive)
    point_names = _names(frame.point_classes for frame in frames)
    pixel_names = _names(frame.image_classes for frame in frames)
    return DriveReport(
        drive=str(drive.path),
        frames=frames,
        pattern=_pattern(points),
        elevations_deg=elevations,
        azimuths_deg=azimuths,
        field_of_view_deg=field_of_view,
        shared_classes=tuple(name for name in point_names or () if name in (pixel_names or ())),
        median_range_m=median_range_m,
        span_s=motion.span_s,
        speeds_m_s=motion.speeds_m_s,
        fastest_turn_deg_s=motion.fastest_turn_deg_s,
        suspicions=(
            *implausible_intrinsics(drive.camera).values(),
            *[NO_VIEW] * (min(field_of_view) < MIN_VIEW_DEG),
            *_check_images(drive),
            *_check_scale(median_range_m, few),
            *_check_classes(point_names, pixel_names),
            *motion.suspicions,
            *_check_motion(drive, motion_error_px(probed, clouds), points),
            *([] if few is None else _check_mirroring(few)),
            *_check_labels(with_frames(drive, evenly_spaced(labelled, MAX_FRAMES))),
            *find_identical_files(drive),
        ),
        networks=() if drive.networks is None else tuple(drive.networks.describe()),
        advice=(*_advice(len(readable), num_scenes, field_of_view[0]), *motion.advice),
    )


def _advice(num_frames: int, num_scenes: int, across_deg: float) -> tuple[str, ...]:
    """Say if scenes or field of view are probably too few: see docs/benchmarks_stages.md, the initial calibration."""
    advice, shown = list[str](), counted(num_frames, "frame")
    if num_scenes < min(num_frames, USUAL_FRAMES):
        shown = counted(num_scenes, "scene")
        advice.append(
            f"the {num_frames} frames show {shown}, and frames of one scene count as one: record while driving, past "
            "different objects"
        )
    are = "is" if num_scenes == 1 else "are"
    if num_scenes < FEW_FRAMES:
        advice.append(
            f"{shown} {are} few: use {FEW_FRAMES} or more to find the mounting, and {USUAL_FRAMES} for accuracy"
        )
    elif across_deg < NARROW_DEG and num_scenes < USUAL_FRAMES:
        seen = f"{across_deg:.0f} degrees across"
        advice.append(f"{shown} through a lens of {seen} {are} few: {USUAL_FRAMES} or more help")
    return tuple(advice)


def _read(drive: Drive, index: int) -> tuple[FrameReport, Points]:
    """Report on the files of a frame that can be read, and the errors of the others.

    Returns:
        The report, and the nearest ranges of the sweep, which identify frames of the same scene.
    """
    frame, alone, errors = drive.frames[index], with_frames(drive, [index]), list[str]()
    num_points = num_no_returns = points_ignored = pixels_ignored = 0
    point_classes: Mapping[str, int] | None = None
    image_classes: Mapping[str, int] | None = None
    ranges, kinds = np.empty(0, np.float32), tuple[str, ...]()
    try:
        (cloud,) = read_clouds(alone)
        num_points, num_no_returns = len(cloud.points), cloud.num_no_returns
        ranges = nearest_ranges(cloud.points)
        labels = cloud.labels if cloud.label_shares is None else cloud.label_shares
        if labels is not None:
            point_classes, points_ignored = count_labels(drive, "points", labels)
        else:
            kinds = kinds_of_segments(cloud.points)
    except InputError as error:
        errors.append(str(error))
    if frame.image_labels is not None:
        try:
            (label_image,) = read_label_images(alone)
            image_classes, pixels_ignored = count_labels(drive, "image", label_image)
        except InputError as error:
            errors.append(str(error))
    suspicions = [*errors, *_check_side("points", point_classes, points_ignored)]
    if point_classes is None and num_points and len(kinds) < len(KINDS):
        shown = f"only {' and '.join(kinds)}" if kinds else "no segments"
        suspicions.append(f"its points show {shown}: --cue segments needs {' and '.join(KINDS.values())}")
    suspicions += _check_side("pixels", image_classes, pixels_ignored)
    gap_s = None
    if frame.points_stamp is not None and frame.image_stamp is not None:
        gap_s = abs(frame.points_stamp - frame.image_stamp)
        # A motion with a direction moves the points to the time of the image.
        if gap_s > MAX_GAP_S and not _has_direction(drive):
            suspicions.append(f"sweep and image are {gap_s:.3f} s apart")
    report = FrameReport(
        points=frame.points,
        num_points=num_points,
        num_no_returns=num_no_returns,
        point_classes=point_classes,
        num_points_ignored=points_ignored,
        image_classes=image_classes,
        num_pixels_ignored=pixels_ignored,
        gap_s=gap_s,
        suspicions=tuple(suspicions),
    )
    return report, ranges


def _names(counts: Iterable[Mapping[str, int] | None]) -> list[str] | None:
    """List the class names of points or of pixels over all frames; None without labels."""
    found = [names for names in counts if names is not None]
    return list(dict.fromkeys(chain.from_iterable(found))) if found else None


def _check_side(side: str, counts: Mapping[str, int] | None, num_ignored: int) -> list[str]:
    if counts is None:
        return []
    found = []
    if len(counts) < 2:
        found.append(f"{side} have {_one_class(counts)}")
    ignored = num_ignored / max(num_ignored + sum(counts.values()), 1)
    if ignored > MAX_IGNORED:
        found.append(f"{ignored:.0%} of the {side} carry no information")
    return found


def _one_class(names: Iterable[str]) -> str:
    """Say which class is the only one, if there is one."""
    (name, *_) = (*names, "")
    return f"only the class {name}" if name else "no class"


def _pattern(points: Sequence[Points]) -> str:
    try:
        grid = core.estimate_grid(points)
    except CalibrationError as error:
        return str(error)
    if grid.columns == round(math.tau / grid.cell_height):
        return f"no channels; its points fill cells of {math.degrees(grid.cell_height):.2f} degrees"
    return f"{grid.rows} channels of about {grid.columns:,} returns per turn"


def _field_of_points(points: Sequence[Points]) -> tuple[tuple[float, float], float]:
    """Compute the elevations between which the points lie, and the part of a turn that they fill, in degrees."""
    x, y, z = np.concatenate(points).T
    low, high = np.degrees(np.quantile(np.arctan2(z, np.hypot(x, y)), (0.002, 0.998))).tolist()
    filled = np.bincount((np.degrees(np.arctan2(y, x)) + 180.0).astype(int) % 360, minlength=360)
    return (low, high), float(np.count_nonzero(filled))


def _field_of_view(drive: Drive) -> tuple[float, float]:
    """Compute the angles across and down the image through the principal point, in degrees, within the lens's reach."""
    camera = drive.camera
    lens = core_camera(camera)
    (_, _, cx), (_, _, cy), _ = camera.K
    right, bottom = camera.width - 0.5, camera.height - 0.5
    rays = lens.unproject(np.array([[-0.5, cy], [right, cy], [cx, -0.5], [cx, bottom]]))
    angles = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    left, right, top, bottom = np.degrees(np.where(np.isnan(angles), lens.limit, angles)).tolist()
    return left + right, top + bottom


def _check_scale(median_m: float, few: Observations | None) -> list[str]:
    if median_m > MAX_RANGE_M:
        return [f"half of the points are {median_m:,.0f} m away or more: clouds must be in the LiDAR frame"]
    return judge_scale(median_m) if few is None else check_scale(few)


def _check_images(drive: Drive) -> list[str]:
    named = [frame.image for frame in drive.frames if frame.image is not None]
    found, needed = [], drive.camera.size
    for name in evenly_spaced(named, NUM_PROBED):
        try:
            width, height = read_size(drive.resolve(name))
            if (width, height) == needed:
                read_image(drive.resolve(name), needed)
            else:
                found.append(
                    f"{name} is {width} x {height}, the camera's images are {needed[0]} x {needed[1]}"
                )
        except InputError as error:
            found.append(str(error))
    return found


def _check_classes(points: Sequence[str] | None, pixels: Sequence[str] | None) -> list[str]:
    found = []
    for side, names in (("points", points), ("pixels", pixels)):
        if names is None:
            # Segments and edges replace point labels.
            found += [f"no image labels: {LABEL}"] * (side == "pixels")
        elif len(names) < 2:
            found.append(f"{side} have {_one_class(names)} in all frames")
        elif len(names) > MANY_CLASSES:
            found.append(f"{len(names)} classes of {side}: perhaps they are instance ids or colours")
    return found


def _check_motion(drive: Drive, error_px: float | None, points: Sequence[Points]) -> list[str]:
    """Check the effect of motion during a sweep, and that a rolling shutter can be compensated."""
    found, displaces = [], "displaces half of the points by {:.1f} pixels or more"
    if error_px is not None and error_px > MAX_MOTION_PX:
        found.append(f"motion during a sweep {displaces.format(error_px)}")
    if drive.camera.readout_s > 0.0 and not _has_direction(drive):
        error_px = shutter_error_px(drive, points)
        cost = "" if error_px is None else f": it {displaces.format(error_px)}"
        found.append(f"the rolling shutter cannot be compensated without poses or a twist in motion{cost}")
    return found


def _has_direction(drive: Drive) -> bool:
    return drive.motion is not None and drive.motion.speed_m_s is None


def _check_labels(labelled: Drive) -> Sequence[str]:
    read = _loaded(labelled) if labelled.frames else None
    found = () if read is None else findings_among(check_label_alignment(labelled, read).measured)
    return tuple(finding.sentence for finding in found)


def _loaded(drive: Drive) -> Observations | None:
    """Load the labels of points and pixels; None if they cannot be read or carry no information."""
    try:
        return load_observations(drive)
    except (CalibrationError, InputError):
        return None


def _check_mirroring(few: Observations) -> list[str]:
    """Register a few frames unchanged and with y negated, because clouds may be mirrored."""
    flip = np.array([1.0, -1.0, 1.0], np.float32)
    mirrored = few.with_clouds(cloud.with_points(cloud.points * flip) for cloud in few.clouds)
    try:
        best, other = (
            search_mountings(each, InitializationConfig(), seed=0).hypotheses[0] for each in (few, mirrored)
        )
    except (CalibrationError, InputError):
        return []
    if other.margin(best) <= MIN_MIRROR_MARGIN:
        return []
    return [
        f"the clouds seem mirrored: with y negated, labels share {other.corrected_nats:.2f} nats instead of "
        f"{best.corrected_nats:.2f}"
    ]
