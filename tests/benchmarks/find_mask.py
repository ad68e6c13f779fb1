"""Prints a Markdown table: how much of a painted bonnet `inspect --find-mask` finds, and what else it takes for one.

    python tests/benchmarks/find_mask.py ../shared/data [--only street]

The images of four drives are taken as they are, and with a bonnet that covers a tenth to a quarter
of their height. It is shaded, has the noise of a sensor, and its brightness varies by a tenth from image to image.
"""

from __future__ import annotations

import glob
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
import yaml
from benchmark import script, table

from semcal_cli.drive.document import read_drive
from semcal_cli.files.image_files import read_image, write_image
from semcal_cli.geometry.arrays import Image, Mask
from semcal_cli.observations.masks import outside_polygons
from semcal_cli.observations.proposed_mask import propose_mask

DRIVES = {
    "KITTI object": "kitti_object/image_2/*",
    "KITTI-360, one street": "kitti360_street/images/image_00/*",
    "KITTI raw, three drives": "kitti_raw_right/2011_09_26/*/image_03/data/*.png",
    "KITTI raw, a traffic jam": "kitti_raw_jam/2011_09_26/*/image_02/data/*.png",
}
"""Images of each drive."""
SEED = 0
GAIN, NOISE = 0.1, 3.0
"""Largest change of the bonnet's brightness, as a share, and the standard deviation of its noise, in grey values."""
SHARPEST_PX = 25.0
"""Radians of the bonnet's shading, in pixels."""


def bonnet_of(width: int, height: int) -> Mask:
    """Return where the bonnet is (H, W)."""
    corners = [(0, 0.9), (0.3, 0.76), (0.7, 0.76), (1, 0.9), (1, 1), (0, 1)]
    return ~outside_polygons((width, height), [[(u * width, v * height) for u, v in corners]])


def painted(image: Image, is_bonnet: Mask, rng: np.random.Generator) -> Image:
    """Paint the bonnet on an image (H, W, 3)."""
    v, u = np.indices(is_bonnet.shape)
    shade = 40.0 + 100.0 * v / len(is_bonnet) + 15.0 * np.sin(u / SHARPEST_PX)
    grey = shade * rng.uniform(1.0 - GAIN, 1.0 + GAIN) + rng.normal(0.0, NOISE, is_bonnet.shape)
    return np.where(is_bonnet[..., None], grey[..., None].clip(0, 255), image).astype(np.uint8)


def masked(images: Sequence[Image]) -> Mask:
    """Propose a mask (H, W) for a drive of images."""
    height, width = images[0].shape[:2]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for index, image in enumerate(images):
            write_image(image, folder / f"{index}.png")
        K = [[width, 0.0, width / 2], [0.0, width, height / 2], [0.0, 0.0, 1.0]]
        camera = {"model": "plumb_bob", "width": width, "height": height, "K": K}
        frames = [{"points": "none.bin", "image": f"{index}.png"} for index in range(len(images))]
        (folder / "drive.yaml").write_text(
            yaml.safe_dump({"semcal_drive": 1, "camera": camera, "frames": frames})
        )
        return ~propose_mask(read_drive(folder))


def row(name: str, pattern: Path) -> tuple[str, ...]:
    """Measure one drive."""
    images = [read_image(Path(file)) for file in sorted(glob.glob(str(pattern)))]  # noqa: PTH207
    height, width = (min(image.shape[axis] for image in images) for axis in (0, 1))
    images, rng = [image[:height, :width] for image in images], np.random.default_rng(SEED)
    is_bonnet = bonnet_of(width, height)
    found = masked([painted(image, is_bonnet, rng) for image in images])
    # Masks are widened on purpose.
    near = cv2.dilate(is_bonnet.astype(np.uint8), np.ones([2 * round(0.02 * width) + 1] * 2, np.uint8)) > 0
    return (
        name,
        str(len(images)),
        f"{masked(images).mean():.1%}",
        f"{found[is_bonnet].mean():.0%}",
        f"{found[~near].mean():.1%}",
    )


def main(data: Path, *, only: str = "") -> Iterator[str]:
    """Yield the table, of the drives whose names contain `only`."""
    header = "images | number | masked without a bonnet | of the bonnet masked | of the rest masked"
    yield from table(header, (row(name, data / pattern) for name, pattern in DRIVES.items() if only in name))


if __name__ == "__main__":
    script(main)
