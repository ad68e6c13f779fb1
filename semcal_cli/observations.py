"""The labelled points and label images of all frames, with dense classes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.camera import core_camera
from semcal_cli.classes import ClassTable, class_table
from semcal_cli.drive import Camera, Drive, Lidar
from semcal_cli.errors import CalibrationError, InputError


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
    speckle: float = 0.0
    """Share of the pixels that were isolated among pixels of other classes, and took the class around them."""

    @property
    def num_frames(self) -> int:
        """How many pairs of sweep and picture there are."""
        return len(self.points)

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
        )


def load_observations(drive: Drive) -> Observations:
    """Load every frame of a drive, in parallel, and mend isolated pixels.

    Raises:
        InputError: a file is missing or is not what its name or the drive says, or one side carries no class.
        CalibrationError: one side carries a single class.
    """
    return mend(read_observations(drive))


def read_observations(drive: Drive) -> Observations:
    """Load every frame of a drive, in parallel, with labels as they are.

    Raises:
        InputError: a file is missing or is not what its name or the drive says, or one side carries no class.
        CalibrationError: one side carries a single class.
    """
    for key in ("motion", "palette"):
        if getattr(drive, key) is not None:
            raise InputError(f"{drive.path}: {key}: is not supported yet, needed a drive without it")
    image_paths = label_paths(drive, "image_labels")
    clouds = read_clouds(drive)
    point_ids = _point_ids(drive, clouds)
    image_ids = _core.read_label_images(image_paths, drive.camera.width, drive.camera.height)
    point_table = _class_table(drive, "points", point_ids)
    image_table = _class_table(drive, "image", image_ids)
    return Observations(
        camera=drive.camera,
        lidar=drive.lidar,
        points=[cloud.points for cloud in clouds],
        point_classes=[point_table(ids) for ids in point_ids],
        image_classes=[image_table(ids) for ids in image_ids],
        point_class_names=point_table.names,
        image_class_names=image_table.names,
    )


def mend(observations: Observations) -> Observations:
    """Give isolated pixels of the label images the class around them: see `rust/speckle.rs`."""
    mended = _core.despeckle(list(observations.image_classes))
    num_isolated = sum(count for _, count in mended)
    num_pixels = sum(image.size for image, _ in mended)
    return replace(
        observations, image_classes=[image for image, _ in mended], speckle=num_isolated / num_pixels
    )


def read_clouds(drive: Drive) -> list[_core.PointCloud]:
    """Read the sweep of every frame, in parallel, with labels where there are some.

    Raises:
        InputError: a file is missing or is not what its name says.
    """
    labels = [frame.point_labels and drive.resolve(frame.point_labels) for frame in drive.frames]
    points = [drive.resolve(frame.points) for frame in drive.frames]
    return _core.read_point_clouds(list(zip(points, labels, strict=True)))


def _point_ids(drive: Drive, clouds: Sequence[_core.PointCloud]) -> list[npt.NDArray[np.uint16]]:
    ids = [cloud.labels for cloud in clouds if cloud.labels is not None]
    if len(ids) < len(clouds):
        index = next(i for i, cloud in enumerate(clouds) if cloud.labels is None)
        found = f"found nothing, and {drive.frames[index].points} has no field of class ids"
        needed = "needed a file of class ids, or a field named label, class, semantic or the like"
        raise InputError(f"{drive.path}: frames[{index}].point_labels: {found}; {needed}")
    return ids


def label_paths(drive: Drive, key: Literal["point_labels", "image_labels"]) -> list[Path]:
    """Give the files of the labels of one side, of each frame.

    Raises:
        InputError: a frame has none.
    """
    for index, frame in enumerate(drive.frames):
        if getattr(frame, key) is None:
            raise InputError(
                f"{drive.path}: frames[{index}].{key}: found nothing, needed a file of class ids"
            )
    return [drive.resolve(getattr(frame, key)) for frame in drive.frames]


def _class_table(
    drive: Drive, side: Literal["points", "image"], ids: Sequence[npt.NDArray[np.uint16]]
) -> ClassTable:
    named = getattr(drive.classes, side) if drive.classes else {}
    try:
        table = class_table(ids, named, getattr(drive.ignore, side))
    except ValueError as error:
        raise InputError(f"{drive.path}: classes.{side}: {error}") from None
    if not table.names:
        raise InputError(f"{drive.path}: {side}: every label is ignored or not listed under classes")
    if len(table.names) == 1:
        found = f"{drive.path}: {side}: found one class only, {table.names[0]!r}"
        raise CalibrationError(f"{found}, needed at least 2 for mutual information")
    return table
