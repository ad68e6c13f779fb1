"""Label images as maps of class shares, sampled differentiably in the pixel.

A pyramid level holds the shares of each class in blocks of pixels, which is what one-hot label maps become when
they are averaged, as bytes; the finest level holds the ids themselves. So 70 frames of 1280 x 720 with 20 classes take
under half a gigabyte where float one-hot maps would take five a level.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from semcal_cli import _core


class ShareMaps:
    """The label images of all frames at one level of the pyramid."""

    def __init__(self, images: Sequence[npt.NDArray[np.uint8]], num_classes: int, factor: int) -> None:
        """Build a level.

        Args:
            images: (H, W) dense classes of each frame; 255 carries no information.
            num_classes: Classes are `0..num_classes`.
            factor: Side of a block in pixels.
        """
        self.num_classes = num_classes
        self.factor = factor
        if factor == 1:
            levels = [image[..., None] for image in images]
        else:
            levels = [_core.class_shares(image, num_classes, factor) for image in images]
        maps = torch.from_numpy(np.stack(levels))
        self.num_rows, self.num_columns = maps.shape[1:3]
        self._cells = maps.flatten(0, 2)

    def to(self, device: torch.device) -> ShareMaps:
        """Move the maps to a device."""
        self._cells = self._cells.to(device)
        return self

    def sample(self, frames: Tensor, pixels: Tensor) -> Tensor:
        """Interpolate the shares at pixels bilinearly; beyond the outermost block centres they are continued.

        Args:
            frames: (N,) int64, the frame of each pixel.
            pixels: (N, 2), (u, v) of the full-resolution picture.

        Returns:
            (N, num_classes) float32, differentiable in `pixels`.
        """
        column = ((pixels[:, 0] + 0.5) / self.factor - 0.5).clamp(0.0, self.num_columns - 1.0)
        row = ((pixels[:, 1] + 0.5) / self.factor - 0.5).clamp(0.0, self.num_rows - 1.0)
        column0 = column.detach().long().clamp(max=max(self.num_columns - 2, 0))
        row0 = row.detach().long().clamp(max=max(self.num_rows - 2, 0))
        right, down = (column - column0).float(), (row - row0).float()
        weights = torch.stack(
            [(1 - right) * (1 - down), right * (1 - down), (1 - right) * down, right * down], dim=1
        )
        corner = (frames * self.num_rows + row0) * self.num_columns + column0
        step_right = int(self.num_columns > 1)
        step_down = self.num_columns * int(self.num_rows > 1)
        corners = corner[:, None] + corner.new_tensor([0, step_right, step_down, step_down + step_right])
        return (weights[:, None, :] @ self._shares(corners)).squeeze(1)

    def _shares(self, cells: Tensor) -> Tensor:
        """(N, 4, num_classes) float32 of (N, 4) cells."""
        values = self._cells[cells]
        if self.factor > 1:
            return values.float() / 255.0
        classes = torch.arange(self.num_classes, dtype=torch.uint8, device=values.device)
        return (values == classes).float()
