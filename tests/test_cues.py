"""Two cues observe the same frames: what is taken or held out of a drive is taken or held out of both."""

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from conftest import SMALL_DRIVE

from semcal_cli.api.calls import calibrate
from semcal_cli.checks.few_scenes import FEW_SCENES
from semcal_cli.config import (
    AdjustmentConfig,
    CalibrationConfig,
    CueName,
    PolishConfig,
    RefinementConfig,
    SensitivityConfig,
)
from semcal_cli.estimation.adjust.joint import fit_jointly
from semcal_cli.estimation.refine.polish import split
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.estimation.uncertainty.sensitivity import sensitivity
from semcal_cli.formats import read_transform
from semcal_cli.observations import observations
from semcal_cli.observations.cues.cue_table import find_cue, policy_of
from semcal_cli.observations.frame_selection import few_frames
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.observations.observations import NO_CLASS, Observations
from semcal_cli.synthetic.synthesis import synthesize

PAIRS: tuple[tuple[CueName, CueName], ...] = (("labels", "segments"), ("segments", "intensity"))
COUNTS = (5, 8)
"""Numbers of frames: too few to hold out whole ones, and enough; no multiple of three."""
WRONG_FOCAL = 1.08
NEAR_FOCAL = 0.01
"""Share by which a focal length may be off that was estimated from one that is 8 % too long."""

Case = tuple[tuple[CueName, CueName], int]
CASES: list[Case] = list(product(PAIRS, COUNTS))


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """Drives by their numbers of frames; tests do not write to them."""
    folder = tmp_path_factory.mktemp("cues")
    for count in COUNTS:
        synthesize(replace(SMALL_DRIVE, num_frames=count), folder / str(count))
    return {count: folder / str(count) for count in COUNTS}


def loaded(drives: dict[int, Path], case: Case) -> LoadedDrive:
    cues, count = case
    return load(drives[count], CalibrationConfig(cues=cues))


def frames_of(part: Observations, whole: Observations, cue: int) -> list[int]:
    """Frames of the whole that a part holds by one cue."""
    of_whole = whole.of_cue(cue).frame_observations
    return [of_whole.index(each) for each in part.of_cue(cue).frame_observations]


@pytest.mark.parametrize(
    ("cues", "refined", "checked_by", "searched_by", "is_near", "min_scenes"),
    [
        (("labels",), ("labels",), "labels", None, False, 1),
        (("segments",), ("segments",), "segments", "segments", False, 1),
        (("edges",), ("edges",), "edges", None, True, 4),
        (("intensity",), ("intensity",), "intensity", None, False, 1),
        (("labels", "segments"), ("labels", "segments"), "labels", "labels", False, 1),
        (("labels", "edges"), ("labels", "edges"), "labels", "labels", False, 1),
        (("labels", "intensity"), ("labels", "intensity"), "labels", None, False, 1),
        (("segments", "edges"), ("edges",), "edges", "segments", True, 4),
        (("segments", "intensity"), ("segments", "intensity"), "intensity", "segments", False, 1),
        (("edges", "intensity"), ("edges", "intensity"), "edges", None, True, 4),
        (("labels", "segments", "edges"), ("labels", "edges"), "labels", "labels", False, 1),
    ],
)
def test_what_cues_state_together(
    cues: tuple[CueName, ...],
    refined: tuple[CueName, ...],
    checked_by: CueName,
    searched_by: CueName | None,
    is_near: bool,
    min_scenes: int,
) -> None:
    policy = policy_of(cues)
    assert policy.refined == refined
    assert (policy.checked_by, policy.searched_by) == (checked_by, searched_by)
    assert policy.needs_near_start == is_near
    assert policy.can_find_mounting == (not is_near or "segments" in cues)
    assert max(policy.wanting_scenes.values(), default=1) == min_scenes
    assert policy.has_label_bleed == ({*cues} <= {"labels", "segments"})
    assert (policy.starts is None) == ("labels" in cues)


def test_edges_state_the_limit_of_their_check() -> None:
    assert find_cue("edges").min_scenes == FEW_SCENES.limit()


