"""Inspection of a drive before a calibration: its content, frame by frame, and what looks wrong with it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import numpy as np

from semcal_cli import core
from semcal_cli.checks.class_counts import check_class_names, check_frame_classes
from semcal_cli.checks.few_segments import check_segments
from semcal_cli.checks.frame_count import check_frame_count
from semcal_cli.checks.identical_files import find_identical_files
from semcal_cli.checks.image_sizes import check_image_sizes
from semcal_cli.checks.implausible_intrinsics import implausible_intrinsics
from semcal_cli.checks.mirrored_clouds import check_mirroring
from semcal_cli.checks.motion_report import MotionReport, report_motion
from semcal_cli.checks.motion_unstated import check_unstated
from semcal_cli.checks.narrow_view import check_view
from semcal_cli.checks.scale import check_range, check_ranges, check_scale
from semcal_cli.checks.seam import check_seam
from semcal_cli.checks.shifted_labels import check_label_alignment
from semcal_cli.checks.stamp_gap import check_gap
from semcal_cli.checks.sweep_motion import check_readout, check_sweep_motion, has_direction
from semcal_cli.checks.wrong_origin import WRONG_ORIGIN, check_origin, check_viewpoint
from semcal_cli.config import MAX_FRAMES
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import Drive
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.files.array_forms import SweepCloud
from semcal_cli.findings.check import findings_among
from semcal_cli.findings.finding import Finding
from semcal_cli.geometry.arrays import Points
from semcal_cli.observations.cues.segments import kinds_of_segments
from semcal_cli.observations.frame_selection import evenly_spaced, with_frames
from semcal_cli.observations.masks import seen_pixels
from semcal_cli.observations.motion import motion_error_px
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.point_times import checked_times
from semcal_cli.observations.reading import count_labels, load_observations, read_clouds, read_label_images
from semcal_cli.observations.scenes import alike_frames

NUM_PROBED = 4
"""Number of frames whose clouds are measured, and registered unchanged and mirrored."""


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
    hidden_shares: tuple[float, float] | None = None
    """Lowest and highest share of what the lens sees that masks hide; None without masks, or with wrong ones."""
    own_points: str | None = None
    """Field that tells the LiDAR's own points from others in its clouds, and its values there; None if all are."""
    image_levels: tuple[int, int] | None = None
    """Values of 16-bit images that are shown as black and as white; None without such images."""


class _Probe(NamedTuple):
    """A few frames of a drive, on which checks that take long are run."""

    drive: Drive
    """The drive with these frames only."""
    clouds: list[SweepCloud]
    points: list[Points]
    """(N, 3) points of each frame from where the rays start, metres."""
    observations: Observations | None
    """Points and pixels with labels; None if they cannot be read or carry no information."""

    @property
    def median_range_m(self) -> float:
        """Range within which half of the points lie, metres."""
        return float(np.median(np.linalg.norm(np.concatenate(self.points), axis=1)))

    @property
    def have_times(self) -> bool:
        """Whether points of a sweep have different times."""
        return any(cloud.time is not None and np.ptp(cloud.time) > 0.0 for cloud in self.clouds)


def inspect(drive: Drive) -> DriveReport:
    """Inspect a drive, frame by frame, with labels or without.

    Raises:
        InputError: no sweep can be read.
    """
    frames, ranges = zip(*(_read(drive, index) for index in range(len(drive.frames))), strict=True)
    readable = [index for index, frame in enumerate(frames) if frame.num_points]
    if not readable:
        raise InputError(frames[0].suspicions[0])
    num_scenes = len(set(alike_frames([each for each in ranges if each is not None])))
    probe, motion = _probe(drive, readable), report_motion(drive)
    elevations, azimuths = _field_of_points(probe.points)
    field_of_view = _field_of_view(drive)
    hidden_shares, mask_errors = _check_masks(drive)
    return DriveReport(
        drive=str(drive.path),
        frames=frames,
        pattern=_pattern(drive, probe.points),
        elevations_deg=elevations,
        azimuths_deg=azimuths,
        field_of_view_deg=field_of_view,
        shared_classes=_shared_classes(frames),
        median_range_m=probe.median_range_m,
        span_s=motion.span_s,
        speeds_m_s=motion.speeds_m_s,
        fastest_turn_deg_s=motion.fastest_turn_deg_s,
        suspicions=(
            *_suspicions_of_camera(drive, field_of_view, mask_errors),
            *_suspicions_of_frames(drive, frames, probe, motion),
        ),
        networks=() if drive.networks is None else tuple(drive.networks.describe()),
        advice=(
            *_sentences(check_frame_count(len(readable), num_scenes, field_of_view[0])),
            *_sentences(check_unstated(drive, num_scenes, len(readable), have_times=probe.have_times)),
            *motion.advice,
            *_sentences(check_viewpoint(probe.drive)),
            *_sentences(check_seam(drive, probe.clouds)),
        ),
        hidden_shares=hidden_shares,
        own_points=_own_points(drive),
        image_levels=drive.image_levels,
    )


