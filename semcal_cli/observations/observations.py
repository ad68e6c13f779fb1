"""The labelled points and label images of all frames, with dense classes.

A frame is a sweep and the image taken with it. Each cue observes it in its own classes, in a `FrameObservation`. The
Rust core knows only these, and calls each of them a frame.

The arrays of a frame are copied to the Rust core once, at their first use. Observations of some of the frames, or with
other cameras or labels, share the unchanged arrays, here and in the core. No code may write to an array.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.config import EDGE_BAND_PX, MAX_BASELINE_M, StartsConfig
from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.drive.lidar import Lidar
from semcal_cli.geometry.arrays import Points, Pose
from semcal_cli.geometry.twists import apply_twist
from semcal_cli.observations.scenes import alike_frames
from semcal_cli.threads import thread_pool

TURN_DEG = 5.0
"""Angle of the turned cameras that `turn_loss` compares a pose with: the reach of a start for edges."""
NO_CLASS = 255
"""The class of points and pixels that carry no information."""


@dataclass(frozen=True, eq=False)
class LabelledCloud:
    """The points of one frame, with their classes by one cue."""

    points: npt.NDArray[np.float32]
    """(N, 3) metres, LiDAR frame; if the motion is known, at the time of the image's middle line, or of `exposed_s`."""
    classes: npt.NDArray[np.uint8]
    """(N,) an index into `Observations.point_class_names`, or `NO_CLASS`."""
    shares: core.ClassShares | None = None
    """Class probabilities of each point, if there are any; `classes` are then the most likely ones."""
    partitions: core.Partitions | None = None
    """Segments of the points, which replace the (then coarser) classes when poses are refined."""
    plain_class: int | None = None
    """Class of points beside which nothing changes, if there is one. The polish counts them, but they do not pull the
    pose: they are many, hardly bend the information, and shake it."""
    vectors: npt.NDArray[np.float16] | None = None
    """(N, C) features, whose codes are the classes; None without features."""
    exposed_s: npt.NDArray[np.float64] | None = None
    """(N,) time at which each point is seen, in seconds after the exposure of the image's middle line; None if all are
    seen at that time. See `motion`."""

    @property
    def num_points(self) -> int:
        """Number of points, with and without a class."""
        return len(self.points)

    def with_points(self, points: npt.NDArray[np.float32]) -> LabelledCloud:
        """Copy with other points (N, 3), and the same labels and times."""
        return replace(self, points=points)

    def with_classes(self, classes: npt.NDArray[np.uint8]) -> LabelledCloud:
        """Copy with other classes (N,); probabilities and features stay."""
        return replace(self, classes=classes)

    @cached_property
    def core(self) -> core.LabelledCloud:
        """Cloud of the Rust core, copied on first use."""
        return core.LabelledCloud(self.points, self.classes, self.shares, self.partitions, self.plain_class)


Along: TypeAlias = Literal["rows", "columns"]
"""Whether the scan lines of a LiDAR run along the rows or the columns of an image."""
Z_AXIS = (0.0, 0.0, 1.0)
"""Axis about which a LiDAR turns where nothing tells another, LiDAR frame."""
MIN_ACROSS, MIN_RATIO = 0.5, 1.5
"""Component of a LiDAR's axis to the right of the camera, and ratio of it to that downwards, beyond which scan lines
run along the columns. A camera that is rolled by up to 56 degrees, or looks along the axis, counts as upright."""


def along_at(T_camera_lidar: Pose, axis: Sequence[float] = Z_AXIS) -> Along:
    """Find along what scan lines run at a pose (4, 4), for a LiDAR that turns about this axis (3,)."""
    right, down, _ = np.abs(T_camera_lidar[:3, :3] @ axis)
    return "columns" if right > max(MIN_ACROSS, MIN_RATIO * down) else "rows"


