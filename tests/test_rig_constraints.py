"""Known transforms between cameras of a rig: what they add to the cameras alone, and wrong ones."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import Result
from commands import invoke
from conftest import NAMES, make_pose
from test_rig import exp, twist, with_pose

from semcal_cli.files.documents import read_document
from semcal_cli.geometry.poses import compare_poses, inverse
from semcal_cli.many.rig.adjustment import adjust
from semcal_cli.many.rig.rig_document import Constraint
from semcal_cli.result.calibration_document import CalibrationDocument, read_calibration

CAMERAS = "front", "left", "rear"
SIGMA_M, SIGMA_DEG = 2e-3, 0.02


def constraint(to: str, source: str, T: np.ndarray, by: float = 1.0) -> Constraint:
    entries = {"from": source, "to": to, "T_to_from": T.tolist()}
    return Constraint.model_validate(entries | {"sigma_m": by * SIGMA_M, "sigma_deg": by * SIGMA_DEG})


@pytest.fixture(scope="module")
def alone(rig_results: tuple[Result, Path]) -> CalibrationDocument:
    calibration = read_calibration(rig_results[1] / f"{NAMES[0]}.yaml")
    many = calibration.uncertainty.model_copy(update={"degrees_of_freedom": (1e4,) * 6})
    return calibration.model_copy(
        update={"status": "trusted", "reasons": (), "topics": (), "uncertainty": many}
    )


def poses_of_three(rng: np.random.Generator) -> dict[str, np.ndarray]:
    return {name: make_pose(rng.uniform(-2.0, 2.0, 3), rng.uniform(-1.0, 1.0, 3)) for name in CAMERAS}


def test_errors_after_the_adjustment_are_as_it_says(alone: CalibrationDocument) -> None:
    """Cameras and constraints err as they state; so do the adjusted poses, all three together, and by less."""
    rng = np.random.default_rng(3)
    truth = poses_of_three(rng)
    roots = {name: 1e-3 * rng.standard_normal((6, 6)) for name in CAMERAS}
    of_constraint = np.repeat([SIGMA_M, np.radians(SIGMA_DEG)], 3)
    squares, before, after = [], [], []
    for _ in range(300):
        cameras = {
            name: with_pose(alone, exp(root @ rng.standard_normal(6)) @ truth[name], root @ root.T)
            for name, root in roots.items()
        }
        pairs = [("front", "left"), ("rear", "left")]
        constraints = [
            constraint(
                to, source, exp(of_constraint * rng.standard_normal(6)) @ truth[to] @ inverse(truth[source])
            )
            for to, source in pairs
        ]
        adjustment, found = adjust(cameras, constraints)
        errors = [twist(found[name][0] @ inverse(truth[name])) for name in CAMERAS]
        squares.append(
            np.concatenate(errors) @ np.linalg.solve(np.array(adjustment.covariance), np.concatenate(errors))
        )
        before.append(sum(np.trace(root @ root.T) for root in roots.values()))
        after.append(np.trace(np.array(adjustment.covariance)))
        assert all(compared.is_kept for compared in adjustment.constraints)
    # Chi-square with 18 degrees of freedom: its mean, and the standard error of that.
    assert np.mean(squares) == pytest.approx(18.0, abs=4.0 * 6.0 / np.sqrt(300))
    assert np.mean(after) < 0.8 * np.mean(before)


def test_an_exact_constraint_is_met_and_a_vague_one_changes_nothing(alone: CalibrationDocument) -> None:
    rng = np.random.default_rng(4)
    truth, root = poses_of_three(rng), 1e-3 * rng.standard_normal((6, 6))
    cameras = {
        name: with_pose(alone, exp(root @ rng.standard_normal(6)) @ T, root @ root.T)
        for name, T in truth.items()
    }
    T = truth["front"] @ inverse(truth["left"])
    _, found = adjust(cameras, [constraint("front", "left", T, by=1e-4)])
    assert found["front"][0] @ inverse(found["left"][0]) == pytest.approx(T, abs=1e-6)
    assert np.array_equal(found["rear"][0], cameras["rear"].pose)
    _, found = adjust(cameras, [constraint("front", "left", T, by=1e3)])
    for name in CAMERAS:
        assert found[name][0] == pytest.approx(cameras[name].pose, abs=1e-5)


@pytest.mark.parametrize("seed", range(10))
def test_a_wrong_constraint_is_named_and_draws_nothing(alone: CalibrationDocument, seed: int) -> None:
    """Two of three are right. The wrong one is off by 2 degrees about a random axis."""
    rng = np.random.default_rng(seed)
    truth, root = poses_of_three(rng), 1e-3 * rng.standard_normal((6, 6))
    cameras = {
        name: with_pose(alone, exp(root @ rng.standard_normal(6)) @ T, root @ root.T)
        for name, T in truth.items()
    }
    axis = rng.standard_normal(3)
    wrong = exp(np.concatenate([np.zeros(3), np.radians(2.0) * axis / np.linalg.norm(axis)]))
    pairs = [("front", "left"), ("rear", "left"), ("front", "rear")]
    right = [constraint(to, source, truth[to] @ inverse(truth[source])) for to, source in pairs]
    place = seed % 3
    spoiled = list(right)
    spoiled[place] = constraint(*pairs[place], wrong @ np.array(right[place].T_to_from))
    adjustment, found = adjust(cameras, spoiled)
    assert [compared.is_kept for compared in adjustment.constraints] == [index != place for index in range(3)]
    _, expected = adjust(cameras, [each for index, each in enumerate(right) if index != place])
    for name in CAMERAS:
        assert found[name][0] == pytest.approx(expected[name][0], abs=1e-12)
    assert adjustment.constraints[place].rotation_deg == pytest.approx(2.0, abs=0.5)


def rig_with(rig: Path, folder: Path, constraints: list[dict]) -> Path:
    shutil.copytree(rig.parent, folder / "rig")
    path = folder / "rig/rig.yaml"
    path.write_text(yaml.safe_dump(yaml.safe_load(rig.read_text()) | {"constraints": constraints}))
    return path


def truth_of_pair(rig: Path) -> np.ndarray:
    first, second = (
        np.array(yaml.safe_load((rig.parent / name / "drive.yaml").read_text())["T_camera_lidar"])
        for name in NAMES
    )
    return first @ inverse(second)


def test_the_command_adjusts_the_cameras(rig: Path, tmp_path: Path) -> None:
    T = truth_of_pair(rig)
    entry = {"from": NAMES[1], "to": NAMES[0], "T_to_from": T.tolist(), "sigma_m": 1e-4, "sigma_deg": 1e-3}
    path = rig_with(rig, tmp_path, [entry])
    result = invoke("calibrate", path, "-o", tmp_path / "out", "--report", tmp_path / "page.html")
    assert result.exit_code in (0, 3), result.output
    document = read_document(tmp_path / "out/rig_calibration.yaml")
    cameras = [read_calibration(tmp_path / f"out/{name}.yaml") for name in NAMES]
    assert document["adjustment"]["cameras"] == list(NAMES)
    error = compare_poses(cameras[0].pose @ inverse(cameras[1].pose), T)
    assert (error.rotation_deg, error.camera_center_m) == pytest.approx((0.0, 0.0), abs=2e-3)
    of_stage = np.array(cameras[0].stages["adjusted"].T_camera_lidar)
    assert of_stage == pytest.approx(cameras[0].pose, abs=1e-12)
    # What was written is read again, with what ties the cameras.
    again = invoke("report", path, tmp_path / "out", "-o", tmp_path / "again.html")
    assert again.exit_code == 0, again.output
    assert (tmp_path / "again.html").read_text() == (tmp_path / "page.html").read_text()
