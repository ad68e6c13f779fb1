"""The labelled points and label images of all frames, with dense classes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.classes import NO_CLASS, ClassTable, class_table
from semcal_cli.drive.document import Camera, Drive, Frame, Lidar
from semcal_cli.drive.motion import compensated, motion_error_px
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.files.images import read_image
from semcal_cli.files.point_clouds import Sweeps

Labels: TypeAlias = npt.NDArray[np.uint16] | _core.ClassShares
"""Raw ids of pixels or points as read, or their probabilities."""


@dataclass(frozen=True)
class Observations:
    """What a calibration is made from."""

    camera: Camera
    lidar: Lidar | None
    points: Sequence[npt.NDArray[np.float32]]
    """(N, 3) of each frame, metres, LiDAR frame."""
    point_classes: Sequence[npt.NDArray[np.uint8]]
    """(N,) of each frame: an index into `point_class_names`, or `NO_CLASS`."""
    image_classes: Sequence[npt.NDArray[np.uint8]]
    """(H, W) of each frame: an index into `image_class_names`, or `NO_CLASS`."""
    point_class_names: Sequence[str]
    image_class_names: Sequence[str]
    point_shares: Sequence[_core.ClassShares | None] = ()
    """Of each frame whose points have class probabilities; `point_classes` are then the likeliest. Empty: of none."""
    image_shares: Sequence[_core.ClassShares | None] = ()
    """Likewise of the pixels."""
    point_vectors: Sequence[npt.NDArray[np.float16]] = ()
    """(N, C) of each frame: features of the points, whose codes are then their classes. Empty without features."""
    image_vectors: Sequence[npt.NDArray[np.float16]] = ()
    """(H / s, W / s, C) of each frame: features of blocks of s x s pixels."""
    num_no_returns: Sequence[int] = ()
    """Entries of each sweep that were not finite or all zero, and were left out."""
    twists_per_s: Sequence[Sequence[float]] | None = None
    """(6,) of each frame: how the LiDAR moves, metres and radians a second in its own frame; None if not known."""
    motion_error_px: float | None = None
    """How far the rig's motion during a sweep may displace half of the points: see `motion.motion_error_px`."""
    speckle: float = 0.0
    """Share of the pixels that were isolated among pixels of other classes, and took the class around them."""

    @property
    def num_frames(self) -> int:
        """How many pairs of sweep and image there are."""
        return len(self.points)

    def of_frames(self, indices: Sequence[int]) -> Observations:
        """Give the same of some frames only."""
        return replace(
            self,
            points=[self.points[i] for i in indices],
            point_classes=[self.point_classes[i] for i in indices],
            image_classes=[self.image_classes[i] for i in indices],
            point_shares=[self.point_shares[i] for i in indices] if self.point_shares else (),
            image_shares=[self.image_shares[i] for i in indices] if self.image_shares else (),
            point_vectors=[self.point_vectors[i] for i in indices] if self.point_vectors else (),
            image_vectors=[self.image_vectors[i] for i in indices] if self.image_vectors else (),
            num_no_returns=[self.num_no_returns[i] for i in indices] if self.num_no_returns else (),
            twists_per_s=self.twists_per_s and [self.twists_per_s[i] for i in indices],
        )

    @cached_property
    def core(self) -> _core.Observations:
        """The same for the Rust core."""
        return _core.Observations(
            core_camera(self.camera),
            list(self.points),
            list(self.point_classes),
            list(self.image_classes),
            len(self.point_class_names),
            len(self.image_class_names),
            self.point_shares or [None] * self.num_frames,
            self.image_shares or [None] * self.num_frames,
        )


def load_observations(drive: Drive, sweeps: Sweeps | None = None) -> Observations:
    """Load every frame of a drive, in parallel, and mend isolated pixels; sweeps that were read are not read again.

    Raises:
        InputError: a file is missing or is not what its name or the drive says, or one side carries no class.
        CalibrationError: one side carries a single class.
    """
    return mend(read_observations(drive, sweeps))


