from collections.abc import Sequence

import numpy as np
import pytest
from laboratory.label_errors import (
    BLOB_SHARE,
    POINT_SHARE,
    imitate_network,
    with_disjoint_ontologies,
    with_ragged_things,
    with_shared_errors,
)

from semcal_cli.drive.camera import Camera
from semcal_cli.observations.observations import (
    NO_CLASS,
    FrameObservation,
    LabelledCloud,
    LabelledImage,
    Observations,
)
from semcal_cli.observations.reading import remove_speckle
from semcal_cli.synthetic.label_noise import mislabel, with_wrong_labels


def share_changed(before: np.ndarray, after: np.ndarray) -> float:
    return float((before != after)[before != NO_CLASS].mean())


def test_wrong_labels_are_wrong_and_spread_over_all_classes() -> None:
    classes = np.array([2, 5, 7], np.uint8)
    ids = np.full(60_000, 5, np.uint8)
    ids[:10_000] = NO_CLASS
    noisy = mislabel(ids, 0.3, classes, np.random.default_rng(0))
    assert share_changed(ids, noisy) == pytest.approx(0.3, abs=0.01)
    assert (noisy[:10_000] == NO_CLASS).all()
    assert (noisy == 2).sum() == pytest.approx((noisy == 7).sum(), rel=0.05)


def test_isolated_wrong_pixels_are_replaced(street_observations: Observations) -> None:
    wrong = with_wrong_labels(street_observations, 0.2, np.random.default_rng(1))
    cleaned = remove_speckle(wrong)
    assert cleaned.speckle == pytest.approx(0.2, abs=0.02)
    true = street_observations.images[0].classes
    assert share_changed(true, wrong.images[0].classes) > 0.19
    assert share_changed(true, cleaned.images[0].classes) < 0.01


def test_a_networks_labels_are_wrong_at_borders_and_in_blobs(street_observations: Observations) -> None:
    noisy = imitate_network(street_observations, np.random.default_rng(2))
    before, after = street_observations.images[0].classes, noisy.images[0].classes
    assert 0.5 * BLOB_SHARE < share_changed(before, after) < 0.15
    # Hardly any wrong pixel stands alone.
    assert remove_speckle(noisy).speckle < 0.01
    points = share_changed(street_observations.clouds[0].classes, noisy.clouds[0].classes)
    assert points == pytest.approx(POINT_SHARE, abs=0.01)


def test_errors_that_all_frames_share_are_alike_in_all_frames(street_observations: Observations) -> None:
    """Frames of one image stay frames of one image, and every class keeps its neighbours: borders move."""
    one = street_observations.images[0]
    same = street_observations.with_images(one for _ in street_observations.images)
    first, *others = (image.classes for image in with_shared_errors(same, np.random.default_rng(4)).images)
    for other in others:
        np.testing.assert_array_equal(first, other)
    assert 0.005 < share_changed(one.classes, first) < 0.1
    assert set(np.unique(first)) <= set(np.unique(one.classes))


def test_disjoint_ontologies_share_nothing_and_merge_otherwise(street_observations: Observations) -> None:
    disjoint = with_disjoint_ontologies(street_observations, np.random.default_rng(3))
    assert not set(disjoint.image_class_names) & set(disjoint.point_class_names)

    def merged(
        before: list[np.ndarray], after: list[np.ndarray], names: Sequence[str]
    ) -> set[frozenset[str]]:
        """Names that got the same id."""
        pairs = set(
            zip(np.concatenate(before).ravel().tolist(), np.concatenate(after).ravel().tolist(), strict=True)
        )
        groups = {
            frozenset(names[old] for old, new in pairs if new == found and old != NO_CLASS)
            for found in {new for _, new in pairs}
        }
        return {group for group in groups if len(group) > 1}

    points = merged(
        [cloud.classes for cloud in street_observations.clouds],
        [cloud.classes for cloud in disjoint.clouds],
        street_observations.point_class_names,
    )
    images = merged(
        [image.classes.ravel() for image in street_observations.images],
        [image.classes.ravel() for image in disjoint.images],
        street_observations.image_class_names,
    )
    assert {"road", "road_line"} in points
    assert {"vegetation", "terrain"} in images
    assert not points & images


@pytest.mark.parametrize("grow_px", [2, -2])
def test_ragged_things_grow_or_shrink_by_so_much(grow_px: int) -> None:
    image = np.zeros((20, 30), np.uint8)
    image[5:15, 10:20] = 1
    cloud = LabelledCloud(np.zeros((2, 3), np.float32), np.array([0, 1], np.uint8))
    observations = Observations(
        camera=Camera(
            model="plumb_bob", width=30, height=20, K=((9.0, 0.0, 15.0), (0.0, 9.0, 10.0), (0.0, 0.0, 1.0))
        ),
        lidar=None,
        frame_observations=(FrameObservation(cloud, LabelledImage(image)),),
        point_class_names=("road", "car"),
        image_class_names=("road", "car"),
    )
    expected = np.zeros_like(image)
    expected[5 - grow_px : 15 + grow_px, 10 - grow_px : 20 + grow_px] = 1
    np.testing.assert_array_equal(with_ragged_things(observations, grow_px).images[0].classes, expected)
