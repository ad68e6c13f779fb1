"""The frames of a drive: the files and times of a sweep and of the image taken with it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from semcal_cli.files.validation import FileName, StrictModel

FILES = ("points", "point_labels", "image_labels", "image", "mask", "point_features", "image_features")
"""Keys of a frame's files."""
Stamp = Annotated[float, Field(ge=-1e10, le=1e10)]
"""Time in seconds. The limits exclude nanoseconds since 1970."""


class Frame(StrictModel):
    """One sweep and the image taken with it. Paths are relative to the drive."""

    points: FileName
    """File of the point cloud."""
    point_labels: FileName | None = None
    """File of the ids or class probabilities of the points. If absent, the point cloud's own field of ids is used."""
    image_labels: FileName | None = None
    """File of the ids or class probabilities of the pixels."""
    image: FileName | None = None
    """File of the camera's image."""
    mask: FileName | None = None
    """File of the pixels of this image that do not show the scene, black there, in addition to `camera.mask`."""
    points_stamp: Stamp | None = None
    """Time of the sweep, in seconds."""
    image_stamp: Stamp | None = None
    """Time of the image, in seconds."""
    point_features: FileName | None = None
    """File of the features of the points, N x C."""
    image_features: FileName | None = None
    """File of the features of the pixels, H x W x C."""

    def key(self, name: str) -> str:
        """Name one of the frame's keys in an error, by the point cloud instead of the index."""
        return f"frames[{self.points}].{name}"
