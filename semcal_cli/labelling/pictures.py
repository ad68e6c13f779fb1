"""Labels of a camera's pictures from a network."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.drive.document import Camera
from semcal_cli.errors import InputError, about
from semcal_cli.labelling.picture_model import PictureModel, joined_masks
from semcal_cli.labelling.views import Picture, make_views

MAX_SHARES = 255
"""Most classes of a file of probabilities."""
SAME_SHAPE = 0.1
"""Largest difference between the strides of an output along rows and along columns, as a share of the larger one."""
SUM_TOLERANCE = 1e-2
"""Largest difference from 1 of the sum of probabilities, which may be of 16 bits."""
GRAY = np.array([0.114, 0.587, 0.299])
"""Weights of blue, green and red in grey: ITU-R BT.601."""

Scores = list[npt.NDArray[np.float32]]


class PictureLabeller:
    """Labels pictures of one camera; several threads may use it at a time."""

    def __init__(self, model: PictureModel, camera: Camera, *, is_rectified: bool = False) -> None:
        """Plan the views of the camera's pictures.

        Raises:
            InputError: the pictures cannot be brought to the network's size.
        """
        self.model = model
        self.camera = camera
        size = model.size_for(camera.width, camera.height)
        mean = [int(np.clip(round(each / model.scale), 0, 255)) for each in model.mean]
        self._padding = tuple(mean if model.color == "bgr" else reversed(mean)) * (3 // len(mean))
        with about(model.stated_in):
            self.views = make_views(camera, size, model.fit, self._padding, is_rectified=is_rectified)
        levels = np.arange(256) * model.scale
        rows = [(levels - mean) / std for mean, std in zip(model.mean, model.std, strict=True)]
        self._table = np.asarray(rows).astype(model.dtype)
        self._places: dict[tuple[int, int], npt.NDArray[np.float32]] = {}

    def ids(self, picture: Picture) -> npt.NDArray[np.uint16]:
        """Label a picture.

        Args:
            picture: (H, W, 3) of the camera.

        Returns:
            (H, W) ids; `_core.NO_ID` where the network does not see.

        Raises:
            InputError: the network fails, or its output cannot be labels.
        """
        outputs = [self._run(draw(picture)) for draw in self.views.draws]
        if self.model.kind == "ids":
            found = self._picked([self._ids(output) for output in outputs])
        else:
            scores, are_first = self._scores(outputs)
            places = self._places_on(scores[0], are_first)
            found = self._core(_core.classes_of_scores, scores, self.views.views, places, are_first)
        return np.asarray(found, np.uint16).reshape(self.camera.height, self.camera.width)

    def shares(self, picture: Picture) -> npt.NDArray[np.uint8]:
        """Label a picture with the share of each class, in 1/255, as a calibration reads them.

        Returns:
            (H, W, C); zeros where the network does not see.

        Raises:
            InputError: as `ids`, or the network gives ids, or more classes than a file of probabilities may have.
        """
        path = self.model.network.path
        if self.model.kind == "ids":
            raise InputError(f"--probabilities: found ids from {path}, needed logits or probabilities")
        scores, are_first = self._scores([self._run(draw(picture)) for draw in self.views.draws])
        num_classes = scores[0].shape[0 if are_first else 2]
        if num_classes > MAX_SHARES:
            raise InputError(
                f"--probabilities: found {num_classes} classes of {path}, needed at most {MAX_SHARES}"
            )
        are_logits = self.model.kind == "logits" or (
            self.model.kind is None and not _are_probabilities(scores, are_first)
        )
        places = self._places_on(scores[0], are_first)
        found = self._core(_core.shares_of_scores, scores, self.views.views, places, are_first, are_logits)
        return np.asarray(found, np.uint8).reshape(self.camera.height, self.camera.width, num_classes)

    def tensor(self, view: Picture) -> npt.NDArray[Any]:
        """Bring a view (h, w, 3) to the network's input, a batch of one."""
        if self.model.color == "gray":
            planes = [(view @ GRAY).round().astype(np.uint8)]
        else:
            order = (0, 1, 2) if self.model.color == "bgr" else (2, 1, 0)
            planes = [view[..., channel] for channel in order]
        axis = 2 if self.model.channels_last else 0
        return np.stack([table[plane] for table, plane in zip(self._table, planes, strict=True)], axis)[None]

    def _run(self, view: Picture) -> npt.NDArray[Any]:
        outputs = self.model.network.run(self.tensor(view), self.model.outputs)
        if self.model.kind == "masks":
            classes, masks = (outputs[name] for name in self.model.outputs)
            if classes.ndim != 3 or masks.ndim != 4 or classes.shape[1] != masks.shape[1]:
                raise self._unfit(f"classes of {classes.shape} and masks of {masks.shape}", "as many of both")
            return joined_masks(outputs)
        return outputs[self.model.outputs[0]]

    def _scores(self, outputs: Sequence[npt.NDArray[Any]]) -> tuple[Scores, bool]:
        """Arrange outputs as scores of classes, and tell whether the classes are the first axis."""
        shapes = {output.shape for output in outputs}
        shape = next(iter(shapes))
        if len(shapes) > 1 or len(shape) != 4 or shape[0] != 1:
            raise self._unfit(f"output of {' and '.join(map(str, shapes))}", "1 x classes x rows x columns")
        if not np.issubdtype(outputs[0].dtype, np.floating):
            raise self._unfit(f"output of {outputs[0].dtype}", "float")
        are_first = self._are_classes_first(shape[1:])
        self.model.check_num_classes(shape[1 if are_first else 3])
        return [np.ascontiguousarray(output[0], np.float32) for output in outputs], are_first

    def _are_classes_first(self, shape: tuple[int, int, int]) -> bool:
        """Tell by the strides of rows and columns, which agree, where the classes stand."""
        columns, rows = self.views.size

        def covers(found_rows: int, found_columns: int) -> bool:
            down, across = found_rows / rows, found_columns / columns
            return abs(down - across) <= SAME_SHAPE * max(down, across)

        first, last = covers(shape[1], shape[2]), covers(shape[0], shape[1])
        if not first and not last:
            raise self._unfit(
                f"output of 1 x {' x '.join(map(str, shape))} for {rows} x {columns} pixels",
                "rows and columns of one stride",
            )
        return first and not (last and self.model.channels_last)

    def _ids(self, output: npt.NDArray[Any]) -> npt.NDArray[np.uint16]:
        """Arrange an output as ids (h, w)."""
        axes = [size for size in output.shape if size != 1]
        if len(axes) != 2:
            raise self._unfit(f"ids of {output.shape}", "rows x columns")
        low, high = output.min(), output.max()
        if low < 0 or high >= _core.NO_ID:
            raise self._unfit(f"ids from {low} to {high}", f"0 to {_core.NO_ID - 1}")
        return np.asarray(output.reshape(axes), np.uint16)

    def _picked(self, ids: Sequence[npt.NDArray[np.uint16]]) -> npt.NDArray[np.uint16]:
        """Pick the id of the cell of each pixel."""
        rows, columns = ids[0].shape
        places = self.views.places_on(columns, rows, align_corners=self.model.align_corners)
        cells = np.clip(np.floor(places + 0.5), 0, [columns - 1, rows - 1]).astype(np.intp)
        seen = self.views.views != _core.NO_VIEW
        found = np.full(len(seen), _core.NO_ID, np.uint16)
        found[seen] = np.stack(ids)[self.views.views[seen], cells[seen, 1], cells[seen, 0]]
        return found

    def _places_on(self, scores: npt.NDArray[np.float32], are_first: bool) -> npt.NDArray[np.float32]:
        """Places of the pixels among scores, kept for the next pictures."""
        rows, columns = scores.shape[1:] if are_first else scores.shape[:2]
        if (columns, rows) not in self._places:
            found = self.views.places_on(columns, rows, align_corners=self.model.align_corners)
            self._places[columns, rows] = found
        return self._places[columns, rows]

    def _core(self, function: Any, *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except InputError as error:
            raise InputError(f"{self.model.network.path}: {error}") from None

    def _unfit(self, found: str, needed: str) -> InputError:
        return InputError(f"{self.model.network.path}: found {found}, needed {needed}")


def _are_probabilities(scores: Scores, are_first: bool) -> bool:
    """Tell whether scores are probabilities: from 0 to 1, and of sum 1 in each cell."""
    axis = 0 if are_first else 2
    return all(
        each.min() >= 0.0
        and each.max() <= 1.0 + SUM_TOLERANCE
        and np.abs(each.sum(axis) - 1.0).max() <= SUM_TOLERANCE
        for each in scores
    )
