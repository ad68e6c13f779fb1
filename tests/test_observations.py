"""What lies on disk becomes the same observations, whatever it is written as."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from semcal_cli import core
from semcal_cli.drive.document import DRIVE_FILE, Drive, read_drive
from semcal_cli.errors import InputError
from semcal_cli.files.documents import document_text, read_document
from semcal_cli.files.output_files import write_text
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.frame_selection import select_frames
from semcal_cli.observations.observations import LabelledCloud, Observations
from semcal_cli.observations.reading import load_observations

COLORS = np.random.default_rng(0).integers(0, 256, (256, 3)).astype(np.uint8)
"""Red, green, blue of each id."""


@pytest.fixture
def rewrite(
    street: Path, tmp_path: Path
) -> Callable[[Callable[[np.ndarray, Path], Path], dict[str, Any]], Drive]:
    """Write the street's label images in another way, and its drive.yaml with some changes."""

    def drive(save: Callable[[np.ndarray, Path], Path], changes: dict[str, Any]) -> Drive:
        document = read_document(street / DRIVE_FILE)
        for index, frame in enumerate(document["frames"]):
            ids = cv2.imread(str(street / frame["image_labels"]), cv2.IMREAD_UNCHANGED)
            frame |= {key: str(street / frame[key]) for key in ("points", "point_labels")}
            frame["image_labels"] = str(save(ids, tmp_path / str(index)))
            frame.pop("image", None)
        document = {key: value for key, value in (document | changes).items() if value is not None}
        write_text(document_text(document, "yaml"), tmp_path / DRIVE_FILE)
        return read_drive(tmp_path)

    return drive


def save_colors(ids: np.ndarray, path: Path) -> Path:
    file = path.with_suffix(".png")
    cv2.imwrite(str(file), COLORS[ids][..., ::-1])
    return file


def test_colours_and_ids_are_the_same_observations(street: Path, rewrite: Callable[..., Drive]) -> None:
    original = read_drive(street)
    assert original.classes
    named = {name: ids for name, ids in original.classes.image.items() if len(ids) == 1}
    palette = {name: COLORS[i].tolist() for name, (i,) in named.items()}
    classes = read_document(street / DRIVE_FILE)["classes"]
    changes = {"palette": palette, "classes": {"points": classes["points"]}, "ignore": {"points": [0]}}
    coloured = load_observations(rewrite(save_colors, changes))
    expected = load_observations(original)
    assert coloured.image_class_names == expected.image_class_names
    for found, image in zip(coloured.images, expected.images, strict=True):
        np.testing.assert_array_equal(found.classes, image.classes)


def same_agreement(found: Observations, expected: Observations, T_camera_lidar: Pose) -> bool:
    """Whether the core computes the same from both, to the last bit."""
    one, other = (core.agreement(each.core, T_camera_lidar) for each in (found, expected))
    return np.array_equal(one.joint, other.joint) and one.sigma == other.sigma


def test_subsets_and_other_labels_share_what_is_the_same(street: Path, street_truth: Pose) -> None:
    whole = load_observations(read_drive(street))
    subset = whole.of_frames([2, 0])
    erased = [image.with_classes(np.where(image.classes == 0, 255, image.classes)) for image in subset.images]
    masked = subset.with_images(erased)
    zoomed = replace(subset, camera=subset.camera.zoomed(1.1))
    for other in (subset, masked, zoomed):
        for cloud, index in zip(other.clouds, [2, 0], strict=True):
            assert cloud.points is whole.clouds[index].points
            assert cloud.core is whole.clouds[index].core
    for image, mask, index in zip(zoomed.images, masked.images, [2, 0], strict=True):
        assert image.core is whole.images[index].core
        assert mask.core is not image.core
    drive = read_drive(street)
    alone = drive.model_copy(update={"frames": (drive.frames[2], drive.frames[0])})
    assert same_agreement(subset, load_observations(alone), street_truth)
    copied = [LabelledCloud(cloud.points.copy(), cloud.classes.copy()) for cloud in subset.clouds]
    for other in (masked, zoomed):
        assert same_agreement(other, other.with_clouds(copied), street_truth)
        assert not same_agreement(other, subset, street_truth)


def test_arrays_that_do_not_belong_together_are_refused(street_observations: Observations) -> None:
    few = street_observations.of_frames([0, 1])
    first, second = few.clouds
    image = few.images[1]
    for wrong, complaint in (
        (few.with_clouds([first, second.with_points(second.points[1:])]), r"\d+ points have \d+ classes"),
        (few.with_clouds([first, second.with_classes(second.classes | 64)]), "a point's class is not below"),
        (few.with_images([image, image.with_classes(image.classes[1:])]), "the label image is 640 x 359"),
        (few.with_images([image, replace(image, shares=few_shares())]), "need the same number of shares"),
    ):
        with pytest.raises(InputError, match=f"frame 1: .*{complaint}"):
            _ = wrong.core


def few_shares() -> core.ClassShares:
    return core.ClassShares.certain(np.zeros(3, np.uint8))


def test_the_most_different_frames_are_found_by_colours(street: Path, rewrite: Callable[..., Drive]) -> None:
    palette = {str(i): COLORS[i].tolist() for i in range(30)}
    drive = rewrite(save_colors, {"palette": palette, "classes": None, "ignore": None})
    chosen, expected = select_frames(drive, 2), select_frames(read_drive(street), 2)
    assert [f.points for f in chosen.frames] == [str(street / f.points) for f in expected.frames]


def test_ids_beside_a_palette_are_refused(rewrite: Callable[..., Drive]) -> None:
    drive = rewrite(save_colors, {"palette": {"a": [1, 2, 3]}, "ignore": {"image": [7]}})
    with pytest.raises(InputError, match=r"drive\.yaml: palette: found classes\.image or ignore\.image, too"):
        load_observations(drive)
