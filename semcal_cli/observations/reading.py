"""Reading of a drive's files into observations, with dense classes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frames import Frame
from semcal_cli.drive.held_arrays import HeldArrays
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.files.array_forms import MAX_ID, Labels, SweepCloud, cloud_of, image_of, labels_of
from semcal_cli.files.image_files import read_image
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.observations.masks import scene_masks
from semcal_cli.observations.motion import Compensated, compensated, have_times, motion_error_px
from semcal_cli.observations.observations import (
    NO_CLASS,
    FrameObservation,
    LabelledCloud,
    LabelledImage,
    Observations,
)

NUM_IDS = 65536
MAX_CLASSES = NO_CLASS
Side: TypeAlias = Literal["points", "image"]
CLASS_IDS = "a file of class ids"
"""What a frame without a label image lacks."""


@dataclass(frozen=True)
class ClassTable:
    """Table from the raw ids of points or of pixels to classes."""

    names: tuple[str, ...]
    """Name of each class, from drive.yaml, or its raw id."""
    lookup: npt.NDArray[np.uint8]
    """(65536,) class of each raw id, or `NO_CLASS`."""

    def __call__(self, labels: Labels) -> tuple[npt.NDArray[np.uint8], core.ClassShares | None]:
        """Look up the classes of raw ids, or the most likely ones with their probabilities."""
        if isinstance(labels, core.ClassShares):
            shares = labels.renamed(self.lookup[:256])
            return shares.classes, shares
        return core.look_up_classes(np.ascontiguousarray(labels), self.lookup), None


def class_table(
    raw: Sequence[Labels], ids_by_name: Mapping[str, Sequence[int]], ignored: Sequence[int]
) -> ClassTable:
    """Number the classes of the points or of the pixels.

    Args:
        raw: Labels of every frame.
        ids_by_name: Raw ids of each name; ids not listed carry no information. If empty, every id is its own class.
        ignored: Raw ids that carry no information.

    Raises:
        ValueError: there are more than 255 classes.
    """
    ids = (labels.ids if isinstance(labels, core.ClassShares) else labels for labels in raw)
    is_present = core.seen_ids([np.ascontiguousarray(frame_ids) for frame_ids in ids])
    is_present[list(ignored)] = False
    groups = ids_by_name or {str(value): (int(value),) for value in np.flatnonzero(is_present)}
    listed = {name: [i for i in ids if is_present[i]] for name, ids in groups.items()}
    present = {name: ids for name, ids in listed.items() if ids}
    if len(present) > MAX_CLASSES:
        raise ValueError(f"found {len(present)} classes, needed at most {MAX_CLASSES}")
    lookup = np.full(NUM_IDS, NO_CLASS, dtype=np.uint8)
    for index, group in enumerate(present.values()):
        lookup[group] = index
    return ClassTable(tuple(present), lookup)


def load_observations(drive: Drive, sweeps: SweepCache | None = None) -> Observations:
    """Load all frames of a drive, in parallel, and replace isolated wrong pixels; `sweeps` are not read again.

    Raises:
        InputError: a file is missing or is not what its name or the drive says, or one side carries no class.
        CalibrationError: one side carries a single class.
    """
    return remove_speckle(read_observations(drive, sweeps))


def read_observations(drive: Drive, sweeps: SweepCache | None = None) -> Observations:
    """Load all frames of a drive, in parallel, with unchanged labels.

    Raises:
        InputError: a file is missing or is not what its name or the drive says, or one side carries no class.
        CalibrationError: one side carries a single class.
    """
    images, image_names = read_image_classes(drive)
    clouds = read_clouds(drive, sweeps)
    moved = compensated(drive, clouds)
    point_labels = _point_labels(drive, clouds)
    point_table = _class_table(drive, "points", point_labels)
    labelled = [
        LabelledCloud(sweep.points, *point_table(labels))
        for sweep, labels in zip(moved, point_labels, strict=True)
    ]
    return make_observations(drive, clouds, moved, labelled, images, (point_table.names, image_names))


def check_labelled(drive: Drive, clouds: Sequence[SweepCloud]) -> None:
    """Check that all frames have image labels and point labels.

    Raises:
        InputError: a frame has none; the message names it.
    """
    for frame in drive.frames:
        drive.name_of(frame, "image_labels", CLASS_IDS)
    _point_labels(drive, clouds)


def make_observations(
    drive: Drive,
    clouds: Sequence[SweepCloud],
    moved: Sequence[Compensated],
    labelled: Sequence[LabelledCloud],
    images: Sequence[LabelledImage],
    names: tuple[Sequence[str], Sequence[str]],
) -> Observations:
    """Combine the sweeps and images of a drive; masked pixels have no class.

    Args:
        drive: The drive.
        clouds: The sweep of each frame as read.
        moved: The sweep of each frame, compensated for the rig's motion.
        labelled: The points of each frame with their classes.
        images: The image of each frame with its classes.
        names: Names of the point classes, and of the image classes.

    Raises:
        InputError: a mask is missing or wrong.
    """
    images = [
        image if mask is None else image.with_classes(np.where(mask, image.classes, np.uint8(NO_CLASS)))
        for image, mask in zip(images, scene_masks(drive, drive.frames), strict=True)
    ]
    frames = tuple(
        FrameObservation(
            cloud, image, twist_per_s=sweep.twist_per_s, lag_s=sweep.lag_s, is_rigid=sweep.is_rigid
        )
        for cloud, image, sweep in zip(labelled, images, moved, strict=True)
    )
    return Observations(
        camera=drive.camera,
        lidar=drive.lidar,
        frame_observations=frames,
        point_class_names=names[0],
        image_class_names=names[1],
        motion_error_px=motion_error_px(drive, clouds),
        have_times=have_times(clouds),
    )


def load_points(drive: Drive) -> Observations:
    """Load the clouds of a drive, and its label images if all frames have one; no point has a class.

    Raises:
        InputError: a file is missing or is not what its name or the drive says.
    """
    moved = compensated(drive, read_clouds(drive))
    names: Sequence[str] = ()
    if all(frame.image_labels is not None for frame in drive.frames):
        labelled, names = read_image_classes(drive)
        images = [image.without_shares() for image in labelled]
    else:
        blank = LabelledImage(np.full((drive.camera.height, drive.camera.width), NO_CLASS, np.uint8))
        images = [blank] * len(drive.frames)
    frames = []
    for sweep, image in zip(moved, images, strict=True):
        cloud = LabelledCloud(sweep.points, np.full(len(sweep.points), NO_CLASS, np.uint8))
        frames.append(FrameObservation(cloud, image, twist_per_s=sweep.twist_per_s))
    return Observations(
        drive.camera, drive.lidar, tuple(frames), point_class_names=(), image_class_names=names
    )


def read_image_classes(drive: Drive) -> tuple[list[LabelledImage], Sequence[str]]:
    """Read the label images of all frames, and the names of their classes.

    Raises:
        InputError: a file is missing or is not what its name or the drive says, or the images have no class.
        CalibrationError: they have a single class.
    """
    label_images = read_label_images(drive)
    table, shape = _class_table(drive, "image", label_images), (drive.camera.height, drive.camera.width)
    looked_up = [table(labels) for labels in label_images]
    return [LabelledImage(classes.reshape(shape), shares) for classes, shares in looked_up], table.names


def colors(drive: Drive) -> list[tuple[int, int, int]] | None:
    """List red, green and blue of each class of colour-coded label images, in the order of the palette."""
    return None if drive.palette is None else [(r, g, b) for r, g, b in drive.palette.values()]


def read_label_images(drive: Drive) -> list[Labels]:
    """Read the label images of all frames: ids or probabilities, depending on the suffix.

    Raises:
        InputError: a file is missing or is not what its name or the drive says.
    """
    if drive.arrays is not None:
        return [_labels_of_array(drive, frame) for frame in drive.frames]
    paths, camera = image_label_paths(drive), drive.camera
    soft = [path for path in paths if path.suffix.lower() == ".npz"] if drive.palette is None else []
    hard = [path for path in paths if path not in soft]
    shares: Iterator[Labels] = iter(core.read_class_shares(soft, (camera.height, camera.width)))
    ids: Iterator[Labels] = iter(core.read_label_images(hard, camera.width, camera.height, colors(drive)))
    return [next(shares if path in soft else ids) for path in paths]


def _labels_of_array(drive: Drive, frame: Frame, place: Any = ...) -> Labels:
    """Take a frame's image labels from an array, all of them or those at some indices."""
    assert drive.arrays is not None
    name = drive.name_of(frame, "image_labels", CLASS_IDS)
    return labels_of(name, drive.arrays.by_name[name][place], num_sides=2)


