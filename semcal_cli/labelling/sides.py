"""The two sides of a frame that can be labelled, with the files that each writes."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frames import Frame
from semcal_cli.drive.networks import LabelNetwork
from semcal_cli.errors import InputError, name_in_errors
from semcal_cli.files.array_forms import ArrayCloud, SweepCloud
from semcal_cli.files.input_files import hash_file
from semcal_cli.labelling.card import ImageCard
from semcal_cli.labelling.cloud_labeller import CloudLabeller
from semcal_cli.labelling.hub import hub_name
from semcal_cli.labelling.image_labeller import ImageLabeller
from semcal_cli.labelling.model import Model
from semcal_cli.labelling.sweep_labeller import KIND_IDS, SweepLabeller, segment_labels
from semcal_cli.observations.reading import read_clouds, read_needed_image

NO_ID = int(core.NO_ID)
"""Id of pixels and points without a label."""
NO_BYTE = 255
"""The same in 8-bit label images."""
OPTIONAL_KEYS = ("constants", "mask_size", "multiple", "overlap", "resample")
"""Keys of a card on which labels depend, and which a record holds only if they are not the default."""
NamedIds: TypeAlias = Mapping[str, tuple[int, ...]]
"""Ids of each name; empty without names."""


@dataclass(frozen=True, eq=False)
class LabelSide:
    """Image labels or point labels, as files of a drive."""

    key: Literal["image_labels", "point_labels"]
    """Key of a frame's label file."""
    source: Literal["image", "points"]
    """Key of the file that is labelled."""
    suffix: str
    """Suffix of label files."""
    classes: NamedIds
    ignore: tuple[int, ...]
    """Ids that carry no information."""
    settings: Mapping[str, object]
    """Everything that the labels depend on besides the labelled file."""
    label: Callable[[Drive, Frame], bytes]
    """Computes the content of the label file of a frame. Raises InputError if the file to label is missing or wrong, or
    the network fails."""
    is_whole: Callable[[Drive, Path], bool]
    """Returns whether a label file exists and is complete."""
    origin: str | None = None
    """Name and commit of a network from the hub; None for other networks."""
    folder: str | None = None
    """Name of the folder for the label files; None for the key."""
    network: LabelNetwork | None = None
    """Network that makes the labels; None without one."""


def image_side(
    labeller: ImageLabeller,
    levels: tuple[int, int] | None = None,
    *,
    has_probabilities: bool = False,
) -> LabelSide:
    """Make the side of image labels, as ids or as class probabilities, from a network.

    Args:
        labeller: The network.
        levels: `Drive.image_levels`, on which labels depend.
        has_probabilities: Whether labels are class probabilities.

    Raises:
        InputError: the model cannot be read.
    """
    model, network = labeller.model, _network_record(labeller.model)
    labels = _ImageLabels(labeller, has_probabilities)
    ignored = dict.fromkeys((*model.ignore, NO_BYTE, NO_ID))
    return LabelSide(
        key="image_labels",
        source="image",
        suffix=".npz" if has_probabilities else ".png",
        classes=model.classes,
        ignore=tuple(value for value in ignored if value not in labels.class_ids),
        settings={"model": network.sha256, **labels.settings(levels)},
        label=labels.label,
        is_whole=labels.is_whole,
        origin=hub_name(model.network.path),
        network=network,
    )


@dataclass(frozen=True, eq=False)
class _ImageLabels:
    """Files of image labels from a network."""

    labeller: ImageLabeller
    has_probabilities: bool

    @cached_property
    def class_ids(self) -> frozenset[int]:
        return frozenset(value for ids in self.labeller.model.classes.values() for value in ids)

    def settings(self, levels: tuple[int, int] | None) -> dict[str, object]:
        """Collect everything that the labels depend on besides the image and the network's weights."""
        labeller, model, card = self.labeller, self.labeller.model, self.labeller.model.card
        camera = labeller.camera.model_dump(mode="json", exclude={"mask"}) if labeller.is_rectified else None
        return {
            "size": card.size,
            "fit": card.fit,
            **({} if card.short_side is None else {"sides": (card.short_side, card.long_side)}),
            "color": card.color,
            "numbers": (card.scale, card.mean, card.std),
            "outputs": model.outputs,
            "kind": card.kind,
            "align_corners": card.align_corners,
            **{
                key: getattr(card, key)
                for key in OPTIONAL_KEYS
                if getattr(card, key) != ImageCard.model_fields[key].default
            },
            "rectified": camera,
            "probabilities": self.has_probabilities,
            **({} if levels is None else {"levels": levels}),
        }

    def label(self, drive: Drive, frame: Frame) -> bytes:
        """Label the image of a frame, and make the content of its file."""
        path = drive.file_of(frame, "image", "an image")
        image = read_needed_image(drive, frame)
        with name_in_errors(path):
            if self.has_probabilities:
                return _probability_archive(self.labeller.shares(image))
            ids = self.labeller.ids(image)
        is_small = NO_BYTE not in self.class_ids and ids[ids != NO_ID].max(initial=0) < NO_BYTE
        if is_small:
            ids = np.where(ids == NO_ID, NO_BYTE, ids).astype(np.uint8)
        return bytes(cv2.imencode(".png", ids)[1].tobytes())

    def is_whole(self, drive: Drive, path: Path) -> bool:
        """Return whether a file of labels can be read, and is of the camera's size."""
        width, height = drive.camera.width, drive.camera.height
        try:
            if self.has_probabilities:
                core.read_class_shares([path], (height, width))
            else:
                core.read_label_images([path], width, height)
        except InputError:
            return False
        return True