def read_observations(drive: Drive, sweeps: Sweeps | None = None) -> Observations:
    """Load every frame of a drive, in parallel, with labels as they are.

    Raises:
        InputError: a file is missing or is not what its name or the drive says, or one side carries no class.
        CalibrationError: one side carries a single class.
    """
    label_images = read_label_images(drive)
    clouds = read_clouds(drive, sweeps)
    points, twists_per_s = compensated(drive, clouds)
    point_labels = _point_labels(drive, clouds)
    point_table = _class_table(drive, "points", [_ids(labels) for labels in point_labels])
    image_table = _class_table(drive, "image", [_ids(labels) for labels in label_images])
    point_classes, point_shares = zip(*(_dense(labels, point_table) for labels in point_labels), strict=True)
    image_classes, image_shares = zip(*(_dense(labels, image_table) for labels in label_images), strict=True)
    size = drive.camera.height, drive.camera.width
    return Observations(
        camera=drive.camera,
        lidar=drive.lidar,
        points=points,
        point_classes=point_classes,
        image_classes=[classes.reshape(size) for classes in image_classes],
        point_class_names=point_table.names,
        image_class_names=image_table.names,
        point_shares=point_shares if any(point_shares) else (),
        image_shares=image_shares if any(image_shares) else (),
        num_no_returns=[cloud.num_no_returns for cloud in clouds],
        twists_per_s=twists_per_s,
        motion_error_px=motion_error_px(drive, clouds),
    )


def load_points(drive: Drive) -> Observations:
    """Load the clouds of a drive, and its label images where every frame has one; no point has a class.

    Raises:
        InputError: a file is missing or is not what its name or the drive says.
    """
    clouds = read_clouds(drive)
    points, twists_per_s = compensated(drive, clouds)
    observations = Observations(
        camera=drive.camera,
        lidar=drive.lidar,
        points=points,
        point_classes=[np.full(len(cloud), NO_CLASS, np.uint8) for cloud in points],
        image_classes=[],
        point_class_names=[],
        image_class_names=[],
        twists_per_s=twists_per_s,
    )
    if any(frame.image_labels is None for frame in drive.frames):
        return observations
    label_images = read_label_images(drive)
    table = _class_table(drive, "image", [_ids(labels) for labels in label_images])
    size = drive.camera.height, drive.camera.width
    classes = [_dense(labels, table)[0].reshape(size) for labels in label_images]
    return replace(observations, image_classes=classes, image_class_names=table.names)


def colors(drive: Drive) -> list[tuple[int, int, int]] | None:
    """Red, green, blue of each class of colour-coded label images, in the palette's order."""
    return None if drive.palette is None else [(r, g, b) for r, g, b in drive.palette.values()]


def read_label_images(drive: Drive) -> list[Labels]:
    """Read the label images of all frames, ids or probabilities by their suffix.

    Raises:
        InputError: a file is missing or is not what its name or the drive says.
    """
    paths, camera = label_paths(drive, "image_labels"), drive.camera
    soft = [path for path in paths if path.suffix.lower() == ".npz"] if drive.palette is None else []
    hard = [path for path in paths if path not in soft]
    shares: Iterator[Labels] = iter(_core.read_class_shares(soft, (camera.height, camera.width)))
    ids: Iterator[Labels] = iter(_core.read_label_images(hard, camera.width, camera.height, colors(drive)))
    return [next(shares if path in soft else ids) for path in paths]


def read_frame_image(drive: Drive, frame: Frame) -> npt.NDArray[np.uint8] | None:
    """Read the image (H, W, 3) of a frame, blue, green, red, if it has one.

    Raises:
        InputError: it is damaged, or of another size than the camera's.
    """
    if frame.image is None:
        return None
    path, camera = drive.resolve(frame.image), drive.camera
    image = read_image(path)
    found, needed = image.shape[1::-1], (camera.width, camera.height)
    if found != needed:
        raise InputError(f"{path}: found {found[0]} x {found[1]} pixels, needed {needed[0]} x {needed[1]}")
    return image


def _ids(labels: Labels) -> npt.NDArray[np.uint16]:
    return labels.ids if isinstance(labels, _core.ClassShares) else labels


def _dense(labels: Labels, table: ClassTable) -> tuple[npt.NDArray[np.uint8], _core.ClassShares | None]:
    """Classes of all items, and their shares where they were read."""
    if not isinstance(labels, _core.ClassShares):
        return table(labels), None
    shares = labels.renamed(table.lookup[:256])
    return shares.classes, shares