def read_thumbnails(drive: Drive, columns: int, rows: int) -> npt.NDArray[np.uint16]:
    """Read ids (F, rows, columns) of evenly spaced pixels of all label images: the most likely ids of probabilities.

    Raises:
        InputError: a file is missing or is not what its name or the drive says.
    """
    width, height = drive.camera.size
    if drive.arrays is None:
        return core.read_label_thumbnails(
            image_label_paths(drive), width, height, columns, rows, colors(drive)
        )
    place = np.ix_(
        *((2 * np.arange(n) + 1) * size // (2 * n) for n, size in ((rows, height), (columns, width)))
    )
    thumbnails = []
    for labels in (_labels_of_array(drive, frame, place) for frame in drive.frames):
        if isinstance(labels, core.ClassShares):
            classes = labels.classes
            labels = np.where(classes == NO_CLASS, MAX_ID, classes).astype(np.uint16)
        thumbnails.append(labels.reshape(rows, columns))
    return np.array(thumbnails)


def read_frame_image(drive: Drive, frame: Frame) -> npt.NDArray[np.uint8] | None:
    """Read the image (H, W, 3) of a frame, blue, green, red, if it has one.

    Raises:
        InputError: the image is damaged, or its size is not the camera's.
    """
    return None if frame.image is None else read_needed_image(drive, frame)


def read_needed_image(drive: Drive, frame: Frame) -> npt.NDArray[np.uint8]:
    """Read the image of a frame as `read_frame_image` does; a frame without one raises `InputError`, too."""
    name = drive.name_of(frame, "image", "an image")
    if drive.arrays is not None:
        return image_of(drive.arrays.by_name[name])
    return read_image(drive.resolve(name), drive.camera.size, drive.image_levels)


def remove_speckle(observations: Observations) -> Observations:
    """Replace the class of isolated pixels of the label images by the one around them: see `rust/speckle.rs`.

    Label images with probabilities stay unchanged.
    """
    images = observations.images
    hard = [index for index, image in enumerate(images) if image.shares is None]
    num_replaced = 0
    despeckled = core.despeckle([images[index].classes for index in hard])
    for index, (classes, count) in zip(hard, despeckled, strict=True):
        images[index] = images[index].with_classes(classes)
        num_replaced += count
    num_pixels = sum(image.classes.size for image in images)
    return replace(observations.with_images(images), speckle=num_replaced / num_pixels)


def read_clouds(drive: Drive, sweeps: SweepCache | None = None) -> list[SweepCloud]:
    """Read the sweeps of all frames, in parallel, with labels where there are any.

    Raises:
        InputError: a file is missing or is not what its name says.
    """
    sweeps, arrays = SweepCache() if sweeps is None else sweeps, drive.arrays
    if arrays is not None:
        keys = [((arrays, frame.points), frame.point_labels) for frame in drive.frames]
        return sweeps.get(
            keys, drive.frames, lambda frames: [_cloud_of_arrays(arrays, frame) for frame in frames]
        )
    labels = [drive.resolve(f.point_labels) if f.point_labels else None for f in drive.frames]
    points = [drive.resolve(frame.points) for frame in drive.frames]
    return sweeps.read(list(zip(points, labels, strict=True)), drive.max_points, drive.point_form)


def _cloud_of_arrays(arrays: HeldArrays, frame: Frame) -> SweepCloud:
    held, labels = arrays.by_name, frame.point_labels
    times = next(iter(arrays.times_of(frame.points).values()), None)
    cloud_labels = None if labels is None else (labels, held[labels])
    return cloud_of(frame.points, held[frame.points], times, cloud_labels)


def _point_labels(drive: Drive, clouds: Sequence[SweepCloud]) -> list[Labels]:
    labels = [cloud.labels if cloud.label_shares is None else cloud.label_shares for cloud in clouds]
    present = [cloud_labels for cloud_labels in labels if cloud_labels is not None]
    if len(present) < len(clouds):
        frame = next(f for f, cloud_labels in zip(drive.frames, labels, strict=True) if cloud_labels is None)
        needed = "expected a file of class ids, or a field of the cloud named label, class or semantic"
        if not present:
            needed += "; edges need none (--cue edges)"
        raise InputError(f"{drive.path}: {frame.key('point_labels')}: found nothing, {needed}")
    return present


def image_label_paths(drive: Drive) -> list[Path]:
    """List the label images, one for each frame.

    Raises:
        InputError: a frame has none.
    """
    return [drive.file_of(frame, "image_labels", CLASS_IDS) for frame in drive.frames]


def count_labels(drive: Drive, side: Side, labels: Labels) -> tuple[dict[str, int], int]:
    """Count labels by class name, and labels without information; probabilities count as their most likely class."""
    ignored = set(getattr(drive.ignore, side))
    if isinstance(labels, core.ClassShares):
        counts = np.bincount(labels.classes)
        ignored.add(NO_CLASS)
    else:
        counts = np.bincount(labels.ravel())
    ids_by_name = _ids_by_name(drive, side)
    names = {value: name for name, values in ids_by_name.items() for value in values}
    by_name: dict[str, int] = {}
    for value in np.flatnonzero(counts).tolist():
        name = names.get(value, "" if ids_by_name else str(value))
        if value not in ignored and name:
            by_name[name] = by_name.get(name, 0) + int(counts[value])
    return by_name, int(counts.sum()) - sum(by_name.values())


def _ids_by_name(drive: Drive, side: Side) -> Mapping[str, Sequence[int]]:
    """Return the raw ids of each class name; with a palette, an id is an index into it."""
    if side == "image" and drive.palette is not None:
        return {name: (place,) for place, name in enumerate(drive.palette)}
    return getattr(drive.classes, side) if drive.classes else {}


def _class_table(drive: Drive, side: Side, labels: Sequence[Labels]) -> ClassTable:
    has_ids = drive.ignore.image or (drive.classes and drive.classes.image)
    if side == "image" and drive.palette is not None and has_ids:
        needed = "the palette alone; colours that it does not list are ignored"
        raise InputError(
            f"{drive.path}: palette: found classes.image or ignore.image, too, expected {needed}"
        )
    try:
        table = class_table(labels, _ids_by_name(drive, side), getattr(drive.ignore, side))
    except ValueError as error:
        raise InputError(f"{drive.path}: classes.{side}: {error}") from None
    if not table.names:
        raise InputError(f"{drive.path}: {side}: every label is ignored or not listed under classes")
    if len(table.names) == 1:
        found = f"{drive.path}: {side}: found one class only, {table.names[0]!r}"
        raise CalibrationError(f"{found}, needed at least 2 for mutual information")
    return table
