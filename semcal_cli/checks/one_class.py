"""Whether the points in the image and its pixels have enough classes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.drive.camera import core_camera
from semcal_cli.errors import format_against_limit
from semcal_cli.estimation.uncertainty.information import entropy
from semcal_cli.findings.check import Check, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.observations import NO_CLASS, Observations

ONE_CLASS = Check(
    topic="one-class",
    advice="record frames with more kinds of objects, or label more classes",
    entry=Entry(
        title="Nearly all of one class",
        section=PageSection.DETERMINATION,
        quotes=(
            (
                "nearly all points in the image have the same class, equivalent to 1.05 equally frequent "
                "classes (limit 1.2): record frames with more kinds of objects, or label more "
                "classes"
            ),
        ),
        meaning=(
            "One side, points in the image or pixels, is nearly uniform and carries almost no information."
        ),
        cause=(
            "The network was trained for another domain, the `classes:` of the drive merge or omit "
            "ids, or the scene is empty."
        ),
        remedy=(
            "`semcal inspect DRIVE --frames` counts the classes of each frame. Correct the labels or "
            "the `classes:`."
        ),
        figure=(
            "Number of equally frequent classes with the same entropy as the classes of the points in "
            "the image, or of its pixels."
        ),
    ),
)
NOTHING_LABELLED = Check(
    topic="nothing-labelled",
    advice="label them, or check which ids the drive ignores",
    entry=Entry(
        title="Nothing is labelled",
        section=PageSection.DETERMINATION,
        quotes=(
            (
                "none of the points in the image are labelled: label them, or check which ids the drive "
                "ignores"
            ),
        ),
        meaning="All points in the image, or all pixels, have an id that carries no information.",
        cause="`ignore:` or `classes:` in the drive does not match the ids in the files.",
        remedy=(
            "Compare the ids that `semcal inspect DRIVE` lists with those in the drive. Without point "
            "labels, leave `--cue` out."
        ),
    ),
)


def check_classes(observations: Observations, T_camera_lidar: Pose) -> list[Measured]:
    """Check that the points in the image and its pixels have enough classes, weighted by their frequency."""
    sides = {}
    if not observations.has_partitions:  # Each segment is a class of its own.
        camera = core_camera(observations.camera)
        sides["points in the image"] = [
            cloud.classes[np.isfinite(core.project_points(camera, cloud.points, T_camera_lidar).ranges)]
            for cloud in observations.clouds
        ]
    sides["pixels"] = [image.classes.ravel() for image in observations.images]
    return [_check_side(name, classes) for name, classes in sides.items()]


def _check_side(name: str, classes: Sequence[npt.NDArray[np.uint8]]) -> Measured:
    counts = np.sum([np.bincount(frame_classes, minlength=NO_CLASS + 1) for frame_classes in classes], axis=0)
    counts = counts[:NO_CLASS]
    if not counts.any():
        return NOTHING_LABELLED.without_value(f"none of the {name} are labelled")
    # The number of equally frequent classes that would have the same entropy.
    effective = float(np.exp(entropy(counts)))
    like, least = format_against_limit(effective, ONE_CLASS.limit(), 2)
    sentence = f"nearly all {name} have the same class, equivalent to {like} equally frequent classes (limit {least})"
    return ONE_CLASS.measured(effective, sentence)
