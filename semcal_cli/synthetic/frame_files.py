"""Files of the frames of a synthetic drive."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.errors import InputError, os_reason
from semcal_cli.files.image_files import write_image
from semcal_cli.files.output_files import write_bytes
from semcal_cli.geometry.arrays import ClassIds, Pose
from semcal_cli.synthetic.label_noise import mislabel
from semcal_cli.synthetic.street_motion import (
    IMAGE_LABELS,
    ONTOLOGY,
    POINT_LABELS,
    generator,
    lidar_twist,
    stamps,
)

UNLABELED = 0
"""Id of pixels that the lens does not reach; no point has it."""
SKY = "sky"
FIRST_DISJOINT_ID = 100
"""First id of label images with a disjoint ontology, above every id of the synthetic classes."""

SWEEP_FOLDERS, IMAGE_FOLDERS = ("points", "point_labels"), ("image_labels", "images")
SUFFIXES = {"points": "bin", "point_labels": "label", "image_labels": "png", "images": "png"}
TIMED_POINTS_SUFFIX = "pcd"
"""Suffix of point clouds with a time for each point, which a .bin cannot hold."""
TIMED_FIELDS = ("x", "y", "z", "intensity", "time")
"""Fields of such a point cloud, four bytes each."""


@dataclass(frozen=True)
class FrameSummary:
    """Summary of a written frame."""

    num_points: int
    """Number of points of the sweep."""
    classes: frozenset[int]
    """Classes of points and pixels, before label noise."""


@dataclass(frozen=True)
class DrivePlace:
    """Place of a drive in a rig: its camera and LiDAR, and the drives that have its sweeps and images already."""

    camera: int = 0
    """Number of the camera. The label noise differs between cameras."""
    lidar: int = 0
    """Number of the LiDAR. So does that of points between LiDARs."""
    T_first_lidar: Pose | None = None
    """(4, 4) pose of the LiDAR in the frame of the first one, metres; None for the first one."""
    sweeps: str | None = None
    """Folder, relative to this drive's, of another camera's drive with the same LiDAR, whose sweeps are listed."""
    images: str | None = None
    """Folder of another LiDAR's drive with the same camera, whose images are listed."""

    @property
    def is_listed(self) -> bool:
        """Whether other drives have all of its files."""
        return self.sweeps is not None and self.images is not None

    def prefix(self, folder: str) -> str:
        """Return what precedes the name of a file in a folder of a drive."""
        other = self.sweeps if folder in SWEEP_FOLDERS else self.images
        return "" if other is None else f"{other}/"


def write_frame(
    config: SynthConfig, renderer: core.Renderer, out: Path, place: DrivePlace, number: int
) -> FrameSummary:
    """Render a frame and write its files, but those that another drive has already.

    Raises:
        InputError: a file cannot be written.
    """
    frame = renderer.frame(config.seed, number, lidar_twist(config, number))
    labels, image_labels = frame.point_labels, frame.image_labels
    path = {folder: out / name for folder, name in file_names(config, number).items()}
    if place.sweeps is None:
        write_bytes(_cloud(config, frame), path["points"])
        point_labels = _noisy_point_labels(config, labels, number, place.lidar)
        write_bytes(point_labels.astype("<u4").tobytes(), path["point_labels"])
    if place.images is None:
        rng = generator(config, IMAGE_LABELS, number, *([] if place.camera == 0 else [place.camera]))
        noisy = mislabel(image_labels, config.label_noise, class_ids(), rng, UNLABELED)
        write_image(image_ids(config)[noisy], path["image_labels"])
        write_image(frame.image_rgb[..., ::-1], path["images"])
    classes = np.union1d(labels & 0xFFFF, image_labels)
    return FrameSummary(len(labels), frozenset(classes.tolist()))


def image_ids(config: SynthConfig) -> ClassIds:
    """Make the table (256,) that maps ids of the synthetic classes to those of the label images."""
    table = np.arange(256, dtype=np.uint8)
    if config.ontology == "disjoint":
        classes = class_ids()
        shuffled = generator(config, ONTOLOGY).permutation(len(classes))
        table[classes] = FIRST_DISJOINT_ID + shuffled
    return table


def class_ids() -> ClassIds:
    """List the ids of the synthetic classes."""
    return np.array([id_ for id_, _ in core.synthetic_classes()], dtype=np.uint8)


def frame_document(config: SynthConfig, number: int, place: DrivePlace) -> dict[str, str | float]:
    """Make the entry of a frame in drive.yaml."""
    names = {folder: place.prefix(folder) + name for folder, name in file_names(config, number).items()}
    return {
        "points": names["points"],
        "point_labels": names["point_labels"],
        "image_labels": names["image_labels"],
        "image": names["images"],
        **stamps(config, number),
    }


def file_names(config: SynthConfig, number: int) -> dict[str, str]:
    """Name the files of a frame, by folder."""
    suffixes = SUFFIXES if config.motion == "none" else SUFFIXES | {"points": TIMED_POINTS_SUFFIX}
    return {folder: f"{folder}/{number:06d}.{suffix}" for folder, suffix in suffixes.items()}


@contextmanager
def name_folder_in_errors(out: Path) -> Iterator[None]:
    """Name the folder of a drive in the error if a file in it cannot be written."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {os_reason(error)}") from None


def _cloud(config: SynthConfig, frame: core.RenderedFrame) -> bytes:
    """Make the content of a point cloud: KITTI's records, or a binary PCD if each point has its own time."""
    if config.motion == "none":
        return frame.points.astype("<f4").tobytes()
    records = np.column_stack([frame.points, frame.point_times]).astype("<f4")
    header = [
        "VERSION 0.7",
        "FIELDS " + " ".join(TIMED_FIELDS),
        "SIZE" + len(TIMED_FIELDS) * " 4",
        "TYPE" + len(TIMED_FIELDS) * " F",
        "COUNT" + len(TIMED_FIELDS) * " 1",
        f"WIDTH {len(records)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(records)}",
        "DATA binary",
    ]
    return ("\n".join(header) + "\n").encode() + records.tobytes()


def _noisy_point_labels(
    config: SynthConfig, labels: npt.NDArray[np.uint32], number: int, lidar: int
) -> npt.NDArray[np.uint32]:
    """Mislabel points (N,), `instance << 16 | class`, but never as sky, which returns no points."""
    classes = np.array([id_ for id_, name in core.synthetic_classes() if name != SKY], dtype=np.uint8)
    true = (labels & 0xFFFF).astype(np.uint8)
    rng = generator(config, POINT_LABELS, number, *([] if lidar == 0 else [lidar]))
    noisy = mislabel(true, config.label_noise, classes, rng, UNLABELED)
    return (labels & np.uint32(0xFFFF0000)) | noisy