def _probe(drive: Drive, readable: Sequence[int]) -> _Probe:
    """Read a few of the frames that can be read."""
    probed = with_frames(drive, evenly_spaced(readable, NUM_PROBED))
    clouds = read_clouds(probed)
    return _Probe(probed, clouds, [drive.rays(cloud.points) for cloud in clouds], _loaded(probed))


def _suspicions_of_camera(
    drive: Drive, field_of_view_deg: tuple[float, float], mask_errors: Sequence[str]
) -> list[str]:
    return [
        *_sentences(implausible_intrinsics(drive.camera).values()),
        *_sentences(check_view(field_of_view_deg).findings),
        *check_image_sizes(drive),
        *mask_errors,
    ]


def _suspicions_of_frames(
    drive: Drive, frames: Sequence[FrameReport], probe: _Probe, motion: MotionReport
) -> list[str]:
    observations = probe.observations
    return [
        *_check_scale_and_origin(probe),
        *_sentences(check_class_names(*_class_names(frames))),
        *motion.suspicions,
        *_check_times(probe.drive, probe.clouds),
        *_sentences(check_readout(drive, probe.points)),
        *_sentences(() if observations is None else check_mirroring(observations)),
        *_sentences(_check_labels(drive, frames)),
        *_sentences(find_identical_files(drive)),
    ]


def _sentences(findings: Iterable[Finding]) -> list[str]:
    return [finding.sentence for finding in findings]


def _read(drive: Drive, index: int) -> tuple[FrameReport, core.NearestRanges | None]:
    """Report on the files of a frame that can be read, and the errors of the others.

    Returns:
        The report, and the nearest ranges of the sweep, which identify frames of the same scene; None if it cannot be
        read.
    """
    frame, alone, errors = drive.frames[index], with_frames(drive, [index]), list[str]()
    num_points = num_no_returns = points_ignored = pixels_ignored = 0
    point_classes: Mapping[str, int] | None = None
    image_classes: Mapping[str, int] | None = None
    ranges, kinds = None, tuple[str, ...]()
    try:
        (cloud,) = read_clouds(alone)
        num_points, num_no_returns = len(cloud.points), cloud.num_no_returns
        (ranges,) = core.nearest_ranges([drive.rays(cloud.points)])
        labels = cloud.labels if cloud.label_shares is None else cloud.label_shares
        if labels is not None:
            point_classes, points_ignored = count_labels(drive, "points", labels)
        else:
            kinds = kinds_of_segments(drive.rays(cloud.points))
    except InputError as error:
        errors.append(str(error))
    if frame.image_labels is not None:
        try:
            (label_image,) = read_label_images(alone)
            image_classes, pixels_ignored = count_labels(drive, "image", label_image)
        except InputError as error:
            errors.append(str(error))
    findings = [*check_frame_classes("points", point_classes, points_ignored)]
    if point_classes is None and num_points:
        findings += check_segments(kinds)
    findings += check_frame_classes("pixels", image_classes, pixels_ignored)
    gap_s = None
    if frame.points_stamp is not None and frame.image_stamp is not None:
        gap_s = abs(frame.points_stamp - frame.image_stamp)
        # A motion with a direction moves the points to the time of the image.
        if not has_direction(drive):
            findings += check_gap(gap_s).findings
    report = FrameReport(
        points=frame.points,
        num_points=num_points,
        num_no_returns=num_no_returns,
        point_classes=point_classes,
        num_points_ignored=points_ignored,
        image_classes=image_classes,
        num_pixels_ignored=pixels_ignored,
        gap_s=gap_s,
        suspicions=(*errors, *_sentences(findings)),
    )
    return report, ranges


