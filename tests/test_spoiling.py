"""Drives spoiled in the ways of real recordings."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import STREET
from laboratory import spoiling
from laboratory.raw_drive import RawDrive, write_raw_drive

from semcal_cli import core
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import read_drive
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.reading import read_observations


def test_a_drive_is_written_as_it_was_read(raw: RawDrive, street: Path, tmp_path: Path) -> None:
    found, original = (
        read_observations(read_drive(path)) for path in (write_raw_drive(raw, tmp_path), street)
    )
    for one, other in zip(found.frame_observations, original.frame_observations, strict=True):
        assert np.array_equal(one.cloud.points, other.cloud.points)
        assert np.array_equal(one.cloud.classes, other.cloud.classes)
        assert np.array_equal(one.image.classes, other.image.classes)
    first = read_drive(tmp_path)
    assert first.T_camera_lidar is None
    image = first.frames[0].image
    assert image is not None
    assert (tmp_path / image).read_bytes() == (street / "images/000000.png").read_bytes()


@pytest.mark.parametrize(("angle_deg", "distance_m"), [(1.0, 0.0), (0.0, 0.2)])
def test_a_knocked_camera_sees_the_same_in_another_pose(
    raw: RawDrive, rng: np.random.Generator, angle_deg: float, distance_m: float
) -> None:
    knocked = spoiling.knocked(raw, rng, angle_deg, distance_m, share=0.25)
    assert knocked.knock == 3
    before, after = knocked.truths
    change = compare_poses(after, before)
    assert change.rotation_deg == pytest.approx(angle_deg, abs=1e-9)
    assert change.camera_center_cm == pytest.approx(100.0 * distance_m, abs=1e-9)
    assert knocked.frames[:3] == raw.frames[:3]
    camera = core_camera(raw.drive.camera)
    seen = [
        core.project_points(camera, frame.points, frame.T_camera_lidar).pixels
        for frame in (raw.frames[3], knocked.frames[3])
    ]
    assert np.nanmax(np.abs(seen[0] - seen[1])) < 0.1  # coordinates are rounded to single precision


def test_a_camera_is_knocked_in_the_middle_of_the_drive(raw: RawDrive, rng: np.random.Generator) -> None:
    long = raw.with_frames(raw.frames * 5)
    knocks = [spoiling.knocked(long, rng, angle_deg=1.0).knock for _ in range(30)]
    assert min(knocks) >= 5
    assert max(knocks) <= 15
    assert len(set(knocks)) > 5


def test_clouds_are_turned_each_by_its_own(raw: RawDrive, rng: np.random.Generator) -> None:
    turned = spoiling.clouds_turned(raw, rng)
    assert len(turned.truths) == 1
    for frame, original in zip(turned.frames, raw.frames, strict=True):
        far = np.linalg.norm(original.points, axis=1)
        assert np.linalg.norm(frame.points, axis=1) == pytest.approx(far, rel=1e-5)
        cosine = np.einsum("ni,ni->n", frame.points, original.points).astype(float) / far**2
        angle_deg = math.degrees(math.acos(np.clip(cosine, -1.0, 1.0).min()))
        assert 0.5 < angle_deg < 1.1


def test_labels_are_shifted(raw: RawDrive, rng: np.random.Generator) -> None:
    shifted = spoiling.point_labels_shifted(raw, rng, 3).frames[0].point_labels
    original = raw.frames[0].point_labels
    assert any(np.array_equal(shifted, np.roll(original, shift)) for shift in (-3, 3))
    for step, changed in ((1, [True] * 4), (2, [True, False, True, False])):
        frames = spoiling.image_labels_shifted(raw, rng, step).frames
        is_changed = [
            not np.array_equal(frame.image_labels, before.image_labels)
            for frame, before in zip(frames, raw.frames, strict=True)
        ]
        assert is_changed in (changed, changed[::-1])
        assert [frame.image for frame in frames] == [frame.image for frame in raw.frames]


def test_intrinsics_and_scale_are_wrong(raw: RawDrive, rng: np.random.Generator) -> None:
    (fx, _, cx), (_, fy, cy), _ = raw.drive.camera.K
    camera = spoiling.principal_point_wrong(raw, rng, cx_px=4.0).drive.camera
    assert abs(camera.K[0][2] - cx) == pytest.approx(4.0)
    assert (camera.K[1][2], camera.K[0][0]) == (cy, fx)
    camera = spoiling.focal_length_wrong(raw, rng, 0.03).drive.camera
    assert abs(camera.K[0][0] / fx - 1.0) == pytest.approx(0.03)
    assert camera.K[1][1] == fy
    scaled = spoiling.clouds_scaled(raw, rng, 1.2).frames[0].points
    assert scaled == pytest.approx(1.2 * raw.frames[0].points, rel=1e-6)


def test_a_frame_is_listed_again(raw: RawDrive, rng: np.random.Generator, tmp_path: Path) -> None:
    for number, (options, num_files) in enumerate(
        [({}, 1), ({"is_renamed": True}, 5), ({"noise_m": 0.005}, 5)]
    ):
        (folder := tmp_path / str(number)).mkdir()
        drive = read_drive(write_raw_drive(spoiling.one_frame_again(raw, rng, 5, **options), folder))
        assert len(drive.frames) == 5
        contents = {
            drive.resolve(frame.points): drive.resolve(frame.points).read_bytes() for frame in drive.frames
        }
        assert len(contents) == num_files
        assert len(set(contents.values())) == (5 if "noise_m" in options else 1)


def test_classes_are_merged_and_images_exchanged(
    raw: RawDrive, rng: np.random.Generator, tmp_path: Path
) -> None:
    for first in (None, (3, 9, 11)):
        classes = spoiling.classes_merged(raw, rng, first).drive.classes
        assert classes is not None
        assert list(classes.points) == ["a", "b"]
        assert classes.points == classes.image
    assert classes.points["a"] == (3, 9, 11)
    mirrored = spoiling.images_mirrored(raw, rng)
    is_mirrored = [
        np.array_equal(frame.image_labels, before.image_labels[:, ::-1])
        for frame, before in zip(mirrored.frames, raw.frames, strict=True)
    ]
    assert sum(is_mirrored) == 2
    write_raw_drive(mirrored, tmp_path)
    other = spoiling.image_of_another_moment(replace(raw, frames=raw.frames[:3], unused=raw.frames[3:]), rng)
    assert [frame.image for frame in other.frames].count(raw.frames[3].image) == 1


def test_late_images_show_a_rig_that_is_farther_on(raw: RawDrive, rng: np.random.Generator) -> None:
    for speeds_m_s, ways_m in (((10.0, 10.0), {0.3}), ((0.0, 20.0), None)):
        late = spoiling.images_late(raw, rng, late_s=0.03, speeds_m_s=speeds_m_s)
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
def test_labels_of_points_are_those_of_images_through_a_wrong_transform(
    raw: RawDrive, rng: np.random.Generator, is_by_a_network: bool
) -> None:
    leaked = spoiling.point_labels_from_images(raw, rng, is_by_a_network=is_by_a_network)
    camera, shares = core_camera(raw.drive.camera), []
    for frame, before in zip(leaked.frames, raw.frames, strict=True):
        projected = core.project_points(camera, frame.points, frame.T_camera_lidar)
        is_seen = np.isfinite(projected.ranges)
        column, row = np.rint(projected.pixels[is_seen]).astype(int).T
        pixels = frame.image_labels[row.clip(0, STREET.height - 1), column.clip(0, STREET.width - 1)]
        assert 0.5 < np.mean(frame.point_labels == spoiling.UNLABELLED) < 0.95
        assert not np.array_equal(frame.point_labels, before.point_labels)
        assert np.array_equal(frame.image_labels, before.image_labels) != is_by_a_network
        shares.append(np.mean(frame.point_labels[is_seen] == pixels))
    assert 0.5 < np.mean(shares) < 0.99  # the truth is near, but not where the labels were made


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