def mend(observations: Observations) -> Observations:
    """Give isolated pixels of the label images the class around them: see `rust/speckle.rs`.

    Pictures with probabilities stay as they are.
    """
    images = list(observations.image_classes)
    shares = observations.image_shares or [None] * observations.num_frames
    hard = [index for index, soft in enumerate(shares) if soft is None]
    num_mended = 0
    for index, (mended, count) in zip(hard, _core.despeckle([images[i] for i in hard]), strict=True):
        images[index] = mended
        num_mended += count
    num_pixels = sum(image.size for image in images)
    return replace(observations, image_classes=images, speckle=num_mended / num_pixels)


def read_clouds(drive: Drive, sweeps: Sweeps | None = None) -> list[_core.PointCloud]:
    """Read the sweep of every frame, in parallel, with labels where there are some.

    Raises:
        InputError: a file is missing or is not what its name says.
    """
    labels = [drive.resolve(f.point_labels) if f.point_labels else None for f in drive.frames]
    points = [drive.resolve(frame.points) for frame in drive.frames]
    return (Sweeps() if sweeps is None else sweeps).read(list(zip(points, labels, strict=True)))


def _point_labels(drive: Drive, clouds: Sequence[_core.PointCloud]) -> list[Labels]:
    labels = [cloud.labels if cloud.label_shares is None else cloud.label_shares for cloud in clouds]
    found = [each for each in labels if each is not None]
    if len(found) < len(clouds):
        frame = next(f for f, each in zip(drive.frames, labels, strict=True) if each is None)
        nothing = "found nothing, and the cloud has no field of class ids"
        needed = "needed a file of class ids, or a field named label, class, semantic or the like"
        raise InputError(f"{drive.path}: {frame.key('point_labels')}: {nothing}; {needed}")
    return found


def label_paths(drive: Drive, key: Literal["point_labels", "image_labels"]) -> list[Path]:
    """Give the files of the labels of one side, of each frame.

    Raises:
        InputError: a frame has none.
    """
    for frame in drive.frames:
        if getattr(frame, key) is None:
            raise InputError(f"{drive.path}: {frame.key(key)}: found nothing, needed a file of class ids")
    return [drive.resolve(getattr(frame, key)) for frame in drive.frames]


def count_labels(
    drive: Drive, side: Literal["points", "image"], labels: Labels
) -> tuple[dict[str, int], int]:
    """Count labels by name, and those that carry no information; probabilities by the likeliest."""
    ignored = set(getattr(drive.ignore, side))
    if isinstance(labels, _core.ClassShares):
        counts = np.bincount(labels.classes)
        ignored.add(NO_CLASS)
    else:
        counts = np.bincount(labels.ravel())
    named = _named_ids(drive, side)
    names = {value: name for name, values in named.items() for value in values}
    found: dict[str, int] = {}
    for value in np.flatnonzero(counts).tolist():
        name = names.get(value, "" if named else str(value))
        if value not in ignored and name:
            found[name] = found.get(name, 0) + int(counts[value])
    return found, int(counts.sum()) - sum(found.values())


def _named_ids(drive: Drive, side: Literal["points", "image"]) -> Mapping[str, Sequence[int]]:
    """Raw ids under each name: those of the palette are places in it."""
    if side == "image" and drive.palette is not None:
        return {name: (place,) for place, name in enumerate(drive.palette)}
    return getattr(drive.classes, side) if drive.classes else {}


def _class_table(
    drive: Drive, side: Literal["points", "image"], ids: Sequence[npt.NDArray[np.uint16]]
) -> ClassTable:
    has_ids = drive.ignore.image or (drive.classes and drive.classes.image)
    if side == "image" and drive.palette is not None and has_ids:
        needed = "no ids beside it; colours that are not listed are ignored"
        raise InputError(f"{drive.path}: palette: found classes.image or ignore.image, too, needed {needed}")
    try:
        table = class_table(ids, _named_ids(drive, side), getattr(drive.ignore, side))
    except ValueError as error:
        raise InputError(f"{drive.path}: classes.{side}: {error}") from None
    if not table.names:
        raise InputError(f"{drive.path}: {side}: every label is ignored or not listed under classes")
    if len(table.names) == 1:
        found = f"{drive.path}: {side}: found one class only, {table.names[0]!r}"
        raise CalibrationError(f"{found}, needed at least 2 for mutual information")
    return table
