"""Label noise: ids that are replaced by those of other classes, at random."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from semcal_cli.geometry.arrays import ClassIds
from semcal_cli.observations.observations import NO_CLASS, Observations


def mislabel(
    ids: ClassIds, share: float, classes: ClassIds, rng: np.random.Generator, unlabelled: int = NO_CLASS
) -> ClassIds:
    """Replace ids, each with probability `share`, by the id of another class, drawn uniformly.

    Args:
        ids: Ids of points or pixels.
        share: Probability that an id is replaced.
        classes: Sorted ids of all classes.
        rng: Random generator.
        unlabelled: Id that is never replaced.
    """
    noisy = ids.copy()
    wrong = (rng.random(ids.shape) < share) & (ids != unlabelled)
    steps = rng.integers(1, len(classes), np.count_nonzero(wrong))
    noisy[wrong] = classes[(np.searchsorted(classes, ids[wrong]) + steps) % len(classes)]
    return noisy


def with_wrong_labels(observations: Observations, share: float, rng: np.random.Generator) -> Observations:
    """Mislabel a fraction of the points and of the pixels, each independently."""
    observations = with_wrong_points(observations, share, rng)
    classes = all_classes(observations.image_class_names)
    return observations.with_images(
        image.with_classes(mislabel(image.classes, share, classes, rng)) for image in observations.images
    )


def with_wrong_points(observations: Observations, share: float, rng: np.random.Generator) -> Observations:
    """Mislabel a fraction of the points."""
    classes = all_classes(observations.point_class_names)
    return observations.with_clouds(
        cloud.with_classes(mislabel(cloud.classes, share, classes, rng)) for cloud in observations.clouds
    )


def all_classes(names: Sequence[str]) -> ClassIds:
    """List the ids (C,) of classes with these names."""
    return np.arange(len(names), dtype=np.uint8)
