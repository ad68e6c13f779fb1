"""What is asked of a data set, and what it answers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from semcal_cli.datasets.files import need_folder
from semcal_cli.datasets.ontologies import Ontology
from semcal_cli.geometry.poses import Pose


@dataclass(frozen=True)
class Request:
    """What a user asks for."""

    root: Path
    """The data set's folder."""
    sequence: str | None = None
    """None: the only one there is."""
    camera: str | None = None
    """None: the data set's usual one."""
    version: str | None = None
    """The folder of nuScenes' tables; the release of CARLA."""

    def __post_init__(self) -> None:
        """Check that there is such a folder.

        Raises:
            InputError: there is none.
        """
        need_folder(self.root)


@dataclass(frozen=True)
class Cloud:
    """A point cloud that had to be converted."""

    points: npt.NDArray[np.float32]
    """(N, 4): metres in the LiDAR frame, and intensity, 0 where there is none."""
    labels: npt.NDArray[np.uint32] | None
    """(N,) ids."""


@dataclass(frozen=True)
class Conversion:
    """Makes a cloud that no file of the data set holds as a drive needs it."""

    cloud: Callable[[], Cloud]
    has_labels: bool
    """Whether the cloud comes with labels that are to be written."""
    file: Path
    """Where the points come from."""
    in_order: bool
    """Whether these are the points of the file in its order; else no file of labels can fit."""


@dataclass(frozen=True)
class SourceFrame:
    """A sweep and the picture taken with it, where they lie."""

    name: str
    """Number or name in the data set."""
    points: Path | Conversion
    """The file of the cloud, or what makes it."""
    point_labels: Path | None = None
    image_labels: Path | None = None
    image: Path | None = None
    points_stamp: float | None = None
    """Seconds."""
    image_stamp: float | None = None
    """Seconds."""
    speed_mps: float | None = None
    """How fast the rig moves."""
    T_camera_lidar: Pose | None = None
    """Reference of this frame alone, where motion between sweep and picture is in it."""
    label_names: tuple[str, ...] = ()
    """Names, without suffix, of label files of this data set that do not follow from the frame's files."""

    @property
    def cloud_file(self) -> Path | None:
        """The file that holds the points in their order, if there is one."""
        if isinstance(self.points, Conversion):
            return self.points.file if self.points.in_order else None
        return self.points

    @property
    def has_point_labels(self) -> bool:
        """Whether its points have labels, in a file or by the conversion."""
        converted = isinstance(self.points, Conversion) and self.points.has_labels
        return converted or self.point_labels is not None


@dataclass(frozen=True)
class Recording:
    """One sequence through one camera."""

    camera: Mapping[str, Any]
    """The `camera:` block of a drive."""
    frames: Sequence[SourceFrame]
    """In order of time."""
    T_camera_lidar: Pose | None = None
    """p_camera = T_camera_lidar * p_lidar; None if each frame has its own, or there is none."""
    lidar: Mapping[str, Any] | None = None
    """The `lidar:` block of a drive, if the scan pattern is known."""
    point_classes: Ontology | None = None
    image_classes: Ontology | None = None
    ids_in_red: bool = False
    """Whether the label images are colours whose red is the id, and whose green and blue are 0."""
    remarks: tuple[str, ...] = ()
    """What the user should know, a sentence each."""
    read: tuple[Path, ...] = ()
    """Files of YAML that were read, so that no drive.yaml goes there."""
    labels_by: str = "DIR"
    """What --point-labels and --image-labels take."""