@dataclass(frozen=True, eq=False)
class ScanLines:
    """How the scan lines of a LiDAR cross an image whose classes depend on it."""

    axis: Sequence[float]
    """(3,) axis about which the LiDAR turns, LiDAR frame."""
    along: Along
    """The lines of pixels along which they are taken to run."""
    regraded: Callable[[Along], LabelledImage]
    """Makes the image again for scan lines along others."""


@dataclass(frozen=True, eq=False)
class LabelledImage:
    """The pixels of one frame, with their classes by one cue."""

    classes: npt.NDArray[np.uint8]
    """(H, W) an index into `Observations.image_class_names`, or `NO_CLASS`."""
    shares: core.ClassShares | None = None
    """Class probabilities of each pixel, row by row, if there are any; `classes` are then the most likely ones."""
    blur_px: float | None = None
    """Standard deviation, pixels, of the Gaussian by which classes are blurred at full resolution where they have no
    borders whose pixels are in doubt, as levels of a gradient; None for labels, whose borders have the edge band."""
    vectors: npt.NDArray[np.float16] | None = None
    """(H / s, W / s, C) features of blocks of s x s pixels, whose codes are the classes; None without features."""
    scan_lines: ScanLines | None = None
    """How scan lines cross the image, if its classes depend on that, as levels of a gradient do."""

    @property
    def along(self) -> Along:
        """The lines of pixels that scan lines are taken to be along."""
        return "rows" if self.scan_lines is None else self.scan_lines.along

    def with_classes(self, classes: npt.NDArray[np.uint8]) -> LabelledImage:
        """Copy with other classes (H, W); probabilities and features stay."""
        return replace(self, classes=classes)

    def along_scans(self, along: Along) -> LabelledImage:
        """Return the image with gradients taken along scan lines that run along these lines of pixels."""
        lines = self.scan_lines
        return self if lines is None or lines.along == along else lines.regraded(along)

    def without_shares(self) -> LabelledImage:
        """Copy in which each pixel belongs to its class with certainty."""
        return self if self.shares is None else replace(self, shares=None)

    @cached_property
    def core(self) -> core.LabelledImage:
        """Label image of the Rust core, copied on first use."""
        return core.LabelledImage(self.classes, self.shares, self.blur_px)


@dataclass(frozen=True, eq=False)
class FrameObservation:
    """A frame as one cue observes it: a sweep and the image taken with it."""

    cloud: LabelledCloud
    image: LabelledImage
    """Label image; no pixel has a class if the drive has no label image."""
    weight: float = 1.0
    """Weight of each point when a pose is refined; one of several cues may weigh less."""
    twist_per_s: Sequence[float] | None = None
    """(6,) twist of the LiDAR in its own frame, metres and radians per second; None if it is not known."""
    lag_s: float = 0.0
    """Time by which the sweep was moved to that of the image: see `motion.Compensated`."""
    is_rigid: bool = False
    """Whether the sweep has no point times and was moved as a whole: see `motion.Compensated`."""


