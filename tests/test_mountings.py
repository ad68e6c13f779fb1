"""Mountings that the search leaves open, decided by the refinement."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from semcal_cli.config import CalibrationConfig, InitializationConfig, RefinementConfig
from semcal_cli.estimation.refine.pyramid import Refinement
from semcal_cli.estimation.search.mounting_search import Initialization, with_best
from semcal_cli.events import ignore
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.pipeline import initialize, refine
from semcal_cli.pipeline.mountings import resolve_mountings


@pytest.fixture(scope="session")
def street(fine_street: Path) -> Path:
    """Few points have too few edges."""
    return fine_street


@pytest.fixture(scope="module")
def data(street: Path) -> LoadedDrive:
    return load(street, CalibrationConfig(cues=("segments", "edges")))


@pytest.fixture(scope="module")
def found(data: LoadedDrive) -> Initialization:
    return initialize(data, InitializationConfig())


def test_the_right_mounting_is_taken_though_another_led(
    data: LoadedDrive, found: Initialization, street_truth: Pose
) -> None:
    other = found.hypotheses[1]
    led = with_best(found, other, data.searched_by)
    wrong = replace(led, hypotheses=led.hypotheses[:2])
    again = partial(refine, data, config=RefinementConfig())
    start = again(other.T_camera_lidar)
    assert compare_poses(start.T_camera_lidar, street_truth).rotation_deg > 10.0
    initial, refined, is_clear = resolve_mountings(data, wrong, start, again, 0, ignore)
    assert compare_poses(refined.T_camera_lidar, street_truth).rotation_deg < 0.15
    assert compare_poses(initial.T_camera_lidar, street_truth).rotation_deg < 3.0
    assert is_clear


def test_a_mounting_that_another_explains_as_well_stays_doubted(
    data: LoadedDrive, found: Initialization
) -> None:
    best = found.hypotheses[0]
    twins = (best, *(replace(best, rotation_from_best_deg=90.0) for _ in range(2)))
    refined = refine(data, best.T_camera_lidar, RefinementConfig())
    asked: list[Pose] = []

    def again(T_camera_lidar: Pose) -> Refinement:
        asked.append(T_camera_lidar)
        return refined

    twin = replace(found, hypotheses=twins)
    _, same, is_clear = resolve_mountings(data, twin, refined, again, 0, ignore)
    assert same is refined
    assert not is_clear
    assert len(asked) == 1, "the first that stays unclear decides"
