"""The two sides of a frame that networks label, each with the files that it writes."""

from __future__ import annotations

import hashlib
import io
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.drive.document import Drive, Frame
from semcal_cli.drive.reading import read_clouds
from semcal_cli.errors import InputError, about
from semcal_cli.files.images import read_image
from semcal_cli.files.reading import hash_file
from semcal_cli.labelling.pictures import PictureLabeller
from semcal_cli.labelling.sweeps import KIND_IDS, SweepLabeller, segment_labels

NO_BYTE = 255
"""Id of a pixel without a label in label images of 8 bits; those of 16 bits have `_core.NO_ID`."""
FASTEST = 1
"""Level of compression: probabilities are nearly all 0 or 255."""


class Side(ABC):
    """Labels of pictures or of points, as files of a drive."""

    key: Literal["image_labels", "point_labels"]
    """Key of a frame's label file, and name of the folder."""
    source: Literal["image", "points"]
    """Key of the file that is labelled."""
    suffix: str
    """Suffix of label files."""
    classes: Mapping[str, tuple[int, ...]]
    """Ids of each name; empty without names."""
    ignore: tuple[int, ...]
    """Ids that carry no information."""
    settings: Mapping[str, object]
    """All that the labels depend on besides the file that is labelled."""

    @abstractmethod
    def label(self, drive: Drive, frame: Frame) -> bytes:
        """Compute the content of the label file of a frame.

        Raises:
            InputError: the file to label is missing or wrong, or the network fails.
        """

    @abstractmethod
    def is_whole(self, drive: Drive, path: Path) -> bool:
        """Whether a label file is there and whole."""


class PictureSide(Side):
    """Label images from a network."""

    key = "image_labels"
    source = "image"

    def __init__(self, labeller: PictureLabeller, *, is_rectified: bool, has_probabilities: bool) -> None:
        model = labeller.model
        self.labeller = labeller
        self.has_probabilities = has_probabilities
        self.suffix = ".npz" if has_probabilities else ".png"
        self.classes = model.classes
        named = {value for ids in model.classes.values() for value in ids}
        self._is_small = NO_BYTE not in named
        self.ignore = tuple(
            value for value in dict.fromkeys((*model.ignore, NO_BYTE, int(_core.NO_ID))) if value not in named
        )
        self.settings = {
            "model": hash_model(model.network.path),
            "size": model.size,
            "fit": model.fit,
            "color": model.color,
            "numbers": (model.scale, model.mean, model.std),
            "outputs": model.outputs,
            "kind": model.kind,
            "align_corners": model.align_corners,
            "rectified": labeller.camera.model_dump(mode="json") if is_rectified else None,
            "probabilities": has_probabilities,
        }

    def label(self, drive: Drive, frame: Frame) -> bytes:
        """Label the picture of a frame; see `Side.label`."""
        if frame.image is None:
            raise InputError(f"{drive.path}: {frame.key('image')}: found nothing, needed a picture")
        camera = drive.camera
        picture = read_image(drive.resolve(frame.image), (camera.width, camera.height))
        with about(drive.resolve(frame.image)):
            if self.has_probabilities:
                return _archive(self.labeller.shares(picture))
            ids = self.labeller.ids(picture)
        seen = ids[ids != _core.NO_ID]
        if self._is_small and (not seen.size or seen.max() < NO_BYTE):
            ids = np.where(ids == _core.NO_ID, NO_BYTE, ids).astype(np.uint8)
        return bytes(cv2.imencode(".png", ids)[1].tobytes())

    def is_whole(self, drive: Drive, path: Path) -> bool:
        """Whether a label image is there and whole."""
        width, height = drive.camera.width, drive.camera.height
        try:
            if self.has_probabilities:
                _core.read_class_shares([path], (height, width))
            else:
                _core.read_label_images([path], width, height)
        except InputError:
            return False
        return True


class _PointSide(Side):
    key = "point_labels"
    source = "points"
    suffix = ".label"

    no_return: int
    """Id of the entries of a file that are no points."""

    def label(self, drive: Drive, frame: Frame) -> bytes:
        """Label the points of a frame; see `Side.label`."""
        alone = drive.model_copy(update={"frames": (frame.model_copy(update={"point_labels": None}),)})
        (cloud,) = read_clouds(alone)
        labels = np.full(len(cloud.is_return), self.no_return, "<u4")
        with about(drive.resolve(frame.points)):
            labels[cloud.is_return] = self.label_points(cloud)
        return labels.tobytes()

    @abstractmethod
    def label_points(self, cloud: _core.PointCloud) -> npt.NDArray[Any]:
        """Label the points of a sweep: (N,), in SemanticKITTI's layout."""

    def is_whole(self, drive: Drive, path: Path) -> bool:
        """Whether a file of labels is there and whole: it is written as a whole or not at all."""
        try:
            size = path.stat().st_size
        except OSError:
            return False
        return size > 0 and size % 4 == 0


class SweepSide(_PointSide):
    """Labels of points from a network."""

    no_return = int(_core.NO_ID)

    def __init__(self, labeller: SweepLabeller) -> None:
        model = labeller.model
        self.labeller = labeller
        self.classes = model.classes
        self.ignore = tuple(dict.fromkeys((*model.ignore, int(_core.NO_ID))))
        card = model.card.model_dump(mode="json", exclude={"classes", "ignore"})
        self.settings = {"model": hash_model(model.network.path), "card": card}

    def label_points(self, cloud: _core.PointCloud) -> npt.NDArray[Any]:
        """Label the points of a sweep: (N,) ids."""
        return self.labeller.ids(cloud)


class SegmentSide(_PointSide):
    """Geometric segments as labels of points."""

    no_return = 0

    def __init__(self) -> None:
        self.classes = {name: (value,) for name, value in KIND_IDS.items()}
        self.ignore = (0,)
        self.settings = {"segments": 1}

    def label_points(self, cloud: _core.PointCloud) -> npt.NDArray[Any]:
        """Label the points of a sweep: (N,) kinds and segments."""
        return segment_labels(cloud.points)


def hash_model(path: Path) -> dict[str, str]:
    """Compute the SHA-256 of a model, and of the files beside it that its bytes name: those of its weights.

    Raises:
        InputError: a file cannot be read.
    """
    content = path.read_bytes()
    beside = sorted(other for other in path.parent.iterdir() if other.name != path.name and other.is_file())
    weights = {other.name: hash_file(other) for other in beside if other.name.encode() in content}
    return {"model": hashlib.sha256(content).hexdigest(), **weights}


def _archive(shares: npt.NDArray[np.uint8]) -> bytes:
    """Write probabilities (H, W, C) to an `.npz`, which a calibration reads."""
    array, archive = io.BytesIO(), io.BytesIO()
    np.lib.format.write_array(array, shares, allow_pickle=False)
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED, compresslevel=FASTEST) as file:
        # A fixed date, so that the same labels are the same bytes.
        file.writestr(
            zipfile.ZipInfo("probabilities.npy", (1980, 1, 1, 0, 0, 0)),
            array.getvalue(),
            zipfile.ZIP_DEFLATED,
        )
    return archive.getvalue()
