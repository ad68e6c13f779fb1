"""A mask proposed from the images: what keeps its place and its look while the rig moves, such as the car's own bonnet.

The car's own parts reach into the image from below or from a side. The sky, which changes little, comes from above, and
the vanishing point of a road is in the middle.

Of 12 to 15 images of four drives of KITTI and KITTI-360, nothing is proposed. Where a bonnet is painted on them, 97 to
100 % of it is found, and up to 0.7 % of the rest
(`tests/benchmarks/find_mask.py`, which the constants below were chosen with).
"""

from __future__ import annotations

import numpy as np

from semcal_cli.drive.document import Drive
from semcal_cli.errors import InputError, counted
from semcal_cli.geometry.arrays import Mask
from semcal_cli.observations.cues.intensity import grey_values
from semcal_cli.observations.frame_selection import evenly_spaced

MAX_IMAGES = 60
"""Largest number of images that are compared."""
MIN_IMAGES = 8
"""Smallest number of images: fewer show the same by chance."""
WIDTH = 640
"""Columns to which images are reduced."""
BLUR_PX, SURROUNDINGS_PX = 2.0, 6.0
"""Standard deviations of the blur of the reduced images, and of the window in which gradients are compared."""
NOISE = 0.15
"""Gradient, in grey values per pixel, that is added to that of the window: less is noise."""
MIN_COHERENCE = 0.55
"""Length of the mean gradient over the images, relative to the mean length, above which a window shows the same."""
MAX_SPREAD = 0.5
"""Standard deviation over the images, relative to the median of all pixels, below which a pixel hardly changes."""
MIN_CHANGE = 10.0
"""Smallest median of the standard deviations, in grey values, of a rig that moves: at rest it is 3 (a laboratory), in
a traffic jam 24."""
WHITE = 245.0
"""Mean grey value from which a pixel is overexposed: such a sky hides nothing."""
MIN_AREA = 0.01
"""Smallest area that is proposed, as a share of the image: pieces of road that looked alike in 13 images had 0.8 %."""
MARGIN = 1 / 100
"""Width by which areas are widened, as a share of the columns: cues look a few pixels around each pixel."""


def propose_mask(drive: Drive) -> Mask:
    """Find the pixels (H, W) that show the scene, without those that never change over the images of a drive.

    Raises:
        InputError: an image is missing or wrong, there are too few, or the rig hardly moves.
    """
    import cv2

    frames = evenly_spaced([frame for frame in drive.frames if frame.image is not None], MAX_IMAGES)
    if len(frames) < MIN_IMAGES:
        raise InputError(
            f"{drive.path}: found {counted(len(frames), 'image')}, needed {MIN_IMAGES} to find a mask"
        )
    step = max(drive.camera.width / WIDTH, 1.0)
    size = max(round(drive.camera.width / step), 1), max(round(drive.camera.height / step), 1)
    small = [
        cv2.resize(grey_values(drive, f).astype(np.float32), size, interpolation=cv2.INTER_AREA)
        for f in frames
    ]
    images = np.array([cv2.GaussianBlur(image, (0, 0), BLUR_PX) for image in small])
    spread = images.std(axis=0)
    if (change := float(np.median(spread))) < MIN_CHANGE:
        raise InputError(
            f"{drive.path}: half of the pixels change by {change:.1f} grey values or less over {len(frames)} images, "
            f"needed {MIN_CHANGE:.0f} to find a mask: give frames of a rig that moves"
        )
    gradients = np.array(
        [[cv2.Sobel(image, cv2.CV_32F, *axes) / 8 for axes in ((1, 0), (0, 1))] for image in images]
    )
    mean, lengths = np.hypot(*gradients.mean(axis=0)), np.hypot(gradients[:, 0], gradients[:, 1]).mean(axis=0)
    mean, lengths = (cv2.GaussianBlur(values, (0, 0), SURROUNDINGS_PX) for values in (mean, lengths))
    stays = (mean > MIN_COHERENCE * (lengths + NOISE)) & (spread < MAX_SPREAD * change)
    stays &= images.mean(axis=0) < WHITE
    kernel = np.ones([max(round(size[0] / 60), 3) | 1] * 2, np.uint8)
    areas = cv2.morphologyEx(stays.astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    areas = cv2.morphologyEx(areas, cv2.MORPH_OPEN, kernel)
    _, numbers, statistics, _ = cv2.connectedComponentsWithStats(areas)
    left, top, width, height, area = statistics.T
    is_own = (left == 0) | (left + width == size[0]) | (top + height == size[1])
    is_own &= area >= MIN_AREA * areas.size
    is_own[0] = False
    found = cv2.dilate(
        is_own[numbers].astype(np.uint8), np.ones([2 * round(MARGIN * size[0]) + 1] * 2, np.uint8)
    )
    return np.asarray(cv2.resize(found, drive.camera.size, interpolation=cv2.INTER_NEAREST) == 0)
