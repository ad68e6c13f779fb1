"""Label errors of experiments: network errors, dilated and shifted classes, disjoint ontologies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from semcal_cli.geometry.arrays import ClassIds
from semcal_cli.observations.observations import NO_CLASS, Observations
from semcal_cli.synthetic.label_noise import all_classes, with_wrong_points

BORDER_RMS_PX = 2.0
"""Distance of a network's borders from the true ones, in pixels, root mean square along each axis."""
BORDER_SCALE_PX = 12.0
"""Smoothness of the random field that moves the borders: standard deviation of its Gaussian kernel, in pixels."""
BLOB_SHARE = 0.04
"""Fraction of a network's label image that ellipses of a wrong class cover."""
BLOB_RADIUS_PX = (5.0, 40.0)
"""Smallest and largest radius of these ellipses, in pixels."""
POINT_SHARE = 0.06
"""Fraction of the points that a network labels wrongly."""
SHARED_RMS_PX = 1.5
"""Root mean square of the shift along each axis and of the dilation of each class, the same in all frames, pixels."""

THINGS = (
    *("car", "truck", "bus", "motorcycle", "bicycle", "pedestrian", "rider"),
    *("pole", "traffic_light", "traffic_sign"),
)
"""Names of the foreground classes, which annotators draw too large or too small."""
MERGED_POINT_CLASSES = {
    **{"road_line": "road", "truck": "car", "bus": "car", "rider": "pedestrian"},
    **{"traffic_light": "pole", "traffic_sign": "pole"},
}
"""Classes that the ontology of the points merges with another class."""
MERGED_IMAGE_CLASSES = {
    **{"wall": "building", "fence": "building", "terrain": "vegetation", "sidewalk": "road"},
    **{"motorcycle": "bicycle", "rider": "bicycle"},
}
"""Classes that the ontology of the images merges with another class."""


def imitate_network(observations: Observations, rng: np.random.Generator) -> Observations:
    """Imitate a network: move borders by a smooth random field, add blobs of wrong classes, mislabel some points."""
    classes = all_classes(observations.image_class_names)
    with_blobs = observations.with_images(
        image.with_classes(imitate_network_pixels(image.classes, classes, rng))
        for image in observations.images
    )
    return with_wrong_points(with_blobs, POINT_SHARE, rng)


def imitate_network_pixels(image: ClassIds, classes: ClassIds, rng: np.random.Generator) -> ClassIds:
    """Move the borders of a label image (H, W) by a smooth random field, and add blobs of wrong classes.

    Args:
        image: Ids of the pixels.
        classes: Ids of all classes.
        rng: Random generator.
    """
    return _with_blobs(_with_moved_borders(image, rng), classes, rng)


def with_ragged_things(observations: Observations, grow_px: int) -> Observations:
    """Dilate the foreground classes of label images by `grow_px` pixels, or erode them if it is negative."""
    names = observations.image_class_names
    things = [index for index, name in enumerate(names) if name in THINGS]
    return observations.with_images(
        image.with_classes(_with_grown(image.classes, things, grow_px)) for image in observations.images
    )


def with_shared_errors(observations: Observations, rng: np.random.Generator) -> Observations:
    """Shift and dilate each class of the images by its own amount, the same in all frames.

    More frames do not average these errors out. A network makes them if it draws one class too large and another to one
    side.
    """
    shape = (len(observations.image_class_names), 3)
    changes = rng.normal(0.0, SHARED_RMS_PX, shape).astype(np.float32)
    return observations.with_images(
        image.with_classes(_with_moved_classes(image.classes, changes)) for image in observations.images
    )


def with_disjoint_ontologies(observations: Observations, rng: np.random.Generator) -> Observations:
    """Merge some classes of the points and others of the images, shuffle the ids and remove the names."""
    points, num_points = _without_names(observations.point_class_names, MERGED_POINT_CLASSES, rng)
    images, num_images = _without_names(observations.image_class_names, MERGED_IMAGE_CLASSES, rng)
    shuffled = observations.with_clouds(
        cloud.with_classes(points[cloud.classes]) for cloud in observations.clouds
    ).with_images(image.with_classes(images[image.classes]) for image in observations.images)
    return replace(
        shuffled,
        point_class_names=tuple(f"point class {index}" for index in range(num_points)),
        image_class_names=tuple(f"image class {index}" for index in range(num_images)),
    )


