"""Images of recordings as files: raw pixels become PNG; JPEG and PNG stay as they are."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from semcal_cli.config import MAX_PIXELS
from semcal_cli.errors import InputError, counted
from semcal_cli.files.image_files import Size, size_in_header
from semcal_cli.geometry.arrays import RawPixels, Values
from semcal_cli.importing.bags.messages import COMPRESSED, Message, MessageError


class Encoding(NamedTuple):
    """The layout of the pixels of an Image (sensor_msgs/image_encodings.h)."""

    scalar: str
    """NumPy's name of the type of a number."""
    channels: int
    """Numbers per pixel."""
    conversion: int | None
    """OpenCV's conversion to grey, or to blue, green and red; None if none is needed."""


_SAME, _RGB, _RGBA, _BGRA = None, cv2.COLOR_RGB2BGR, cv2.COLOR_RGBA2BGR, cv2.COLOR_BGRA2BGR
# OpenCV's names with four letters are ROS's names; those with two name another corner of the pattern.
_BAYER = {
    "rggb": cv2.COLOR_BayerRGGB2BGR,
    "bggr": cv2.COLOR_BayerBGGR2BGR,
    "gbrg": cv2.COLOR_BayerGBRG2BGR,
    "grbg": cv2.COLOR_BayerGRBG2BGR,
}
_UYVY, _YUYV = cv2.COLOR_YUV2BGR_UYVY, cv2.COLOR_YUV2BGR_YUY2
ENCODINGS = {
    "mono8": Encoding("u1", 1, _SAME),
    "8UC1": Encoding("u1", 1, _SAME),
    "mono16": Encoding("u2", 1, _SAME),
    "bgr8": Encoding("u1", 3, _SAME),
    "8UC3": Encoding("u1", 3, _SAME),
    "rgb8": Encoding("u1", 3, _RGB),
    "bgra8": Encoding("u1", 4, _BGRA),
    "8UC4": Encoding("u1", 4, _BGRA),
    "rgba8": Encoding("u1", 4, _RGBA),
    "bgr16": Encoding("u2", 3, _SAME),
    "rgb16": Encoding("u2", 3, _RGB),
    **{f"bayer_{name}8": Encoding("u1", 1, conversion) for name, conversion in _BAYER.items()},
    **{f"bayer_{name}16": Encoding("u2", 1, conversion) for name, conversion in _BAYER.items()},
    "yuv422": Encoding("u1", 2, _UYVY),
    "uyvy": Encoding("u1", 2, _UYVY),
    "yuv422_yuy2": Encoding("u1", 2, _YUYV),
    "yuyv": Encoding("u1", 2, _YUYV),
}
"""Encodings that are read."""
THUMBNAIL = 32, 18
"""Columns and rows of the thumbnails by which images are compared."""
SAMPLED_ROWS = 180
"""Larger images are subsampled before their thumbnail is made, to no fewer rows and columns than this."""
PNG_SPEED = [cv2.IMWRITE_PNG_COMPRESSION, 1]
"""Little compression: files are a fifth larger but are written four times as fast."""


class ImageFile(NamedTuple):
    """An image as a file."""

    content: bytes
    """Bytes of the file."""
    suffix: str
    """`.png` or `.jpg`."""
    size: Size
    """Columns and rows."""


def image_file(message: Message) -> ImageFile:
    """Make the file of an image: PNG from an Image, or the unchanged bytes of a CompressedImage.

    Raises:
        MessageError: the message is damaged, or its encoding is not supported.
    """
    if message.is_a(COMPRESSED):
        return _compressed(message)
    pixels = _pixels(message)
    _, content = cv2.imencode(".png", pixels, PNG_SPEED)
    return ImageFile(content.tobytes(), ".png", (pixels.shape[1], pixels.shape[0]))