@pytest.mark.parametrize("case", CASES, ids=str)
def test_both_cues_hold_out_the_same(drives: dict[int, Path], case: Case) -> None:
    whole = loaded(drives, case).observations
    assert (whole.num_frames, whole.num_cues) == (case[1], 2)
    kept, held_out = split(whole, PolishConfig())
    if case[1] == 8:
        for part, frames in ((kept, [0, 1, 3, 4, 6, 7]), (held_out, [2, 5])):
            assert [frames_of(part, whole, cue) for cue in (0, 1)] == [frames, frames]
        return
    assert (kept.num_frames, held_out.num_frames) == (5, 5)
    places = [
        np.any(
            [each.images[frame + 5 * cue].classes != NO_CLASS for frame in range(5) for cue in (0, 1)], axis=0
        )
        for each in (kept, held_out)
    ]
    assert all(place.any() for place in places)
    assert not np.logical_and(*places).any()


def test_few_frames_are_the_same_of_both_cues(
    drives: dict[int, Path],
) -> None:
    whole = loaded(drives, (("labels", "intensity"), 8)).observations
    few = few_frames(whole, 3)
    assert [frames_of(few, whole, cue) for cue in (0, 1)] == [[0, 4, 7], [0, 4, 7]]
    assert few.frame_indices.tolist() == [0, 1, 2, 0, 1, 2]


def test_scenes_are_told_by_frame(drives: dict[int, Path]) -> None:
    data = loaded(drives, (("labels", "intensity"), 8))
    twice = data.of_frames([0, 1, 2, 1]).observations
    assert twice.scenes == [0, 1, 2, 1]
    found = sensitivity(twice, read_transform(drives[8]), SensitivityConfig())
    assert found is not None
    once = sensitivity(data.of_frames([0, 1, 2]).observations, read_transform(drives[8]), SensitivityConfig())
    assert once is not None
    assert found.num_squares == once.num_squares
    assert len(found.scores) > len(once.scores)


def test_frames_are_compared_once(drives: dict[int, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """Where they are chosen, moved, or seen by another camera, scenes stay."""
    data = loaded(drives, (("labels", "intensity"), 8)).of_frames([3, 1, 3])
    monkeypatch.setattr(observations, "alike_frames", None)
    seen = data.observations
    farther = [cloud.with_points(cloud.points + np.float32(1.0)) for cloud in seen.clouds]
    moved = replace(seen.with_clouds(farther), camera=seen.camera.zoomed(1.1))
    for each in (seen, moved, data.of_cue("intensity"), data.unrolled(np.eye(4)).observations):
        assert each.scenes == [0, 1, 0]
    assert moved.of_frames([1, 2, 0]).scenes == [0, 1, 1]


@pytest.mark.parametrize("case", [(pair, 8) for pair in PAIRS], ids=str)
def test_a_wrong_focal_length_with_two_cues(drives: dict[int, Path], case: Case) -> None:
    data, truth = loaded(drives, case), read_transform(drives[case[1]])
    wrong = replace(data.observations, camera=data.observations.camera.zoomed(WRONG_FOCAL))
    found = fit_jointly(wrong, truth, AdjustmentConfig(("fx", "fy")), PolishConfig())
    assert found.camera is not None
    # What segments and intensities tell of so few and small images is not always enough.
    assert found.is_kept or "labels" not in case[0]
    if found.is_kept:
        focal = found.camera.intrinsics["fx"]
        assert focal.half_width_95 is not None
        off = abs(focal.found * WRONG_FOCAL / focal.given - 1.0)
        assert off <= max(NEAR_FOCAL, focal.half_width_95 / focal.given)


def test_a_whole_calibration_of_intrinsics_with_two_cues(drives: dict[int, Path]) -> None:
    """From the truth: what follows the search is looked at."""
    cues, refinement = ("labels", "intensity"), RefinementConfig(jointly=AdjustmentConfig(("fx", "fy")))
    start = InitialPose(read_transform(drives[8]), "the truth")
    found = calibrate(drives[8], CalibrationConfig(cues=cues, refinement=refinement), initial_pose=start)
    assert found.polish is not None
    assert found.uncertainty is not None
