"""Known transforms between cameras of a rig: what they add to the cameras alone, and wrong ones."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import Result
from commands import invoke
from conftest import NAMES, make_pose
from rigs import exp, twist, with_pose

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
        assert all(compared.is_explained for compared in adjustment.constraints)
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
    _, found = adjust(cameras, [constraint("front", "left", T, by=1e-3)])
    assert found["front"][0] @ inverse(found["left"][0]) == pytest.approx(T, abs=1e-5)
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
    assert [compared.is_explained for compared in adjustment.constraints] == [
        index != place for index in range(3)
    ]
    _, expected = adjust(cameras, [each for index, each in enumerate(right) if index != place])
    for name in CAMERAS:
        assert found[name][0] == pytest.approx(expected[name][0], abs=1e-12)
    assert adjustment.constraints[place].rotation_deg == pytest.approx(2.0, abs=0.5)


@pytest.mark.parametrize("place", range(3))
def test_a_slightly_wrong_one_of_a_loop_is_found_in_any_place(alone: CalibrationDocument, place: int) -> None:
    """Half a degree, where the cameras are known to a few hundredths, by four parts of the images."""
    rng = np.random.default_rng(7)
    truth, sigma = poses_of_three(rng), np.repeat([2e-3, np.radians(0.05)], 3)
    few = alone.uncertainty.model_copy(update={"degrees_of_freedom": (4.0,) * 6})
    alone = alone.model_copy(update={"uncertainty": few})
    cameras = {
        name: with_pose(alone, exp(sigma * rng.standard_normal(6)) @ T, np.diag(sigma**2))
        for name, T in truth.items()
    }
    pairs = [("front", "left"), ("rear", "left"), ("front", "rear")]
    wrong = exp(np.array([0.0, 0.0, 0.0, 0.0, np.radians(0.5), 0.0]))
    constraints = [
        constraint(to, source, (wrong if index == place else np.eye(4)) @ truth[to] @ inverse(truth[source]))
        for index, (to, source) in enumerate(pairs)
    ]
    adjustment, _ = adjust(cameras, constraints)
    assert [compared.is_explained for compared in adjustment.constraints] == [
        index != place for index in range(3)
    ]


def test_errors_that_cameras_share_do_not_average_out(alone: CalibrationDocument) -> None:
    """By another cue than labels: twins that are tied are known as well as either, and vague ties change nothing."""
    edges = alone.settings.model_copy(update={"options": {**alone.settings.options, "cues": {"edges": {}}}})
    alone = alone.model_copy(update={"settings": edges})
    covariance = np.diag(np.repeat([1e-2, np.radians(0.1)], 3) ** 2)
    cameras = {name: with_pose(alone, np.eye(4), covariance) for name in ("front", "left")}
    for by, expected in ((0.01, 1.0), (1e3, 1.0), (0.3, 1.0)):
        _, found = adjust(cameras, [constraint("front", "left", np.eye(4), by)])
        widths = np.array(found["front"][1].covariance).diagonal() / covariance.diagonal()
        assert widths == pytest.approx(expected, abs=0.02)
    labels = {
        name: camera.model_copy(update={"settings": camera.settings.model_copy(update={"options": {}})})
        for name, camera in cameras.items()
    }
    _, found = adjust(labels, [constraint("front", "left", np.eye(4), 0.01)])
    assert np.array(found["front"][1].covariance).diagonal() / covariance.diagonal() == pytest.approx(
        0.5, abs=0.01
    )


def test_a_camera_that_is_not_trusted_takes_no_part(alone: CalibrationDocument) -> None:
    rng = np.random.default_rng(5)
    truth, root = poses_of_three(rng), 1e-3 * rng.standard_normal((6, 6))
    cameras = {name: with_pose(alone, T, root @ root.T) for name, T in truth.items()}
    cameras["rear"] = cameras["rear"].model_copy(update={"status": "not_trusted", "reasons": ("why",)})
    adjustment, found = adjust(cameras, [constraint("front", "rear", np.eye(4))])
    assert (adjustment.constraints, adjustment.skipped, [*found]) == (
        (),
        (("front", "rear"),),
        ["front", "left"],
    )


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
    file = tmp_path / "out/rig_calibration.yaml"
    for changes, complaint in (
        ({"covariance": [[1.0]]}, "a covariance of another size"),
        ({"covariance": np.diag([-1.0, *[1.0] * 11]).tolist()}, "a symmetric one with a positive diagonal"),
        ({"covariance": np.triu(np.ones((12, 12))).tolist()}, "a symmetric one with a positive diagonal"),
        ({"cameras": [NAMES[0]] * 2}, "each sensor once"),
        ({"cameras": ["a", "b"]}, "expected those of"),
    ):
        damaged = document | {"adjustment": document["adjustment"] | changes}
        file.write_text(yaml.safe_dump(damaged))
        result = invoke("report", path, tmp_path / "out", "-o", tmp_path / "damaged.html")
        assert complaint in str(result.exception), result.output
    wrong = document["adjustment"]["constraints"][0] | {"largest": 1e-9}
    file.write_text(
        yaml.safe_dump(document | {"adjustment": document["adjustment"] | {"constraints": [wrong]}})
    )
    assert invoke("report", path, tmp_path / "out", "-o", tmp_path / "wrong.html").exit_code in (0, 3)
    assert "The cameras contradict a constraint" in (tmp_path / "wrong.html").read_text()
    file.write_text(yaml.safe_dump(document))
    assert (tmp_path / "again.html").read_text() == (tmp_path / "page.html").read_text()
