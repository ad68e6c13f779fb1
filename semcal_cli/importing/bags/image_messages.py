"""Images of recordings as files: raw pixels and Bayer mosaics become PNG; other JPEG and PNG stay as they are."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias

import cv2
import numpy as np

from semcal_cli.config import MAX_PIXELS
from semcal_cli.errors import InputError, counted
from semcal_cli.files.image_files import Size, decode_image, read_image, size_in_header
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
Bayer: TypeAlias = Literal["rggb", "bggr", "gbrg", "grbg"]
"""Colours of the first two pixels of the first two rows of a mosaic."""
# OpenCV's names with four letters are ROS's names; those with two name another corner of the pattern.
_BAYER: dict[Bayer, int] = {
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
MOSAIC_RATIO = 1.2
"""Ratio of the differences of pixels that touch to those two apart, above which an image is a mosaic. Grey copies of
the images of 11 public data sets have 0.56 to 0.75, and noise 1. Their mosaics have 2.9 to 8.8 if red and blue are half
as strong as green, as sensors deliver them, and 0.9 to 7.7 if not."""
MIN_MOSAIC_PX = 8
"""Smallest side of an image that may be judged to be a mosaic."""


class ImageFile(NamedTuple):
    """An image as a file."""

    content: bytes
    """Bytes of the file."""
    suffix: str
    """`.png` or `.jpg`."""
    size: Size
    """Columns and rows."""


def image_file(message: Message, bayer: Bayer | None = None) -> ImageFile:
    """Make the file of an image: PNG from an Image, or the unchanged bytes of a CompressedImage.

    Mosaics become PNG in colours, also those that are compressed.

    Args:
        message: An Image or a CompressedImage.
        bayer: Pattern of the mosaics, which takes precedence over that of the message.

    Raises:
        MessageError: the message is damaged, its encoding is not supported, or it has colours beside `bayer`.
    """
    if message.is_a(COMPRESSED):
        file, conversion = _compressed(message), _named_mosaic(message, bayer)
        grey = None if conversion is None else _grey_pixels(file)
        if grey is None and bayer is not None:
            raise _color_error(bayer)
        if conversion is None or grey is None:
            return file  # no mosaic, or one of which image_transport has made colours
        pixels = _converted(grey, conversion)
    else:
        pixels = _pixels(message, bayer)
    _, content = cv2.imencode(".png", pixels, PNG_SPEED)
    return ImageFile(content.tobytes(), ".png", (pixels.shape[1], pixels.shape[0]))


def looks_like_mosaic(path: Path) -> bool:
    """Return whether an image seems to be a mosaic that was not demosaiced.

    In a mosaic, neighbouring pixels, which have other colours, differ more than those of the same colour beside them.

    Raises:
        InputError: the image cannot be read.
    """
    image = read_image(path).astype(np.float32)
    if (image != image[..., :1]).any() or min(image.shape[:2]) < MIN_MOSAIC_PX:
        return False
    grey = image[..., 0]
    for pixels in (grey, grey.T):
        near, same_color = (float(np.abs(pixels[:, n:] - pixels[:, :-n]).mean()) for n in (1, 2))
        if near <= MOSAIC_RATIO * same_color:
            return False
    return True


def _named_mosaic(message: Message, bayer: Bayer | None) -> int | None:
    """Find the conversion of a compressed mosaic, whose format starts with `bayer_rggb8` or another encoding."""
    if bayer is not None:
        return _BAYER[bayer]
    encoding = str(message.content.format).split(";")[0].strip()
    return ENCODINGS[encoding].conversion if encoding.startswith("bayer_") and encoding in ENCODINGS else None


def _grey_pixels(file: ImageFile) -> RawPixels | None:
    """Decode a grey image (H, W), which may be stored in three equal channels; None if it has colours."""
    flags = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
    pixels = _decode_file(file.content, flags)
    if pixels.ndim == 2:
        return pixels
    blue, green, red = cv2.split(pixels)[:3]
    is_grey = np.array_equal(blue, green) and np.array_equal(green, red)
    return blue if is_grey else None  # type: ignore[return-value]


def _converted(pixels: RawPixels, conversion: int) -> RawPixels:
    try:
        converted: Any = cv2.cvtColor(pixels, conversion)
    except cv2.error:
        raise MessageError("found a damaged image") from None
    return np.asarray(converted)


def _color_error(bayer: Bayer) -> MessageError:
    return MessageError(
        f"found a colour image, expected a grey one: --bayer {bayer} states that it is a mosaic"
    )


def thumbnail(message: Message) -> Values:
    """Make a small grey image (h * w,), from 0 to 1, to compare scenes by.

    Raises:
        MessageError: as `image_file`, or the image cannot be decoded.
    """
    if message.is_a(COMPRESSED):
        grey = _decode_file(_compressed(message).content, cv2.IMREAD_REDUCED_GRAYSCALE_8)
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
    is_jpeg = content.startswith(b"\xff\xd8\xff")
    suffix = ".jpg" if is_jpeg else ".png" if content.startswith(b"\x89PNG") else None
    if suffix is None or kind == "compressedDepth":
        raise MessageError(
            f"found {counted(len(content), 'byte')} of format {kind!r}, expected a JPEG or a PNG"
        )
    try:
        size = size_in_header(Path("image"), BytesIO(content))
    except InputError:
        raise MessageError(
            f"found {counted(len(content), 'byte')} of a damaged {suffix[1:].upper()}"
        ) from None
    _check_size(*size)
    return ImageFile(content, suffix, size)


def _pixels(message: Message, bayer: Bayer | None = None) -> RawPixels:
    """Extract the pixels of an Image: (H, W) grey, or (H, W, 3) blue, green, red, also of mosaics."""
    image = message.content
    width, height, step = int(image.width), int(image.height), int(image.step)
    _check_size(width, height)
    encoding = ENCODINGS.get(image.encoding)
    if encoding is None:
        raise MessageError(f"found encoding {image.encoding[:40]!r}, expected one of: {', '.join(ENCODINGS)}")
    scalar = np.dtype((">" if image.is_bigendian else "<") + encoding.scalar)
    row = width * encoding.channels * scalar.itemsize
    if step < row:
        raise MessageError(f"found step {step:,}, needed {row:,} or more for {width:,} columns")
    if len(image.data) < (height - 1) * step + row:
        raise MessageError(
            f"found {counted(len(image.data), 'byte')} of pixels, needed {(height - 1) * step + row:,}"
        )
    if encoding.conversion in (_UYVY, _YUYV) and width % 2:
        raise MessageError(f"found {counted(width, 'column')} of {image.encoding}, expected an even number")
    shape = (height, width, encoding.channels)
    strides = (step, encoding.channels * scalar.itemsize, scalar.itemsize)
    stored = np.ndarray(shape, scalar, image.data.tobytes(), 0, strides)
    pixels = np.ascontiguousarray(stored, dtype=scalar.newbyteorder("="))
    if encoding.channels == 1:
        pixels = pixels[:, :, 0]
    if bayer is not None and pixels.ndim > 2:
        raise _color_error(bayer)
    conversion = encoding.conversion if bayer is None else _BAYER[bayer]
    return pixels if conversion is None else _converted(pixels, conversion)


def _check_size(width: int, height: int) -> None:
    if width * height == 0:
        raise MessageError(f"found an image of {width} x {height} pixels")
    if width * height > MAX_PIXELS:
        raise MessageError(f"found {width:,} x {height:,} pixels, needed at most {MAX_PIXELS:,}")


def _decode_file(content: bytes, flags: int) -> RawPixels:
    try:
        pixels: RawPixels | None = decode_image(Path("image"), content, flags)
    except InputError as error:
        raise MessageError(str(error)) from None
    if pixels is None:
        raise MessageError("found a damaged image")
    return pixels