def sweep_side(labeller: SweepLabeller | CloudLabeller) -> LabelSide:
    """Make the side of point labels from a network.

    Raises:
        InputError: the model cannot be read.
    """
    model, network = labeller.model, _network_record(labeller.model)
    settings = {
        "model": network.sha256,
        "card": model.card.model_dump(mode="json", exclude={"classes", "ignore", "licence"}),
    }
    ignore = tuple(dict.fromkeys((*model.ignore, NO_ID)))
    side = _point_side(model.classes, ignore, settings, labeller.ids, no_return=NO_ID)
    return replace(side, network=network)


def segment_side() -> LabelSide:
    """Make the side of geometric segments as point labels."""
    classes = {name: (value,) for name, value in KIND_IDS.items()}
    return _point_side(
        classes, (0,), {"segments": 1}, lambda cloud: segment_labels(cloud.points), no_return=0
    )


def _point_side(
    classes: NamedIds,
    ignore: tuple[int, ...],
    settings: Mapping[str, object],
    label_points: Callable[[SweepCloud], npt.NDArray[Any]],
    *,
    no_return: int,
) -> LabelSide:
    """Make a side of point labels.

    Args:
        classes: Ids of each name.
        ignore: Ids that carry no information.
        settings: Everything that the labels depend on besides the sweep.
        label_points: Computes labels (N,) in SemanticKITTI's layout for a sweep, as seen from where its rays start.
        no_return: Label of entries of a file that are not points.
    """

    def label(drive: Drive, frame: Frame) -> bytes:
        single_frame = drive.model_copy(update={"frames": (frame.model_copy(update={"point_labels": None}),)})
        (cloud,) = read_clouds(single_frame)
        labels = np.full(len(cloud.is_kept), no_return, "<u4")
        with name_in_errors(drive.resolve(frame.points)):
            rays = drive.rays(points := cloud.points)
            if rays is not points:
                cloud = ArrayCloud(rays, cloud.is_kept, cloud.intensity, cloud.time, None, None, cloud.ring)
            labels[cloud.is_kept] = label_points(cloud)
        return labels.tobytes()

    def is_whole(_: Drive, path: Path) -> bool:
        # The file is written completely or not at all.
        return path.exists() and path.stat().st_size > 0 and path.stat().st_size % 4 == 0

    return LabelSide("point_labels", "points", ".label", classes, ignore, settings, label, is_whole)


def _network_record(model: Model[Any]) -> LabelNetwork:
    """Describe a network as drives and results record it."""
    path = model.network.path
    return LabelNetwork(name=hub_name(path) or path.name, sha256=hash_model(path), licence=model.licence)


def hash_model(path: Path) -> dict[str, str]:
    """Compute the SHA-256 of a model and of its weight files: the files beside it whose names it contains.

    Raises:
        InputError: a file cannot be read.
    """
    content = path.read_bytes()
    beside = sorted(other for other in path.parent.iterdir() if other.name != path.name and other.is_file())
    weights = {other.name: hash_file(other) for other in beside if other.name.encode() in content}
    return {"model": hashlib.sha256(content).hexdigest(), **weights}


def _probability_archive(shares: npt.NDArray[np.uint8]) -> bytes:
    """Write probabilities (H, W, C) in 1/255 as the `.npz` that a calibration reads."""
    array, archive = io.BytesIO(), io.BytesIO()
    np.lib.format.write_array(array, shares, allow_pickle=False)
    # A fixed date makes the same labels the same bytes.
    member = zipfile.ZipInfo("probabilities.npy", (1980, 1, 1, 0, 0, 0))
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr(member, array.getvalue(), zipfile.ZIP_DEFLATED)
    return archive.getvalue()
