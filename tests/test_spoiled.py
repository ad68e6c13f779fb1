"""Calibrations of spoiled drives: what they say of the spoiling, and what is counted of them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trust
from conftest import STREET
from laboratory import diagnosis, spoiled, spoiling
from laboratory.outcomes import BAD, SHARED, Case, Outcome
from laboratory.raw_drive import RawDrive, write_raw_drive
from laboratory.rigs import RIGS
from trust import PARTS, kinds_markdown, spoiled_rates, subtle_rates

from semcal_cli.drive.document import read_drive
from semcal_cli.errors import CalibrationError
from semcal_cli.experiments import drives
from semcal_cli.experiments.drives import Pool
from semcal_cli.experiments.experiment_run import Experiment
from semcal_cli.geometry.poses import compare_poses

pytestmark = pytest.mark.slow


def outcome(kind: str, status: str, error_deg: float, **more: Any) -> Outcome:
    errors = (0.0, 0.0, 0.0, 0.0, error_deg, 0.0)
    return Outcome(kind, 0, "default", 10, 0.1, status, "", errors, (0.1,) * 6, (0.2,) * 6, **more)


OFF = outcome("", "trusted", 1.0)
"""One degree off."""


def test_every_seed_is_spoiled_in_every_way() -> None:
    cases = trust.cases(range(100, 103), ["spoiled", "subtle"])
    assert len(cases) == len(set(cases)) == 3 * len(spoiled.KINDS)
    assert {case.kind for case in trust.cases(range(100, 103), ["good", "bad"])} == {
        "good",
        "mine",
        SHARED,
        *BAD,
    }
    assert sum(case.kind in spoiled.KINDS for case in trust.cases(range(100, 110), PARTS)) == 2 * len(
        spoiled.KINDS
    )
    subtle = trust.cases(range(100, 103), ["subtle"])
    assert subtle == [case for case in cases if spoiled.KINDS[case.kind].is_subtle]
    assert {case.num_pairs for case in subtle} == {1, 4, 10, 20}


def test_spoiled_drives_end_to_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drives, "NUM_FRAMES", 2)
    monkeypatch.setattr(spoiled, "NUM_FRAMES", 2)
    rigs = list(RIGS)
    seed = 6 * 7 + rigs.index("default")
    monkeypatch.setitem(RIGS, "default", {"width": STREET.width, "height": STREET.height})
    pools = Pool(tmp_path / "pool"), Pool(tmp_path / "pool_with_images", has_images=True)
    kinds = {
        "half of the frames turned by 3 degrees": 2,
        "two mountings, 1 degree apart": 2,
        "one frame 20 times": 2,
        "clouds in feet": 1,
        "points labelled from images through a wrong transform": 2,
        "f wrong by 1 %, by segments": 2,
    }
    monkeypatch.setitem(
        spoiled.KINDS,
        "one frame 20 times",
        replace(
            spoiled.KINDS["one frame 20 times"], spoil=lambda raw, rng: spoiling.one_frame_again(raw, rng, 2)
        ),
    )
    found = [trust.run(*pools, Case(kind, seed, num_pairs, 0.0))[0] for kind, num_pairs in kinds.items()]
    assert [each.kind for each in found] == list(kinds)
    assert {each.status for each in found} <= {"trusted", "not_trusted", "failed"}
    assert [each.has_frame for each in found[:2]] == [True, True]
    assert [each.status for each in found[:2]] == ["not_trusted", "not_trusted"]
    assert found[2].is_told
    assert found[4].status == "not_trusted"
    assert found[4].is_told
    assert found[5].status == "not_trusted"  # of two frames


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
    assert rates["clouds scaled, reported or not trusted or right"] == (1, 2)
    assert rates["copies of a frame have its interval and verdict"] == (1, 1)
    table = kinds_markdown(outcomes, is_subtle=False)
    assert f"| {knocked} | 3 | 2 | 1 | 0 | 1 | 1 | 1 of 3 | - |" in table
    assert "0.31 deg, 0.0 cm" in table


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
        result = diagnosis.names_knock(knocked, found, OFF)
        assert (result.is_told, result.has_frame, result.num_axes_inside) == (is_told, has_frame, inside)


def test_scale_and_principal_point_are_told(raw: RawDrive) -> None:
    found = SimpleNamespace(uncertainty=None)
    assert diagnosis.names_scale(raw, found, replace(OFF, notes="points may be in other units")).is_told
    assert not diagnosis.names_scale(raw, found, OFF).is_told
    # The error is one degree, and half the interval 0.2 degrees.
    assert not diagnosis.covers_intrinsics({"cx": 4.0}, raw, found, OFF).is_told
    for cost_deg, is_told in ((0.19, False), (0.21, True)):
        cost = SimpleNamespace(camera_center_m=(0.0,) * 3, rotation_deg=(cost_deg,) * 3)
        found.uncertainty = SimpleNamespace(intrinsics_cost=SimpleNamespace(cx=cost, cy=cost))
        assert diagnosis.covers_intrinsics({"cx": 4.0}, raw, found, OFF).is_told is is_told
        assert diagnosis.covers_intrinsics({"cx": 1.5, "cy": 2.5}, raw, found, OFF).is_told is is_told


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
    assert diagnosis.matches_one_frame(raw, calibration("trusted", widths), OFF).is_told is is_told


def test_only_some_parts_are_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = [replace(outcome("good", "trusted", 0.0), errors=(0.1,) * 6)]
    monkeypatch.setattr(trust, "cases", lambda seeds, parts: parts)
    monkeypatch.setattr(Experiment, "run_cases", lambda experiment, *_: found * len(experiment.cases))
    printed = [*trust.main(only=("good", "verify"), output=tmp_path)]
    assert any(line.startswith("| good drives are trusted, all | 2 | 2 |") for line in printed)


def test_users_give_no_more_than_they_know(raw: RawDrive, tmp_path: Path) -> None:
    assert raw.drive.camera.intrinsics_sigma is not None
    for number, (name, keys, has_sigma) in enumerate(
        (
            ("images 30 ms late at 10 m/s", {"point_labels", "image_labels", "image"}, True),
            ("a good drive, by segments", {"image_labels"}, True),
            ("f wrong by 1 %", {"point_labels", "image_labels", "image"}, False),
            ("label images shifted by 8 px", {"point_labels", "image_labels"}, False),
            ("label images cropped by 8 px, by segments", {"image_labels"}, False),
        )
    ):
        (folder := tmp_path / str(number)).mkdir()
        drive = read_drive(write_raw_drive(spoiled.withhold_unstated(spoiled.KINDS[name], raw), folder))
        assert set(drive.frames[0].model_dump(exclude_none=True)) == {"points", *keys}
        assert len([*folder.iterdir()]) == 1 + len(drive.frames) * (1 + len(keys))
        assert (drive.camera.intrinsics_sigma is not None) == has_sigma
        assert drive.T_camera_lidar is None
        assert drive.motion is None


def test_rates_of_subtle_faults() -> None:
    late, leak = (
        "images 30 ms late at 10 m/s",
        "points labelled from images through a wrong transform",
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
        "images late": (3, 3, 1, 5),
        "intrinsics slightly wrong": (2, 1, 1, 2),
        "leaked labels": (1, 1, 1, 2),
    }.items():
        names = (
            "trusted, outside the interval",
            "the same, not reported",
            "the same, beyond 0.3 degrees or 6 cm",
        )
        assert [rates[f"{group}: {name}"] for name in names] == [(count, counts[3]) for count in counts[:3]]
    assert rates["leaked labels are reported"] == (1, 2)
    assert rates["good drives by segments are trusted"] == (1, 3)
    assert rates["good drives by segments are trusted, of those within 0.3 degrees and 6 cm"] == (1, 2)
    assert rates["good drives by segments, trusted: axes in the 95 % interval"] == (6, 6)
    table = kinds_markdown(outcomes, is_subtle=True)
    assert f"| {late} | 5 | 4 | 1 | 0 | - | 3 | 3 | 1 | 0.31 deg, 0.0 cm | 16 of 18 |" in table
    assert "| f wrong by 1 % | 2 | 2 | 0 | 0 | 1 | 2 | 1 | 1 | 0.90 deg, 0.0 cm | 10 of 12 |" in table
    assert spoiled_rates(outcomes)[0].n == 0
    assert kinds_markdown(outcomes, is_subtle=False) == ""
    assert kinds_markdown([outcome("clouds in feet", "trusted", 0.0)], is_subtle=True) == ""
