"""Drives with faults that hardly show, and what is counted of their calibrations."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import STREET

from semcal_cli import _core
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import read_drive
from semcal_cli.drive.reading import read_observations
from semcal_cli.experiments import spoiled
from semcal_cli.experiments.outcome import Outcome
from semcal_cli.experiments.spoiled_rates import kinds_markdown, spoiled_rates, subtle_rates
from semcal_cli.formats import read_transform
from semcal_cli.synthetic import spoiling
from semcal_cli.synthetic.raw_drive import RawDrive, read_raw_drive, write_raw_drive

RNG_SEED = 3


@pytest.fixture(scope="module")
def raw(street: Path) -> RawDrive:
    return read_raw_drive(read_drive(street), read_transform(street))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(RNG_SEED)


def test_late_pictures_show_a_rig_that_is_farther_on(raw: RawDrive, rng: np.random.Generator) -> None:
    for speeds_m_s, ways_m in (((10.0, 10.0), {0.3}), ((0.0, 20.0), None)):
        late = spoiling.pictures_late(raw, rng, late_s=0.03, speeds_m_s=speeds_m_s)
        assert late.truths == raw.truths
        found = []
        for frame, before in zip(late.frames, raw.frames, strict=True):
            assert frame.points.dtype == np.float32
            moved = frame.points - before.points
            assert np.allclose(moved, [moved[0, 0], 0.0, 0.0], atol=1e-5)
            found.append(round(float(moved[0, 0]), 4))
        assert set(found) == ways_m if ways_m else len(set(found)) == 4
        assert 0.0 <= min(found) <= max(found) <= 0.6


@pytest.mark.parametrize("is_by_a_network", [False, True])
def test_labels_of_points_are_those_of_pictures_through_a_wrong_transform(
    raw: RawDrive, rng: np.random.Generator, is_by_a_network: bool
) -> None:
    leaked = spoiling.point_labels_from_pictures(raw, rng, is_by_a_network=is_by_a_network)
    camera, shares = core_camera(raw.drive.camera), []
    for frame, before in zip(leaked.frames, raw.frames, strict=True):
        projected = _core.project_points(camera, frame.points, frame.T_camera_lidar)
        is_seen = np.isfinite(projected.ranges)
        column, row = np.rint(projected.pixels[is_seen]).astype(int).T
        pixels = frame.image_labels[row.clip(0, STREET.height - 1), column.clip(0, STREET.width - 1)]
        assert 0.5 < np.mean(frame.point_labels == spoiling.UNLABELLED) < 0.95
        assert not np.array_equal(frame.point_labels, before.point_labels)
        assert np.array_equal(frame.image_labels, before.image_labels) != is_by_a_network
        shares.append(np.mean(frame.point_labels[is_seen] == pixels))
    assert 0.5 < np.mean(shares) < 0.99  # the truth is near, but not where the labels were made


def test_a_network_labels_both_sides(raw: RawDrive, rng: np.random.Generator) -> None:
    labelled = spoiling.labels_by_a_network(raw, rng)
    for frame, before in zip(labelled.frames, raw.frames, strict=True):
        assert 0.03 < np.mean(frame.point_labels != before.point_labels) < 0.09
        assert 0.03 < np.mean(frame.image_labels != before.image_labels) < 0.25


def test_label_images_are_misplaced(raw: RawDrive, rng: np.random.Generator, tmp_path: Path) -> None:
    before = raw.frames[0].image_labels
    shifted = spoiling.image_labels_shifted(raw, rng, distance_px=(8, 8)).frames[0].image_labels
    around = [np.roll(before, shift, axis) for axis in (0, 1) for shift in (-8, 8)]
    inner = np.s_[8:-8, 8:-8]
    assert sum(np.array_equal(shifted[inner], each[inner]) for each in around) == 1
    cropped = spoiling.image_labels_cropped(raw, rng, 8)
    assert cropped.drive.camera.K == raw.drive.camera.K
    assert np.array_equal(cropped.frames[0].image_labels, before[8:, 8:])
    observed = read_observations(read_drive(write_raw_drive(cropped, tmp_path)))
    assert observed.images[0].classes.shape == (STREET.height - 8, STREET.width - 8)


def test_users_give_no_more_than_they_know(raw: RawDrive, tmp_path: Path) -> None:
    assert raw.drive.camera.intrinsics_sigma is not None
    for number, (name, keys, has_sigma) in enumerate(
        (
            ("pictures 30 ms late at 10 m/s", {"point_labels", "image_labels", "image"}, True),
            ("a good drive, by segments", {"image_labels"}, True),
            ("f wrong by 1 %", {"point_labels", "image_labels", "image"}, False),
            ("label pictures shifted by 8 px", {"point_labels", "image_labels"}, False),
            ("label pictures cropped by 8 px, by segments", {"image_labels"}, False),
        )
    ):
        (folder := tmp_path / str(number)).mkdir()
        drive = read_drive(write_raw_drive(spoiled.given(spoiled.KINDS[name], raw), folder))
        assert set(drive.frames[0].model_dump(exclude_none=True)) == {"points", *keys}
        assert len([*folder.iterdir()]) == 1 + len(drive.frames) * (1 + len(keys))
        assert (drive.camera.intrinsics_sigma is not None) == has_sigma
        assert drive.T_camera_lidar is None
        assert drive.motion is None


def outcome(kind: str, status: str, error_deg: float, **more: Any) -> Outcome:
    errors = (0.0, 0.0, 0.0, 0.0, error_deg, 0.0)
    return Outcome(kind, 0, "default", 10, 0.1, status, "", errors, (0.1,) * 6, (0.2,) * 6, **more)


def test_rates_of_subtle_faults() -> None:
    late, leak = (
        "pictures 30 ms late at 10 m/s",
        "points labelled from pictures through a wrong transform",
    )
    segments = "a good drive, by segments"
    outcomes = [
        outcome(late, "trusted", 0.31),
        outcome(late, "trusted", 0.21),
        outcome(late, "trusted", 0.19),
        outcome(late, "not_trusted", 9.0),
        replace(outcome(late, "trusted", 0.0), half_widths=(), sigmas=()),
        outcome("f wrong by 1 %", "trusted", 0.9, is_told=True),
        outcome("f wrong by 1 %", "trusted", 0.9, is_told=False),
        outcome(leak, "not_trusted", 2.0, is_told=True),
        outcome(leak, "trusted", 2.0, is_told=False),
        outcome(segments, "trusted", 0.1),
        outcome(segments, "not_trusted", 0.1),
        outcome(segments, "not_trusted", 40.0),
    ]
    rates = {rate.name: (rate.count, rate.n) for rate in subtle_rates(outcomes)}
    for group, counts in {
        "pictures late": (3, 3, 1, 5),
        "intrinsics slightly wrong": (2, 1, 1, 2),
        "leaked labels": (1, 1, 1, 2),
    }.items():
        names = (
            "trusted, outside the interval",
            "the same, not told",
            "the same, beyond 0.3 degrees or 6 cm",
        )
        assert [rates[f"{group}: {name}"] for name in names] == [(count, counts[3]) for count in counts[:3]]
    assert rates["leaked labels are told"] == (1, 2)
    assert rates["good drives by segments are trusted"] == (1, 3)
    assert rates["good drives by segments are trusted, of those within 0.3 degrees and 6 cm"] == (1, 2)
    assert rates["good drives by segments, trusted: axes in the 95 % interval"] == (6, 6)
    table = kinds_markdown(outcomes, is_subtle=True)
    assert f"| {late} | 5 | 4 | 1 | 0 | - | 3 | 3 | 1 | 0.31 deg, 0.0 cm | 16 of 18 |" in table
    assert "| f wrong by 1 % | 2 | 2 | 0 | 0 | 1 | 2 | 1 | 1 | 0.90 deg, 0.0 cm | 10 of 12 |" in table
    assert spoiled_rates(outcomes)[0].n == 0
    assert kinds_markdown(outcomes, is_subtle=False) == ""
    assert kinds_markdown([outcome("clouds in feet", "trusted", 0.0)], is_subtle=True) == ""
