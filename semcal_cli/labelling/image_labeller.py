"""Image labels from a network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache, partial
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.drive.camera import Camera
from semcal_cli.errors import InputError, name_in_errors
from semcal_cli.geometry.arrays import Image
from semcal_cli.labelling.card import CloudCard, CompleteImageCard, PointCard
from semcal_cli.labelling.model import MASKS, Model, card_of, cloud_model, image_model, point_model, wrong_key
from semcal_cli.labelling.onnx_network import Network
from semcal_cli.labelling.views import Fitting, make_views

TRIAL_SIZE = (640, 480)
"""Columns and rows of the test image for a network that takes any size."""
MIDDLE_GRAY = 128

MAX_SHARES = 255
"""Largest number of classes in a file of probabilities."""
SAME_SHAPE = 0.1
"""Largest relative difference between the strides of an output along rows and columns."""
SUM_TOLERANCE = 1e-2
"""Largest deviation from 1 of the sum of probabilities, which may be 16-bit floats."""
GRAY = np.array([0.114, 0.587, 0.299])
"""Weights of blue, green and red in grey: ITU-R BT.601."""

Scores: TypeAlias = list[npt.NDArray[np.float32]]
"""Class scores of each view, (C, h, w) or (h, w, C)."""
ScoreSamples: TypeAlias = tuple[Scores, npt.NDArray[np.uint8], npt.NDArray[np.float32], bool]
"""Scores, the index and the position of each pixel in them, and whether classes are the first axis."""


class ImageLabeller:
    """Labels images of one camera. Threads may share it."""

    def __init__(
        self, model: Model[CompleteImageCard], camera: Camera, *, is_rectified: bool = False
    ) -> None:
        """Plan the views of the camera's images.

        Raises:
            InputError: the images cannot be brought to the network's size.
        """
        self.model, self.camera, self.is_rectified = model, camera, is_rectified
        card = model.card
        size = card.size_for(camera.width, camera.height)
        mean = [int(np.clip(round(value / card.scale), 0, 255)) for value in card.mean]
        padding = tuple(mean if card.color == "bgr" else reversed(mean)) * (3 // len(mean))
        if card.place == "corner":
            padding = (0, 0, 0)
        fitting = Fitting(size, card.fit, padding, card.overlap, card.place, card.resample, card.scaled_size)
        with name_in_errors(model.card_path):
            self.views = make_views(camera, fitting, is_rectified=is_rectified)
        levels = np.arange(256) * card.scale
        rows = [(levels - mean) / std for mean, std in zip(card.mean, card.std, strict=True)]
        self._table = np.asarray(rows).astype(model.network.input.dtype)
        self._constants = {name: np.array([values]) for name, values in card.constants.items()}
        self._positions_on = cache(partial(self.views.positions_on, align_corners=card.align_corners))

    def ids(self, image: Image) -> npt.NDArray[np.uint16]:
        """Label an image.

        Args:
            image: (H, W, 3) of the camera.

        Returns:
            (H, W) ids; `core.NO_ID` where no view shows the pixel.

        Raises:
            InputError: the network fails, or its output is not labels.
        """
        outputs = self._run(image)
        if self.model.card.kind == "ids":
            labels = self._ids_of_pixels(outputs)
        else:
            samples = self._scores(outputs)
            with name_in_errors(self.model.network.path):
                labels = core.classes_of_scores(*samples)
        return np.asarray(labels, np.uint16).reshape(self.camera.height, self.camera.width)

    def shares(self, image: Image) -> npt.NDArray[np.uint8]:
        """Label an image with class probabilities, in 1/255, as a calibration reads them.

        Returns:
            (H, W, C); zeros where no view shows the pixel.

        Raises:
            InputError: as for `ids`, or the network gives ids or too many classes for a file of probabilities.
        """
        path, kind = self.model.network.path, self.model.card.kind
        if kind == "ids":
            raise InputError(f"--probabilities: found ids from {path}, expected logits or probabilities")
        scores, views, positions, are_classes_first = self._scores(self._run(image))
        num_classes = scores[0].shape[0 if are_classes_first else 2]
        if num_classes > MAX_SHARES:
            raise InputError(
                f"--probabilities: found {num_classes} classes of {path}, needed at most {MAX_SHARES}"
            )
        # Probabilities are between 0 and 1, and add up to 1 in each cell.
        are_logits = kind == "logits" or (
            kind is None
            and any(
                view_scores.min() < 0.0
                or view_scores.max() > 1.0 + SUM_TOLERANCE
                or not np.abs(view_scores.sum(0 if are_classes_first else 2) - 1.0).max() <= SUM_TOLERANCE
                for view_scores in scores
            )
        )
        with name_in_errors(path):
            shares = core.shares_of_scores(scores, views, positions, are_classes_first, are_logits)
        return np.asarray(shares, np.uint8).reshape(self.camera.height, self.camera.width, num_classes)

    def tensor(self, view: Image) -> npt.NDArray[Any]:
        """Convert a view (h, w, 3) to the network's input, a batch of one."""
        card = self.model.card
        if card.color == "gray":
            planes = [(view @ GRAY).round().astype(np.uint8)]
        else:
            order = (0, 1, 2) if card.color == "bgr" else (2, 1, 0)
            planes = [view[..., channel] for channel in order]
        axis = 2 if card.layout == "channels_last" else 0
        return np.stack([table[plane] for table, plane in zip(self._table, planes, strict=True)], axis)[None]

    def _run(self, image: Image) -> list[npt.NDArray[Any]]:
        """Run the network on each view of an image."""
        network, names = self.model.network, self.model.outputs
        outputs = [
            network.run({network.input.name: self.tensor(draw(image)), **self._constants}, names)
            for draw in self.views.draws
        ]
        if self.model.card.kind != "masks":
            return [output[names[0]] for output in outputs]
        for output in outputs:
            classes, masks = (output[name] for name in names)
            if classes.ndim != 3 or masks.ndim != 4 or classes.shape[1] != masks.shape[1]:
                shapes = f"classes of {classes.shape} and masks of {masks.shape}"
                raise network.unfit(shapes, "the same number of queries in both")
        return [combine_masks(output, self.model.card.mask_size) for output in outputs]

    def _scores(self, outputs: Sequence[npt.NDArray[Any]]) -> ScoreSamples:
        """Arrange outputs as class scores, and find the position of each pixel in them."""
        network, shapes = self.model.network, {output.shape for output in outputs}
        shape = next(iter(shapes))
        if len(shapes) > 1 or len(shape) != 4 or shape[0] != 1:
            raise network.unfit(f"output of {' and '.join(map(str, shapes))}", "1 x classes x rows x columns")
        if self.model.card.kind != "logits" and not np.issubdtype(outputs[0].dtype, np.floating):
            raise network.unfit(f"output of {outputs[0].dtype}", "float")
        are_classes_first = self._are_classes_first(shape[1:])
        num_classes, rows, columns = shape[1:] if are_classes_first else (shape[3], *shape[1:3])
        if num_classes < 2:
            raise network.unfit(f"scores of {num_classes} class", "two or more")
        class_names = self.model.card.classes
        if isinstance(class_names, tuple) and len(class_names) != num_classes:
            needed = f"{num_classes}, one for each score of {network.path}"
            raise wrong_key(self.model.card_path, "classes", f"{len(class_names)} names", needed)
        max_id = max((value for ids in self.model.classes.values() for value in ids), default=0)
        if max_id >= num_classes:
            needed = f"at most {num_classes - 1}, the last score of {network.path}"
            raise wrong_key(self.model.card_path, "classes", f"id {max_id}", needed)
        scores = [np.ascontiguousarray(output[0], np.float32) for output in outputs]
        mosaic = self.views.mosaic
        if mosaic is None or (columns, rows) != self.views.size:
            # Coarse cells of different tiles do not coincide, so each pixel reads one tile.
            return scores, self.views.views, self._positions_on(columns, rows), are_classes_first
        planes = scores if are_classes_first else [np.moveaxis(view_scores, 2, 0) for view_scores in scores]
        return mosaic.merge_scores(planes), mosaic.images, mosaic.positions, True

    def _are_classes_first(self, shape: tuple[int, int, int]) -> bool:
        """Find the axis of the classes: rows and columns have the same stride."""
        if self.model.card.kind == "masks":
            return True
        columns, rows = self.views.size

        def is_same_stride(num_rows: int, num_columns: int) -> bool:
            down, across = num_rows / rows, num_columns / columns
            return abs(down - across) <= SAME_SHAPE * max(down, across)

        first, last = is_same_stride(shape[1], shape[2]), is_same_stride(shape[0], shape[1])
        if not first and not last:
            output = f"output of 1 x {' x '.join(map(str, shape))} for {rows} x {columns} pixels"
            raise self.model.network.unfit(output, "the same stride for rows and columns")
        return first and not (last and self.model.card.layout == "channels_last")

    def _ids_of_pixels(self, outputs: Sequence[npt.NDArray[Any]]) -> npt.NDArray[np.uint16]:
        """Look up the id of each pixel in the nearest cell."""
        network, ids = self.model.network, []
        for output in outputs:
            axes = [size for size in output.shape if size != 1]
            if len(axes) != 2:
                raise network.unfit(f"ids of {output.shape}", "rows x columns")
            ids.append(network.as_ids(output).reshape(axes))
        rows, columns = ids[0].shape
        positions = self._positions_on(columns, rows)
        cells = np.clip(np.floor(positions + 0.5), 0, [columns - 1, rows - 1]).astype(np.intp)
        is_shown = self.views.views != core.NO_VIEW
        labels = np.full(len(is_shown), core.NO_ID, np.uint16)
        labels[is_shown] = np.stack(ids)[self.views.views[is_shown], cells[is_shown, 1], cells[is_shown, 0]]
        return labels