@dataclass(frozen=True)
class Observations:
    """Points and label images of all frames by each cue, with the names of their classes and the camera.

    The settings that hold for every solver and every check, `max_baseline_m` and `edge_band_px`, are part of them.
    """

    camera: Camera
    lidar: Lidar | None
    frame_observations: tuple[FrameObservation, ...]
    """All frames by the first cue, then all frames by the next one. `clouds`, `images` and the core use this order."""
    point_class_names: Sequence[str]
    image_class_names: Sequence[str]
    motion_error_px: float | None = None
    """Median displacement of the points by the rig's motion during a sweep: see `motion.motion_error_px`."""
    have_times: bool = False
    """Whether points have the times at which they were measured: see `motion.have_times`."""
    num_cues: int = 1
    """Number of cues, each of which observes every frame."""
    starts: StartsConfig | None = None
    """How a pose is refined from several starts, if the information has many maxima near the right one."""
    by_classes: bool = False
    """Whether to use the classes of points that have partitions."""
    speckle: float = 0.0
    """Share of the pixels that were isolated among other classes, and got the class around them."""
    known_scenes: Sequence[int] | None = None
    """Number of the scene that each frame shows, kept when clouds are moved or frames are chosen; None if frames have
    not been compared yet."""
    max_baseline_m: float = MAX_BASELINE_M
    """Maximum distance between camera and LiDAR, at which poses are held."""
    edge_band_px: int = EDGE_BAND_PX
    """Pixels closer than this to another class count a tenth."""

    @property
    def origin_m(self) -> tuple[float, ...]:
        """Where the rays of the LiDAR start (3,), metres, LiDAR frame."""
        return (0.0, 0.0, 0.0) if self.lidar is None else self.lidar.origin_m

    def rays(self, points: Points) -> Points:
        """Compute the vectors (N, 3) from where rays start to points (N, 3), metres, LiDAR frame."""
        return points if self.lidar is None else self.lidar.rays(points)

    @property
    def num_frames(self) -> int:
        """Number of frames of the drive: pairs of sweep and image."""
        return len(self.frame_observations) // self.num_cues

    @property
    def frame_indices(self) -> npt.NDArray[np.intp]:
        """Index of the frame of each of `frame_observations`."""
        return np.tile(np.arange(self.num_frames), self.num_cues)

    @property
    def clouds(self) -> list[LabelledCloud]:
        """Clouds of all frames by each cue."""
        return [observed.cloud for observed in self.frame_observations]

    @property
    def images(self) -> list[LabelledImage]:
        """Label images of all frames by each cue."""
        return [observed.image for observed in self.frame_observations]

    @property
    def has_vectors(self) -> bool:
        """Whether points and pixels have features."""
        return all(cloud.vectors is not None for cloud in self.clouds)

    @property
    def is_multimodal(self) -> bool:
        """Whether the information has many maxima near the right one, so that a pose is refined from several starts."""
        return self.starts is not None

    @property
    def has_partitions(self) -> bool:
        """Whether poses are refined by partitions of the points, such as segments, instead of their classes."""
        return not self.by_classes and any(cloud.partitions is not None for cloud in self.clouds)

    @property
    def is_local(self) -> bool:
        """Whether these points show only small offsets of the pose, as those of edges or intensity alone do.

        `Cue.is_local` states it of one cue; here, points may be those of several cues, or segments by their kinds.
        """
        return self.is_multimodal and not self.has_partitions

    @property
    def unit(self) -> str:
        """Unit of the information: nats, or for partitions the adjusted mutual information (AMI), a share."""
        return "AMI" if self.has_partitions else "nats"

    @cached_property
    def of_classes(self) -> Observations:
        """The same without partitions: with the classes of points, which all frames share."""
        return replace(self, by_classes=True) if self.has_partitions else self

    @cached_property
    def without_edge_band(self) -> Observations:
        """The same without an edge band, for coarse blocks, most of which are near another class."""
        return replace(self, edge_band_px=0) if self.edge_band_px else self

    @property
    def shared_settings(self) -> dict[str, object]:
        """Settings of every solver, as a result records them."""
        return {"max_baseline_m": self.max_baseline_m, "edge_band_px": self.edge_band_px}

    def of_frames(self, indices: Iterable[int]) -> Observations:
        """Return the observations of some of the frames, by each cue."""
        kept = list(indices)
        of_cues = (self.frame_observations[self.span_of_cue(cue)] for cue in range(self.num_cues))
        scenes = None if self.known_scenes is None else [self.known_scenes[index] for index in kept]
        return replace(self._with(of_cue[index] for of_cue in of_cues for index in kept), known_scenes=scenes)

    def of_cue(self, cue: int) -> Observations:
        """Return the observations of all frames by one cue, counted from 0."""
        if self.num_cues == 1:
            return self
        return replace(self._with(self.frame_observations[self.span_of_cue(cue)]), num_cues=1)

    def span_of_cue(self, cue: int) -> slice:
        """Return the slice of `frame_observations` with the observations by one cue, counted from 0."""
        return slice(cue * self.num_frames, (cue + 1) * self.num_frames)

    def with_clouds(self, clouds: Iterable[LabelledCloud]) -> Observations:
        """Copy with another cloud in each of `frame_observations`; scenes stay."""
        pairs = zip(self.frame_observations, clouds, strict=True)
        return self._with(replace(observed, cloud=cloud) for observed, cloud in pairs)

    def with_images(self, images: Iterable[LabelledImage]) -> Observations:
        """Copy with another label image in each of `frame_observations`."""
        pairs = zip(self.frame_observations, images, strict=True)
        return self._with(replace(observed, image=image) for observed, image in pairs)

    def along(self, T_camera_lidar: Pose) -> Along:
        """Find along what scan lines run in the images at a pose (4, 4)."""
        axes = (image.scan_lines.axis for image in self.images if image.scan_lines is not None)
        return along_at(T_camera_lidar, next(axes, Z_AXIS))

    def along_scans(self, T_camera_lidar: Pose) -> Observations:
        """Return the observations with image gradients taken along the scan lines, as a pose (4, 4) projects them.

        Raises:
            InputError: an image that is read again is missing or wrong.
            CalibrationError: no pixel of it has a gradient.
        """
        along = self.along(T_camera_lidar)
        if all(image.scan_lines is None or image.along == along for image in self.images):
            return self
        with thread_pool() as pool:
            return self.with_images(pool.map(lambda image: image.along_scans(along), self.images))

    def weighed(self, weight: float) -> Observations:
        """Copy in which each point weighs so many times as much when a pose is refined."""
        if weight == 1.0:
            return self
        frames = self.frame_observations
        return self._with(replace(observed, weight=weight * observed.weight) for observed in frames)

    def _with(self, frame_observations: Iterable[FrameObservation]) -> Observations:
        return replace(self, frame_observations=tuple(frame_observations))

    @cached_property
    def scenes(self) -> Sequence[int]:
        """For each frame, the index of the first frame that shows the same scene."""
        if self.known_scenes is not None:
            return [self.known_scenes.index(scene) for scene in self.known_scenes]
        return alike_frames(core.nearest_ranges([self.rays(cloud.points) for cloud in self.of_cue(0).clouds]))

    @property
    def scene_numbers(self) -> list[int]:
        """Number of the scene of each of `frame_observations`; what two cues see of one scene counts twice."""
        return [scene + cue * self.num_frames for cue in range(self.num_cues) for scene in self.scenes]

    @property
    def with_scenes(self) -> Observations:
        """The same with known scenes, so that no copy compares frames again."""
        return self if self.known_scenes is not None else replace(self, known_scenes=self.scenes)

    def information(self, T_camera_lidar: Pose) -> float:
        """Compute the mutual information of classes at a pose (4, 4) minus its bias, nats."""
        agreement = core.agreement(self.core, T_camera_lidar)
        return agreement.mutual_information - agreement.bias

    def turn_loss(self, T_camera_lidar: Pose) -> float:
        """Compute the share of the information at a pose (4, 4) that the camera loses if it is turned by 5 degrees.

        It is the mean over both turns about each axis of the camera. Around a wrong pose the information hardly falls,
        or even rises, whichever cue it is of; the share of points that agree may rise there.
        """
        turns = math.radians(TURN_DEG) * np.eye(6)[3:]
        turned = [
            self.information(apply_twist(T_camera_lidar, twist)) for twist in np.concatenate([turns, -turns])
        ]
        own = self.information(T_camera_lidar)
        return 1.0 - float(np.mean(turned)) / own if own > 0.0 else 0.0

    @cached_property
    def core(self) -> core.Observations:
        """Observations of the Rust core, which share frames with other observations of them.

        Raises:
            InputError: counts, sizes or classes do not match.
        """
        return core.Observations(
            core_camera(self.camera),
            [
                (frame.cloud.core, frame.image.core, frame.weight, scene)
                for frame, scene in zip(self.frame_observations, self.scene_numbers, strict=True)
            ],
            len(self.point_class_names),
            len(self.image_class_names),
            self.max_baseline_m,
            self.edge_band_px,
            self.origin_m,
            self.by_classes,
        )
