"""The brightness of 16-bit images: which values are shown as black and as white, the same in all images of a drive.

Cameras count in 10, 12 or 14 bits, and write these into 16: the upper 8 bits alone are nearly black.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from threading import Lock

import numpy as np
import numpy.typing as npt

from semcal_cli.errors import InputError
from semcal_cli.files.image_files import Levels, has_16_bits, read_pixels

NUM_READ = 32
"""Number of images, evenly spaced, from which levels are found: about a second for images of 2 megapixels."""
DEPTHS = (8, 10, 12, 14, 16)
"""Bits of the converters of cameras (GenICam's pixel format naming convention, version 2.1: Mono8 to Mono16)."""
TAILS = 0.01
"""Share of the pixels that may be darker than black, and brighter than white, in thermal images."""
THERMAL = 0.5
"""Ratio of the darkest to the brightest values above which images are thermal. Radiometric cameras count from absolute
zero: 200 K, a clear sky, is half of 400 K, an engine. Images of light hold shadows and sky: over the images of eleven
public data sets, KITTI and nuScenes among them, the ratio is 0.005 to 0.32."""
_LOCK = Lock()


@dataclass(frozen=True)
class ImageLevels:
    """The levels of the 16-bit images of a drive, which are found when they are first needed."""

    paths: Sequence[Path] = ()
    """Images of the drive."""

    def get(self) -> Levels | None:
        """Return the levels of the 16-bit images; None if there are none. Images that cannot be read do not count."""
        with _LOCK:  # the threads of a pool wait for the first
            return self._levels

    @cached_property
    def _levels(self) -> Levels | None:
        chosen = np.linspace(0, len(self.paths) - 1, min(NUM_READ, len(self.paths))).round().astype(int)
        counts = np.zeros(1 << 16, np.int64)
        for path in (self.paths[index] for index in chosen):
            try:
                if has_16_bits(path):
                    counts += np.bincount(read_pixels(path).ravel(), minlength=len(counts))
            except InputError:
                continue
        return levels_of(counts) if counts.any() else None


def levels_of(counts: npt.NDArray[np.int64]) -> Levels:
    """Choose the levels of 16-bit images: all values of the camera's converter, or most of those of a thermal image.

    Args:
        counts: (65536,) number of pixels of each value.
    """
    bits = next(depth for depth in DEPTHS if not counts[1 << depth :].any())
    shares = np.cumsum(
        counts[1:]
    )  # zeros are pixels without a value, such as the border of a rectified image
    low, high = (int(np.searchsorted(shares, share * shares[-1])) + 1 for share in (TAILS, 1.0 - TAILS))
    return Levels(low, high) if THERMAL * high < low < high else Levels(0, (1 << bits) - 1)