def thumbnail(message: Message) -> Values:
    """Make a small grey image (h * w,), from 0 to 1, to compare scenes by.

    Raises:
        MessageError: as `image_file`, or the image cannot be decoded.
    """
    if message.is_a(COMPRESSED):
        _compressed(message)
        content = np.frombuffer(message.content.data, dtype=np.uint8)
        grey = _decode(lambda: cv2.imdecode(content, cv2.IMREAD_REDUCED_GRAYSCALE_8))
    else:
        pixels = _pixels(message)
        coarse = pixels[:: max(len(pixels) // SAMPLED_ROWS, 1), :: max(pixels.shape[1] // SAMPLED_ROWS, 1)]
        grey = coarse if coarse.ndim == 2 else coarse.mean(axis=2)
    small = cv2.resize(grey.astype(np.float32), THUMBNAIL, interpolation=cv2.INTER_AREA)
    span = float(small.max()) or 1.0
    look: Values = (small / span).astype(np.float32).ravel()
    return look


def _compressed(message: Message) -> ImageFile:
    image = message.content
    content = bytes(image.data)
    kind = "compressedDepth" if "compressedDepth" in image.format else image.format[:40]
    suffix = {b"\x89PNG": ".png", b"\xff\xd8\xff\xe0": ".jpg"}.get(content[:4])
    suffix = suffix or (".jpg" if content.startswith(b"\xff\xd8\xff") else None)
    if suffix is None or kind == "compressedDepth":
        raise MessageError(
            f"found {counted(len(content), 'byte')} of format {kind!r}, needed a JPEG or a PNG"
        )
    try:
        size = size_in_header(Path("image"), BytesIO(content))
    except InputError:
        raise MessageError(
            f"found {counted(len(content), 'byte')} of a damaged {suffix[1:].upper()}"
        ) from None
    _check_size(*size)
    return ImageFile(content, suffix, size)


def _pixels(message: Message) -> RawPixels:
    """Extract the pixels of an Image: (H, W) grey, or (H, W, 3) blue, green, red."""
    image = message.content
    width, height, step = int(image.width), int(image.height), int(image.step)
    _check_size(width, height)
    encoding = ENCODINGS.get(image.encoding)
    if encoding is None:
        raise MessageError(f"found encoding {image.encoding[:40]!r}, needed one of: {', '.join(ENCODINGS)}")
    scalar = np.dtype((">" if image.is_bigendian else "<") + encoding.scalar)
    row = width * encoding.channels * scalar.itemsize
    if step < row:
        raise MessageError(f"found step {step:,}, needed {row:,} or more for {width:,} columns")
    if len(image.data) < (height - 1) * step + row:
        raise MessageError(
            f"found {counted(len(image.data), 'byte')} of pixels, needed {(height - 1) * step + row:,}"
        )
    if encoding.conversion in (_UYVY, _YUYV) and width % 2:
        raise MessageError(f"found {counted(width, 'column')} of {image.encoding}, needed an even number")
    shape = (height, width, encoding.channels)
    strides = (step, encoding.channels * scalar.itemsize, scalar.itemsize)
    stored = np.ndarray(shape, scalar, image.data.tobytes(), 0, strides)
    pixels = np.ascontiguousarray(stored, dtype=scalar.newbyteorder("="))
    if encoding.channels == 1:
        pixels = pixels[:, :, 0]
    conversion = encoding.conversion
    if conversion is None:
        return pixels
    converted: RawPixels = _decode(lambda: cv2.cvtColor(pixels, conversion))
    return converted


def _check_size(width: int, height: int) -> None:
    if width * height == 0:
        raise MessageError(f"found an image of {width} x {height} pixels")
    if width * height > MAX_PIXELS:
        raise MessageError(f"found {width:,} x {height:,} pixels, needed at most {MAX_PIXELS:,}")


def _decode(decode: Callable[[], Any]) -> Any:
    try:
        image = decode()
    except cv2.error:
        image = None
    if image is None:
        raise MessageError("found a damaged image")
    return image
