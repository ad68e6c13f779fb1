"""The paper's method as published: it comes back, adds nothing of ours, and recognises a wrong mounting."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import invoke

from semcal_cli import core
from semcal_cli.config import CalibrationConfig
from semcal_cli.config.paper_config import PaperConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.estimation.search.registration import Candidate
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.observations.reading import read_observations
from semcal_cli.pipeline import paper
from semcal_cli.pipeline.paper import calibrate_as_published
from semcal_cli.result.calibration_document import read_calibration

CLEAN_DEG, CLEAN_CM = 0.15, 3.0
"""Error of the paper's method on the clean street, a few times what it is."""
RAW = CalibrationConfig(is_raw=True)


@pytest.fixture(scope="module")
def data(street: Path) -> LoadedDrive:
    return load(street, RAW)


def turned_about(T: Pose, angle_deg: float) -> Pose:
    """Turn the mounting about the LiDAR's z axis."""
    angle = np.radians(angle_deg)
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return T @ turn


def test_comes_back_from_nothing(data: LoadedDrive, street_truth: Pose) -> None:
    found = calibrate_as_published(data, RAW, PaperConfig())
    error = compare_poses(found.pose, street_truth)
    assert error.rotation_deg < CLEAN_DEG
    assert error.camera_center_cm < CLEAN_CM
    assert found.status == "not_assessed"
    assert list(found.stages) == ["initial", "refined"]
    start = compare_poses(np.array(found.stages["initial"].T_camera_lidar), street_truth)
    assert start.camera_center_cm > 10.0  # PnP's pose as it is.
    bound = found.stages["refined"].bound_nats
    assert bound is not None
    assert 0.5 * found.quality.mutual_information_nats < bound < found.quality.mutual_information_nats + 0.05
    assert found.stages["initial"].bound_nats is None
    assert found.uncertainty is None
    assert found.polish is None


def test_a_given_pose_replaces_algorithm_2(data: LoadedDrive, street_truth: Pose) -> None:
    T_init = displace(street_truth, 3.0, 0.3, np.random.default_rng(0))
    found = calibrate_as_published(data, RAW, PaperConfig(), initial_pose=InitialPose(T_init, "off"))
    assert found.stages["initial"].T_camera_lidar == tuple(map(tuple, T_init.tolist()))
    assert found.hypotheses == ()
    assert compare_poses(found.pose, street_truth).rotation_deg < CLEAN_DEG


def test_a_wrong_mounting_is_recognised(
    data: LoadedDrive, street_truth: Pose, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The registration prefers a mounting that looks elsewhere; the right one is among its other placements."""
    wrong, right = (
        turned_about(street_truth, 120.0),
        displace(street_truth, 3.0, 0.3, np.random.default_rng(1)),
    )
    monkeypatch.setattr(paper, "register", lambda *_: [Candidate(wrong, 9, 9), Candidate(right, 9, 9)])
    found = calibrate_as_published(data, RAW, PaperConfig())
    assert found.status == "not_trusted"
    assert any("degrees away explains the labels better, by " in reason for reason in found.reasons), (
        found.reasons
    )


def test_nothing_of_ours_is_added(
    data: LoadedDrive, street_truth: Pose, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No edge band, no removal of hidden points, and no exact mutual information that a pose ascends."""
    seen: list[tuple[object, object]] = []
    anchored = core.AnchoredPoints

    def spy(*arguments: object, **settings: object) -> core.AnchoredPoints:
        seen.append((arguments[0], settings["visible_only"]))
        return anchored(*arguments, **settings)  # type: ignore[arg-type]

    def forbidden(*_: object, **__: object) -> None:
        raise AssertionError("not of the paper")

    monkeypatch.setattr("semcal_cli.estimation.refine.mine.core.AnchoredPoints", spy)
    for name in ("align", "polish", "despeckle"):
        monkeypatch.setattr(core, name, forbidden)
    few = PaperConfig(mine=replace(PaperConfig().mine, steps_per_level=4, warm_up_steps=4))
    calibrate_as_published(data, RAW, few)
    assert len(seen) > 4
    assert {*seen} == {(data.observations.without_edge_band.core, False)}


def test_isolated_pixels_stay(data: LoadedDrive, street: Path) -> None:
    as_read, cleaned = read_observations(read_drive(street)), load(street)
    assert cleaned.observations.speckle > 0.0
    pairs = zip(data.observations.images, as_read.images, strict=True)
    assert all(np.array_equal(found.classes, expected.classes) for found, expected in pairs)


def test_a_run_that_still_drifts_has_not_settled(data: LoadedDrive, street_truth: Pose) -> None:
    T_init = displace(street_truth, 5.0, 0.5, np.random.default_rng(0))
    hasty = replace(PaperConfig().mine, steps_per_level=8, final_rate=1.0, learning_rate_pose=2.0)
    found = calibrate_as_published(
        data, RAW, PaperConfig(mine=hasty), initial_pose=InitialPose(T_init, "off")
    )
    assert found.status == "not_trusted"
    assert any("had not settled" in reason for reason in found.reasons), found.reasons


FAST = ("--mine-steps", "4", "--mine-warm-up", "4", "--quiet")


def test_the_command_writes_the_bound_and_its_settings(street: Path, tmp_path: Path) -> None:
    out = tmp_path / "paper.yaml"
    found = invoke("calibrate", street, "--method", "paper", *FAST, "--mine-units", 8, "-o", out)
    assert found.exit_code in (0, 3), found.output
    written = read_calibration(out)
    assert written.stages["refined"].bound_nats is not None
    options = written.settings.options
    assert options["initialization"]["zoom"] == "paper"  # type: ignore[index, call-overload]
    mine = options["paper"]["mine"]  # type: ignore[index, call-overload]
    assert (mine["steps_per_level"], mine["num_hidden"], mine["edge_band_px"]) == (4, 8, 0)  # type: ignore[index, call-overload]


def test_raw_intensity_is_refined_from_a_start(street: Path, tmp_path: Path) -> None:
    out = tmp_path / "pmi.yaml"
    found = invoke(
        "calibrate",
        *(street, "--method", "paper", "--cue", "intensity", "--init", street),
        *FAST,
        "--max-frames",
        1,
        "-o",
        out,
    )
    assert found.exit_code in (0, 3), found.output
    assert list(read_calibration(out).stages) == ["initial", "refined"]
