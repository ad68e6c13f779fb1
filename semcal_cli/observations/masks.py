"""Masks: pixels that do not show the scene, such as the car's own bonnet or what the lens does not reach.

Cues make classes of the other pixels alone, so that every stage and every check does without them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np

from semcal_cli.config.file_limits import MAX_TABLE_BYTES
from semcal_cli.drive.camera import Camera, core_camera
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frames import Frame
from semcal_cli.errors import InputError
from semcal_cli.files.image_files import decode_image, read_image
from semcal_cli.files.input_files import read_bytes
from semcal_cli.geometry.arrays import Mask

LENS_STEP = 4
"""Step, in pixels, at which the reach of the lens is tested."""


def scene_masks(drive: Drive, frames: Sequence[Frame]) -> list[Mask | None]:
    """Read which pixels (H, W) of the images of frames show the scene; None where there is no mask.

    Raises:
        InputError: a mask is missing, has another size or only transparency, has a polygon outside the image, or
            leaves no pixel.
    """
    camera, size = drive.camera, drive.camera.size
    camera_mask: Mask | None = None
    if isinstance(camera.mask, str):
        camera_mask = _read(drive, camera.mask)
    elif camera.mask is not None:
        for index, corners in enumerate(camera.mask):
            if outside_polygons(size, [corners]).all():
                raise InputError(
                    f"{drive.path}: camera.mask[{index}]: found a polygon outside the image of {size[0]} x {size[1]}, "
                    "expected corners [u, v] in pixels around what is no scene"
                )
        camera_mask = outside_polygons(size, camera.mask)

    @cache
    def with_own(name: str) -> Mask:
        own = _read(drive, name)
        return own if camera_mask is None else camera_mask & own

    masks = [camera_mask if frame.mask is None else with_own(frame.mask) for frame in frames]
    for frame, mask in zip(frames, masks, strict=True):
        if mask is not None and not mask.any():
            key = "camera.mask" if frame.mask is None else frame.key("mask")
            raise InputError(
                f"{drive.path}: {key}: found no pixel that is left, expected some that show the scene"
            )
    return masks


def seen_pixels(drive: Drive, frames: Sequence[Frame]) -> list[Mask]:
    """Read which pixels (H, W) of the images of frames show the scene and are within the reach of the lens.

    Raises:
        InputError: a mask is missing or wrong, as for `scene_masks`.
    """
    lens = _lens_mask(drive.camera)
    return [lens if mask is None else lens & mask for mask in scene_masks(drive, frames)]


def outside_polygons(size: tuple[int, int], polygons: Sequence[Sequence[Sequence[float]]]) -> Mask:
    """Find the pixels (H, W) of an image, of `size` columns and rows, that are in none of the polygons."""
    import cv2

    inside = np.zeros(size[::-1], np.uint8)
    for corners in polygons:
        cv2.fillPoly(inside, [np.array(corners).round().astype(np.int32)], (1,))
    return np.asarray(inside == 0)


def _read(drive: Drive, name: str) -> Mask:
    """Read a mask (H, W), whose values may be 0 and 1, or 0 and 255 with the artefacts of a JPEG."""
    path = drive.resolve(name)
    values = read_image(path, drive.camera.size).max(axis=2)
    is_scene = np.asarray(values > values.max() / 2)
    if is_scene.min() == is_scene.max() and _has_transparency(path):
        raise InputError(
            f"{path}: found a mask that is only in the transparency of the image, expected black where the scene is "
            "not seen and white elsewhere"
        )
    return is_scene


def _has_transparency(path: Path) -> bool:
    """Return whether an image that was read is transparent in some places and not in others."""
    import cv2

    pixels = decode_image(path, read_bytes(path, limit=MAX_TABLE_BYTES), cv2.IMREAD_UNCHANGED)
    return pixels is not None and pixels.ndim == 3 and pixels.shape[2] == 4 and bool(np.ptp(pixels[..., 3]))


def _lens_mask(camera: Camera) -> Mask:
    """Find the pixels (H, W) that the lens reaches, from every `LENS_STEP`-th row and column."""
    v, u = np.mgrid[: camera.height : LENS_STEP, : camera.width : LENS_STEP]
    rays = core_camera(camera).unproject(np.column_stack([u.ravel(), v.ravel()]).astype(np.float64))
    reached = np.isfinite(rays).all(axis=1).reshape(u.shape)
    whole = reached.repeat(LENS_STEP, axis=0).repeat(LENS_STEP, axis=1)
    return np.asarray(whole[: camera.height, : camera.width])
