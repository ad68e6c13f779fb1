import numpy as np
import pytest

from semcal_cli.classes import NO_CLASS
from semcal_cli.label_noise import (
    BLOB_SHARE,
    POINT_SHARE,
    as_by_a_network,
    mislabel,
    with_disjoint_ids,
    with_wrong_labels,
)
from semcal_cli.observations import Observations, mend


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


def test_isolated_wrong_pixels_are_mended(street_observations: Observations) -> None:
    wrong = with_wrong_labels(street_observations, 0.2, np.random.default_rng(1))
    mended = mend(wrong)
    assert mended.speckle == pytest.approx(0.2, abs=0.02)
    true = street_observations.image_classes[0]
    assert share_changed(true, wrong.image_classes[0]) > 0.19
    assert share_changed(true, mended.image_classes[0]) < 0.01


def test_a_networks_labels_are_wrong_at_borders_and_in_blobs(street_observations: Observations) -> None:
    noisy = as_by_a_network(street_observations, np.random.default_rng(2))
    before, after = street_observations.image_classes[0], noisy.image_classes[0]
    assert 0.5 * BLOB_SHARE < share_changed(before, after) < 0.15
    # Hardly any wrong pixel stands alone.
    assert mend(noisy).speckle < 0.01
    points = share_changed(street_observations.point_classes[0], noisy.point_classes[0])
    assert points == pytest.approx(POINT_SHARE, abs=0.01)


def test_disjoint_ids_are_a_permutation(street_observations: Observations) -> None:
    disjoint = with_disjoint_ids(street_observations, np.random.default_rng(3))
    assert not set(disjoint.image_class_names) & set(street_observations.point_class_names)
    before, after = street_observations.image_classes[0], disjoint.image_classes[0]
    pairs = set(zip(before.ravel().tolist(), after.ravel().tolist(), strict=True))
    assert len(pairs) == len(np.unique(before)) == len(np.unique(after))
