"""Drives spoiled in the ways of real recordings, and what is counted of their calibrations."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from conftest import STREET

from semcal_cli import _core
from semcal_cli.cli import semcal
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import read_drive
from semcal_cli.drive.reading import read_observations
from semcal_cli.errors import CalibrationError
from semcal_cli.experiments import accuracy, diagnosis, pool, spoiled, trust, trust_rates
from semcal_cli.experiments.outcome import Case, Outcome
from semcal_cli.experiments.pool import Pool
from semcal_cli.experiments.spoiled_rates import kinds_markdown, spoiled_rates
from semcal_cli.formats import read_transform
from semcal_cli.geometry.pose_error import compare_poses
from semcal_cli.synthetic import spoiling
from semcal_cli.synthetic.raw_drive import RawDrive, read_raw_drive, write_raw_drive

RNG_SEED = 3


@pytest.fixture(scope="module")
def raw(street: Path) -> RawDrive:
    return read_raw_drive(read_drive(street), read_transform(street))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(RNG_SEED)


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
        _core.project_points(camera, frame.points, frame.T_camera_lidar).pixels
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


def test_classes_are_merged_and_pictures_exchanged(
    raw: RawDrive, rng: np.random.Generator, tmp_path: Path
) -> None:
    for first in (None, (3, 9, 11)):
        classes = spoiling.classes_merged(raw, rng, first).drive.classes
        assert classes is not None
        assert list(classes.points) == ["a", "b"]
        assert classes.points == classes.image
    assert classes.points["a"] == (3, 9, 11)
    mirrored = spoiling.pictures_mirrored(raw, rng)
    is_mirrored = [
        np.array_equal(frame.image_labels, before.image_labels[:, ::-1])
        for frame, before in zip(mirrored.frames, raw.frames, strict=True)
    ]
    assert sum(is_mirrored) == 2
    write_raw_drive(mirrored, tmp_path)
    other = spoiling.picture_of_another_moment(
        replace(raw, frames=raw.frames[:3], unused=raw.frames[3:]), rng
    )
    assert [frame.image for frame in other.frames].count(raw.frames[3].image) == 1


def test_every_seed_is_spoiled_in_every_way() -> None:
    cases = trust.cases(range(100, 103), ["spoiled", "subtle"])
    assert len(cases) == len(set(cases)) == 3 * len(spoiled.KINDS)
    assert {case.kind for case in trust.cases(range(100, 103), ["good", "bad"])} == {
        "good",
        "mine",
        trust.SHARED,
        *trust.BAD,
    }
    assert sum(case.kind in spoiled.KINDS for case in trust.cases(range(100, 110))) == 2 * len(spoiled.KINDS)
    subtle = trust.cases(range(100, 103), ["subtle"])
    assert subtle == [case for case in cases if spoiled.KINDS[case.kind].is_subtle]
    assert {case.num_pairs for case in subtle} == {1, 4, 10, 20}


def test_spoiled_drives_end_to_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pool, "NUM_FRAMES", 2)
    monkeypatch.setattr(spoiled, "NUM_FRAMES", 2)
    rigs = list(accuracy.RIGS)
    seed = 6 * 7 + rigs.index("default")
    monkeypatch.setitem(accuracy.RIGS, "default", {"width": STREET.width, "height": STREET.height})
    pools = Pool(tmp_path / "pool"), Pool(tmp_path / "pool_with_pictures", has_pictures=True)
    experiment = trust.Runner(*pools)
    kinds = {
        "half of the frames turned by 3 degrees": 2,
        "two mountings, 1 degree apart": 2,
        "one frame 20 times": 2,
        "clouds in feet": 1,
        "points labelled from pictures through a wrong transform": 2,
        "f wrong by 1 %, by segments": 2,
    }
    monkeypatch.setitem(
        spoiled.KINDS,
        "one frame 20 times",
        replace(
            spoiled.KINDS["one frame 20 times"], spoil=lambda raw, rng: spoiling.one_frame_again(raw, rng, 2)
        ),
    )
    found = [experiment(Case(kind, seed, num_pairs, 0.0))[0] for kind, num_pairs in kinds.items()]
    assert [each.kind for each in found] == list(kinds)
    assert {each.status for each in found} <= {"trusted", "not_trusted", "failed"}
    assert [each.has_frame for each in found[:2]] == [True, True]
    assert [each.status for each in found[:2]] == ["not_trusted", "not_trusted"]
    assert found[2].is_told
    assert found[4].status == "not_trusted"
    assert found[4].is_told
    assert found[5].status == "not_trusted"  # of two frames


def outcome(kind: str, status: str, error_deg: float, **more: Any) -> Outcome:
    errors = (0.0, 0.0, 0.0, 0.0, error_deg, 0.0)
    return Outcome(kind, 0, "default", 10, 0.1, status, "", errors, (0.1,) * 6, (0.2,) * 6, **more)


def test_rates_of_spoiled_drives() -> None:
    knocked = "half of the frames turned by 1 degrees"
    outcomes = [
        outcome(knocked, "trusted", 0.31, has_frame=False, is_told=False),
        outcome(knocked, "trusted", 0.29, has_frame=True, num_axes_inside=5, is_told=False),
        outcome(knocked, "not_trusted", 5.0, has_frame=True, num_axes_inside=6, is_told=True),
        outcome("clouds in feet", "trusted", 5.0, is_told=False),
        outcome("clouds in feet", "trusted", 5.0, is_told=True),
        outcome("one frame 20 times", "trusted", 0.1, is_told=True),
        outcome("point labels shifted by 1", "failed", 0.0),
        outcome("good", "trusted", 9.0),
    ]
    rates = {rate.name: (rate.count, rate.n) for rate in spoiled_rates(outcomes)}
    assert rates["spoiled, trusted and wrong, 10 pairs or more"] == (1, 5)
    assert rates["the same, camera knocked"] == (1, 3)
    assert rates["knocked cameras, trusted at any pose"] == (2, 3)
    assert rates["knocked cameras named with their frame, within one"] == (2, 3)
    assert rates["the same, and the offset within its intervals"] == (1, 3)
    assert rates["axes of named offsets within their intervals"] == (11, 12)
    assert rates["clouds scaled, told or not trusted or right"] == (1, 2)
    assert rates["copies of a frame have its interval and verdict"] == (1, 1)
    table = kinds_markdown(outcomes, is_subtle=False)
    assert f"| {knocked} | 3 | 2 | 1 | 0 | 1 | 1 | 1 of 3 | - |" in table
    assert "0.31 deg, 0.0 cm" in table


def run_of(raw: RawDrive, found: Any, **more: Any) -> diagnosis.Run:
    return diagnosis.Run(raw, found, outcome("", "trusted", 1.0, **more))


def test_a_knock_is_told_with_its_frame_and_offset(raw: RawDrive, rng: np.random.Generator) -> None:
    knocked = spoiling.knocked(raw, rng, angle_deg=1.0, share=0.5)
    before, after = knocked.truths
    change = compare_poses(after, before)

    def stated(index: int, off_deg: float) -> SimpleNamespace:
        x_deg, *others_deg = change.rotation_xyz_deg
        rotation_deg = (-x_deg + off_deg, *(-each for each in others_deg))
        halves = {"half_width_95_camera_center_m": (0.01,) * 3, "half_width_95_rotation_deg": (0.1,) * 3}
        center_m = tuple(0.01 * x for x in change.camera_center_xyz_cm)
        moved = SimpleNamespace(camera_center_m=center_m, rotation_deg=rotation_deg, **halves)
        before, after = (
            SimpleNamespace(num_frames=index, moved=None),
            SimpleNamespace(num_frames=1, moved=moved),
        )
        return SimpleNamespace(parts=(before, after))

    for found, is_told, has_frame, inside in (
        (stated(2, 0.0), True, True, 6),
        (stated(3, 0.2), False, True, 5),
        (stated(0, 0.0), False, False, 6),
        (SimpleNamespace(parts=()), False, False, None),
        (CalibrationError("no overlap"), False, False, None),
    ):
        result = diagnosis.names_knock(run_of(knocked, found))
        assert (result.is_told, result.has_frame, result.num_axes_inside) == (is_told, has_frame, inside)


def test_scale_and_principal_point_are_told(raw: RawDrive) -> None:
    found = SimpleNamespace(uncertainty=None)
    assert diagnosis.names_scale(run_of(raw, found, notes="points may be in other units than metres")).is_told
    assert not diagnosis.names_scale(run_of(raw, found)).is_told
    # The error is one degree, and half the interval 0.2 degrees.
    assert not diagnosis.covers_intrinsics({"cx": 4.0}, run_of(raw, found)).is_told
    for cost_deg, is_told in ((0.19, False), (0.21, True)):
        cost = SimpleNamespace(camera_center_m=(0.0,) * 3, rotation_deg=(cost_deg,) * 3)
        found.uncertainty = SimpleNamespace(intrinsics_cost=SimpleNamespace(cx=cost, cy=cost))
        assert diagnosis.covers_intrinsics({"cx": 4.0}, run_of(raw, found)).is_told is is_told
        assert diagnosis.covers_intrinsics({"cx": 1.5, "cy": 2.5}, run_of(raw, found)).is_told is is_told


@pytest.mark.parametrize(
    ("alone", "widths", "is_told"),
    [("trusted", 1.0, True), ("trusted", 1.3, False), ("trusted", 0.7, False), ("not_trusted", 1.0, False)],
)
def test_copies_are_told_by_interval_and_verdict(
    raw: RawDrive, monkeypatch: pytest.MonkeyPatch, alone: str, widths: float, is_told: bool
) -> None:
    def calibration(status: str, half: float) -> SimpleNamespace:
        return SimpleNamespace(status=status, uncertainty=SimpleNamespace(half_widths=(half,) * 6))

    answer: Callable[[RawDrive], SimpleNamespace] = lambda raw: calibration(alone, 1.0)  # noqa: E731
    monkeypatch.setattr(diagnosis, "attempt", answer)
    assert diagnosis.matches_one_frame(run_of(raw, calibration("trusted", widths))).is_told is is_told


def test_only_some_parts_are_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trust_rates, "cases", lambda seeds, parts: [*map(str, parts)])
    monkeypatch.setattr(
        "semcal_cli.experiments.experiment.run_cases",
        lambda cases, *_: [replace(outcome("good", "trusted", 0.0), errors=(0.1,) * 6)] * len(cases),
    )
    found = CliRunner().invoke(
        semcal, ["experiment", "trust", "--only", "good", "--only", "verify", "-o", str(tmp_path)]
    )
    assert "| good drives are trusted, all | 2 | 2 |" in found.output
    found = CliRunner().invoke(semcal, ["experiment", "trust", "--only", "all", "-o", str(tmp_path)])
    assert found.exit_code == 2