def _without_names(
    names: Sequence[str], replacements: Mapping[str, str], rng: np.random.Generator
) -> tuple[ClassIds, int]:
    """Make a table (256,) of shuffled ids, and count them."""
    remaining = sorted({replacements.get(name, name) for name in names})
    ids = dict(zip(remaining, rng.permutation(len(remaining)), strict=True))
    table = np.full(256, NO_CLASS, np.uint8)
    table[: len(names)] = [ids[replacements.get(name, name)] for name in names]
    return table, len(remaining)


def _with_grown(image: ClassIds, things: Sequence[int], grow_px: int) -> ClassIds:
    from scipy.ndimage import grey_dilation

    grows = np.isin(image, things) == (grow_px > 0)
    # Classes that do not grow are zero, so that growing classes cover them.
    reach = 2 * abs(grow_px) + 1
    above: npt.NDArray[np.int16] = grey_dilation(
        np.where(grows, image.astype(np.int16) + 1, 0), (reach, reach)
    )
    grown: ClassIds = np.where(~grows & (above > 0), above - 1, image).astype(np.uint8)
    return grown


def _with_moved_classes(image: ClassIds, changes: npt.NDArray[np.float32]) -> ClassIds:
    """Label each pixel by the class in whose changed region it is deepest; (C, 3) right, down and outwards, pixels."""
    import cv2

    depths = np.full((len(changes), *image.shape), -np.inf, np.float32)
    for index in np.unique(image[image != NO_CLASS]):
        right, down, outwards = changes[index]
        is_inside = (image == index).astype(np.uint8)
        depth = cv2.distanceTransform(is_inside, cv2.DIST_L2, cv2.DIST_MASK_5)
        depth -= cv2.distanceTransform(1 - is_inside, cv2.DIST_L2, cv2.DIST_MASK_5)
        shift = np.array([[1.0, 0.0, right], [0.0, 1.0, down]], np.float32)
        moved = cv2.warpAffine(depth, shift, image.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
        depths[index] = moved + outwards
    classes: ClassIds = np.where(image == NO_CLASS, NO_CLASS, depths.argmax(axis=0)).astype(np.uint8)
    return classes


def _with_moved_borders(image: ClassIds, rng: np.random.Generator) -> ClassIds:
    from scipy.ndimage import gaussian_filter

    fields = [gaussian_filter(rng.standard_normal(image.shape), BORDER_SCALE_PX) for _ in range(2)]
    down, right = (field * (BORDER_RMS_PX / field.std()) for field in fields)
    v, u = np.indices(image.shape)
    height, width = image.shape
    rows = np.clip(np.rint(v + down), 0, height - 1).astype(int)
    columns = np.clip(np.rint(u + right), 0, width - 1).astype(int)
    moved: ClassIds = image[rows, columns]
    return moved


def _with_blobs(image: ClassIds, classes: ClassIds, rng: np.random.Generator) -> ClassIds:
    noisy = image.copy()
    height, width = image.shape
    covered = 0.0
    while covered < BLOB_SHARE * image.size:
        radius = rng.uniform(*BLOB_RADIUS_PX)
        flat = radius * rng.uniform(0.5, 1.0)
        u, v = rng.uniform(0.0, width), rng.uniform(0.0, height)
        top, left = max(int(v - flat), 0), max(int(u - radius), 0)
        window = noisy[top : int(v + flat) + 2, left : int(u + radius) + 2]
        rows, columns = np.indices(window.shape)
        inside = ((columns + left - u) / radius) ** 2 + ((rows + top - v) / flat) ** 2 < 1.0
        window[inside] = rng.choice(classes)
        covered += np.count_nonzero(inside)
    return noisy