def combine_masks(
    outputs: Mapping[str, npt.NDArray[Any]], size: Sequence[int] | None = None
) -> npt.NDArray[np.float32]:
    """Combine the classes and masks of queries into probabilities (1, C, h, w): Cheng et al., Mask2Former, 2022.

    Args:
        outputs: Logits of the classes (1, Q, C + 1), the last of which means "none", and of the masks (1, Q, h, w).
        size: Columns and rows to which the masks are scaled first; None for their own.
    """
    import cv2

    classes, masks = (np.asarray(outputs[name], np.float32)[0] for name in MASKS)
    if size is not None:
        masks = np.stack([cv2.resize(mask, tuple(size), interpolation=cv2.INTER_LINEAR) for mask in masks])
    probabilities = np.exp(classes - classes.max(1, keepdims=True))
    probabilities /= probabilities.sum(1, keepdims=True)
    inside = 1.0 / (1.0 + np.exp(-masks))
    return np.asarray(np.einsum("qc,qhw->chw", probabilities[:, :-1], inside)[None], np.float32)


def describe_model(network: Network, card: str | None) -> list[tuple[str, str]]:
    """Describe how a network is understood, as pairs of a label and a text, and try it if it takes images.

    Arguments and errors are those of `image_model`.
    """
    stated_card, _ = card_of(network, card)
    if isinstance(stated_card, CloudCard):
        return cloud_model(network, card).describe()
    if isinstance(stated_card, PointCard):
        return point_model(network, card).describe()
    model = image_model(network, card)
    width, height = TRIAL_SIZE if model.card.size is None else model.card.size
    K = ((float(width), 0.0, width / 2.0), (0.0, float(width), height / 2.0), (0.0, 0.0, 1.0))
    camera = Camera(model="plumb_bob", width=width, height=height, K=K)
    ids = ImageLabeller(model, camera).ids(np.full((height, width, 3), MIDDLE_GRAY, np.uint8))
    shown_ids = ", ".join(map(str, np.unique(ids)[:8]))
    return [*model.describe(), ("tried", f"a grey image of {width} x {height} gets ids {shown_ids}")]