def _shared_classes(frames: Sequence[FrameReport]) -> tuple[str, ...]:
    point_names, pixel_names = _class_names(frames)
    return tuple(name for name in point_names or () if name in (pixel_names or ()))


def _class_names(frames: Sequence[FrameReport]) -> tuple[list[str] | None, list[str] | None]:
    """List the class names of the points and those of the pixels over all frames; None without labels."""
    return _names(frame.point_classes for frame in frames), _names(frame.image_classes for frame in frames)


def _names(counts: Iterable[Mapping[str, int] | None]) -> list[str] | None:
    known = [names for names in counts if names is not None]
    return list(dict.fromkeys(chain.from_iterable(known))) if known else None


def _pattern(drive: Drive, points: Sequence[Points]) -> str:
    """Describe the stated channels, or how close points lie; counted channels of real LiDARs came out wrong."""
    if drive.lidar is not None and drive.lidar.channels is not None:
        return f"{drive.lidar.channels} channels, as the drive states"
    try:
        grid = core.estimate_grid(points)
    except CalibrationError as error:
        return str(error)
    return f"about {math.degrees(grid.cell_height):.2f} degrees between points"


def _own_points(drive: Drive) -> str | None:
    """Describe which points of its clouds are the LiDAR's own."""
    own = None if drive.lidar is None else drive.lidar.own_values
    if own is None:
        return None
    field, ends = own
    return f"{field} {' to '.join(dict.fromkeys(f'{end:.16g}' for end in ends))}"


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


def _check_masks(drive: Drive) -> tuple[tuple[float, float] | None, list[str]]:
    """Find the lowest and the highest share of what the lens sees that masks hide, and what is wrong with them."""
    # A mask may belong to many frames.
    frames = {frame.mask: frame for frame in drive.frames}
    if drive.camera.mask is None and frames.keys() == {None}:
        return None, []
    bare = drive.model_copy(update={"camera": drive.camera.model_copy(update={"mask": None})})
    (lens_mask,) = seen_pixels(bare, [drive.frames[0].model_copy(update={"mask": None})])
    shares, errors = list[float](), dict[str, None]()
    for frame in frames.values():
        try:
            (seen,) = seen_pixels(drive, [frame])
            shares.append(float(1.0 - seen.sum() / lens_mask.sum()))
        except InputError as error:
            errors[str(error)] = None
    return None if errors else (min(shares), max(shares)), [*errors]


def _check_scale(probe: _Probe) -> tuple[Finding, ...]:
    if far := check_range(probe.median_range_m):
        return far
    if probe.observations is not None:
        return check_scale(probe.observations)
    return check_ranges(probe.points, probe.drive.origin_m)


def _check_scale_and_origin(probe: _Probe) -> list[str]:
    of_scale, of_origin = _check_scale(probe), check_origin(probe.drive, probe.points)
    # A wrong place is named once: neighbours of rays show the right one, ranges and sizes only that it is wrong.
    told = [finding for finding in of_scale if not (of_origin and finding.topic == WRONG_ORIGIN.topic)]
    return _sentences([*told, *of_origin])


def _check_times(drive: Drive, clouds: Sequence[SweepCloud]) -> list[str]:
    """List the first complaint about point times that a calibration refuses, or what a known speed may cost."""
    motion = drive.motion
    try:
        for frame, cloud in zip(drive.frames, clouds, strict=True):
            if motion is not None:
                checked_times(drive, frame, cloud, motion.point_times)
        return _sentences(check_sweep_motion(motion_error_px(drive, clouds)))
    except InputError as error:
        return [str(error)]


def _check_labels(drive: Drive, frames: Sequence[FrameReport]) -> tuple[Finding, ...]:
    indices = [
        index
        for index, frame in enumerate(frames)
        if frame.num_points and None not in (frame.point_classes, frame.image_classes)
    ]
    labelled = with_frames(drive, evenly_spaced(indices, MAX_FRAMES))
    observations = _loaded(labelled) if labelled.frames else None
    if observations is None:
        return ()
    return findings_among(check_label_alignment(labelled, observations).measured)


def _loaded(drive: Drive) -> Observations | None:
    """Load the labels of points and pixels; None if they cannot be read or carry no information."""
    try:
        return load_observations(drive)
    except (CalibrationError, InputError):
        return None
