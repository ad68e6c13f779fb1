"""The labelled points and label images of all frames, with dense classes.

The arrays of a frame are copied to the Rust core once, when it first needs them. Subsets, other cameras and other
labels share whatever they have in common, here and in the core; so nobody may write to an array.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import Camera, Lidar


@dataclass(frozen=True, eq=False)
class LabelledCloud:
    """The points of one frame."""

    points: npt.NDArray[np.float32]
    """(N, 3) metres, LiDAR frame, at the moment of the picture if the motion is known."""
    classes: npt.NDArray[np.uint8]
    """(N,) an index into `Observations.point_class_names`, or `NO_CLASS`."""
    shares: _core.ClassShares | None = None
    """Probabilities of the classes of each point, if there are some; `classes` are then the likeliest."""
    vectors: npt.NDArray[np.float16] | None = None
    """(N, C) features, whose codes are then the classes; None without features."""

    @property
    def num_points(self) -> int:
        """How many points there are, with a class or without."""
        return len(self.points)

    def with_points(self, points: npt.NDArray[np.float32]) -> LabelledCloud:
        """Give the same labels to points (N, 3) that lie elsewhere."""
        return replace(self, points=points)

    def with_classes(self, classes: npt.NDArray[np.uint8]) -> LabelledCloud:
        """Give the points other classes (N,); probabilities and features stay."""
        return replace(self, classes=classes)

    @cached_property
    def core(self) -> _core.LabelledCloud:
        """The same for the Rust core, copied at the first use."""
        return _core.LabelledCloud(self.points, self.classes, self.shares)


@dataclass(frozen=True, eq=False)
class LabelledImage:
    """The pixels of one frame."""

    classes: npt.NDArray[np.uint8]
    """(H, W) an index into `Observations.image_class_names`, or `NO_CLASS`."""
    shares: _core.ClassShares | None = None
    """Probabilities of the classes of each pixel, row by row, if there are some; `classes` are then the likeliest."""
    vectors: npt.NDArray[np.float16] | None = None
    """(H / s, W / s, C) features of blocks of s x s pixels, whose codes are then the classes; None without features."""

    def with_classes(self, classes: npt.NDArray[np.uint8]) -> LabelledImage:
        """Give the pixels other classes (H, W); probabilities and features stay."""
        return replace(self, classes=classes)

    def without_shares(self) -> LabelledImage:
        """Give the same with each pixel certain to be of its class."""
        return self if self.shares is None else replace(self, shares=None)

    @cached_property
    def core(self) -> _core.LabelledImage:
        """The same for the Rust core, copied at the first use."""
        return _core.LabelledImage(self.classes, self.shares)


@dataclass(frozen=True, eq=False)
class FrameObservation:
    """A sweep and the picture taken with it."""

    cloud: LabelledCloud
    image: LabelledImage
    """None of its pixels has a class where the drive has no label image."""
    twist_per_s: Sequence[float] | None = None
    """(6,) how the LiDAR moves, metres and radians a second in its own frame; None if not known."""


@dataclass(frozen=True)
class Observations:
    """What a calibration is made from."""

    camera: Camera
    lidar: Lidar | None
    frames: tuple[FrameObservation, ...]
    point_class_names: Sequence[str]
    image_class_names: Sequence[str]
    motion_error_px: float | None = None
    """How far the rig's motion during a sweep may displace half of the points: see `motion.motion_error_px`."""
    speckle: float = 0.0
    """Share of the pixels that were isolated among pixels of other classes, and took the class around them."""

    @property
    def num_frames(self) -> int:
        """How many pairs of sweep and image there are."""
        return len(self.frames)

    @property
    def clouds(self) -> list[LabelledCloud]:
        """The cloud of each frame."""
        return [frame.cloud for frame in self.frames]

    @property
    def images(self) -> list[LabelledImage]:
        """The label image of each frame."""
        return [frame.image for frame in self.frames]

    @property
    def has_vectors(self) -> bool:
        """Whether points and pixels have features."""
        return all(frame.cloud.vectors is not None for frame in self.frames)

    def of_frames(self, indices: Iterable[int]) -> Observations:
        """Give the same of some frames only."""
        return replace(self, frames=tuple(self.frames[index] for index in indices))

    def with_clouds(self, clouds: Iterable[LabelledCloud]) -> Observations:
        """Give the same with another cloud in each frame."""
        pairs = zip(self.frames, clouds, strict=True)
        return replace(self, frames=tuple(replace(frame, cloud=cloud) for frame, cloud in pairs))

    def with_images(self, images: Iterable[LabelledImage]) -> Observations:
        """Give the same with another label image in each frame."""
        pairs = zip(self.frames, images, strict=True)
        return replace(self, frames=tuple(replace(frame, image=image) for frame, image in pairs))

    @cached_property
    def core(self) -> _core.Observations:
        """The same for the Rust core, which shares the frames with all other observations that have them.

        Raises:
            InputError: counts, sizes or classes disagree.
        """
        return _core.Observations(
            core_camera(self.camera),
            [(frame.cloud.core, frame.image.core) for frame in self.frames],
            len(self.point_class_names),
            len(self.image_class_names),
        )
