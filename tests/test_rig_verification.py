"""`semcal verify` for a rig: which transform is off, and whether one sensor that has moved explains all that are."""

import json
import re
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import junitparser
import numpy as np
import pytest
from click.testing import Result
from commands import invoke
from conftest import NAMES, SMALL, make_pose

from semcal_cli.config import Limits
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.files import point_clouds
from semcal_cli.files.documents import document_text, read_document
from semcal_cli.findings.symptoms import MOVED_SENSOR
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import apply_twist, local_coordinates, pose_at
from semcal_cli.many.rig.rig_document import LidarView
from semcal_cli.many.rig.rig_verification import RigVerification
from semcal_cli.pipeline.verdict import judge, judge_clock, together
from semcal_cli.pipeline.verification import Verification

PASS, FAILURE, USAGE, FAIL = 0, 1, 2, 3
MOVED = make_pose((0.0, 0.0, np.radians(0.9)), (0.03, 0.01, 0.0))
"""Displacement by 0.9 degrees and 3.2 cm."""
OTHERWISE = make_pose((np.radians(0.9), 0.0, 0.0), (0.0, 0.0, 0.0))
"""Another one, by 0.9 degrees about another axis."""
SIGMA_M, SIGMA_RAD = 2e-3, np.radians(0.02)
LIDARS = ("lidar", "rear")
STATED = {
    "front": make_pose((0.1, -1.2, 1.5), (0.3, -0.2, 0.1)),
    "left": make_pose((-0.8, 0.4, 1.0), (2.0, 0.3, -0.4)),
    "back": make_pose((1.1, 0.9, -2.0), (-0.7, 0.6, 0.5)),
}
"""T_camera_lidar of cameras."""
T_LIDAR_OTHER = {
    "lidar": np.eye(4),
    "rear": make_pose((0.1, -0.2, 2.5), (-1.5, 0.3, 0.2)),
    "top": make_pose((-0.3, 0.1, -1.0), (0.4, -0.2, 0.9)),
}


def verification(
    T_stated: Pose, T_found: Pose, clock_ms: float = 0.0, covariance: Any = None, freedom: float = 1e4
) -> Verification:
    """What `verify` says of a transform where the estimate has this covariance."""
    covariance = np.diag([SIGMA_M**2] * 3 + [SIGMA_RAD**2] * 3) if covariance is None else covariance
    half_widths, limits = [2.0 * SIGMA_M] * 3 + [2.0 * np.degrees(SIGMA_RAD)] * 3, Limits()
    error = compare_poses(T_stated, T_found)
    checks = (
        *judge(error.camera_center_xyz_m, error.rotation_xyz_deg, half_widths, limits),
        judge_clock(1e-3 * clock_ms, 1e-3, 5e-3),
    )
    verdict = together(check.verdict for check in checks)
    return Verification(verdict, checks, (), (), (), T_found, 0.0, False, None, covariance.tolist(), freedom)


def rig_of(
    moved: Mapping[str, Pose],
    lidars: tuple[str, ...] = LIDARS,
    rng: np.random.Generator | None = None,
    covariances: Mapping[str, Any] | None = None,
) -> RigVerification:
    """A rig whose sensors have moved: p_stated = T p_found in the frame of each."""
    rng = np.random.default_rng(7) if rng is None else rng
    views, stated, verifications = {}, {}, {}
    for lidar in lidars:
        for camera in STATED if covariances else ("front", "left"):
            name = camera if lidar == "lidar" else f"{camera}_on_{lidar}"
            views[name] = LidarView(camera, lidar, name)
            stated[name] = STATED[camera] @ T_LIDAR_OTHER[lidar]
            of_camera, of_lidar = (moved.get(sensor, np.eye(4)) for sensor in (camera, lidar))
            T = np.linalg.inv(of_camera) @ stated[name] @ of_lidar
            covariance = np.diag([SIGMA_M**2] * 3 + [SIGMA_RAD**2] * 3)
            covariance = covariance if covariances is None else covariances[name]
            noise = np.linalg.cholesky(covariance) @ rng.standard_normal(6)
            found = pose_at(T, noise)
            verifications[name] = verification(stated[name], found, covariance=covariance)
    return RigVerification(views, stated, verifications, {})


def is_near(T: Pose, T_truth: Pose, max_deg: float, max_cm: float) -> bool:
    error = compare_poses(T, T_truth)
    return error.rotation_deg < max_deg and error.camera_center_cm < max_cm


@pytest.mark.parametrize(
    ("moved", "lidars", "expected"),
    [
        ({}, LIDARS, []),
        ({"lidar": MOVED}, ("lidar",), ["lidar"]),
        ({"lidar": MOVED}, LIDARS, ["lidar"]),
        ({"rear": MOVED}, LIDARS, ["rear"]),
        ({"left": MOVED}, LIDARS, ["left"]),
        ({"left": MOVED}, ("lidar",), []),  # one transform alone
        ({"front": MOVED, "left": OTHERWISE}, ("lidar",), []),  # not as if the LiDAR had moved
        ({"front": MOVED, "left": OTHERWISE}, LIDARS, []),
        ({"lidar": MOVED, "rear": OTHERWISE}, LIDARS, []),  # nor one camera
        ({"lidar": MOVED, "front": OTHERWISE}, LIDARS, []),
    ],
)
def test_one_sensor_is_named_where_it_explains_exactly_what_fails(
    moved: Mapping[str, Pose], lidars: tuple[str, ...], expected: list[str]
) -> None:
    rig = rig_of(moved, lidars)
    assert [sensor.name for sensor in rig.moved_sensors] == expected
    for sensor in rig.moved_sensors:
        truth = next(iter(moved.values()))
        assert is_near(sensor.T_stated_found, truth, 0.1, 1.0)
        assert re.search(
            r"moved by 3\.\d\d \+- 0\.\d\d cm and 0\.\d{3} \+- 0\.0\d\d degrees", sensor.sentence
        )


@pytest.mark.parametrize("moved", ["lidar", "front"])
def test_a_moved_sensor_is_named_as_often_as_chance_allows_and_its_intervals_hold(moved: str) -> None:
    """Three transforms of a LiDAR, or of a camera, whose covariances differ by axis and from one another."""
    rng, num_named, num_held, num_rigs = np.random.default_rng(5), 0, 0, 300
    lidars = ("lidar",) if moved == "lidar" else ("lidar", "rear", "top")
    for _ in range(num_rigs):
        names = [*STATED, *(f"{camera}_on_{lidar}" for lidar in lidars[1:] for camera in STATED)]
        roots = rng.standard_normal((len(names), 6, 6)) * ([[SIGMA_M]] * 3 + [[SIGMA_RAD]] * 3)
        covariances = {name: root @ root.T / 2.0 for name, root in zip(names, roots, strict=True)}
        rig = rig_of({moved: MOVED}, lidars, rng, covariances)
        for sensor in rig.moved_sensors:
            num_named += 1
            (xi,) = local_coordinates([sensor.T_stated_found], MOVED)
            num_held += np.count_nonzero(np.abs(xi) < 1.96 * np.sqrt(np.diag(sensor.covariance)))
    assert num_named / num_rigs == pytest.approx(0.95, abs=0.04)
    assert num_held / (6 * num_named) == pytest.approx(0.95, abs=0.02)


@pytest.mark.parametrize("left_open", ["inconclusive", "failed"])
def test_no_sensor_is_named_where_others_are_not_known_to_hold(left_open: str) -> None:
    """What carries both cameras has moved, but only one LiDAR shows it."""
    bracket = {camera: STATED[camera] @ MOVED @ np.linalg.inv(STATED[camera]) for camera in ("front", "left")}
    rig = rig_of(bracket)
    seen = {name: found for name, found in rig.verifications.items() if name.endswith("rear")}
    if left_open == "failed":
        others = dict.fromkeys(rig.verifications.keys() - seen.keys(), "no image")
        assert RigVerification(rig.views, rig.stated, seen, others).moved_sensors == ()
        return
    unknown = {
        name: replace(
            found,
            verdict="inconclusive",
            checks=tuple(check.not_judged(is_trusted=False) for check in found.checks),
        )
        for name, found in rig.verifications.items()
        if name not in seen
    }
    assert RigVerification(rig.views, rig.stated, seen | unknown, {}).moved_sensors == ()


def test_few_degrees_of_freedom_widen_the_interval() -> None:
    rig = rig_of({"lidar": MOVED}, ("lidar",))
    few = {name: replace(found, degrees_of_freedom=4.0) for name, found in rig.verifications.items()}
    (sensor,), (of_few,) = rig.moved_sensors, RigVerification(rig.views, rig.stated, few, {}).moved_sensors
    widths = [float(re.findall(r"\+- ([\d.]+)", each.sentence)[0]) for each in (sensor, of_few)]
    assert widths[1] / widths[0] == pytest.approx(2.776 / 1.96, rel=0.03)


def test_displacements_are_weighted_and_their_interval_holds_the_truth() -> None:
    """A transform that is hardly known takes no part."""
    rig = rig_of({"lidar": MOVED}, ("lidar",))
    front, left = rig.verifications.values()
    vague = np.diag([1.0] * 3 + [0.1] * 3).tolist()
    T_left = apply_twist(left.T_camera_lidar, np.array([0.5, -0.3, 0.2, 0.05, 0.02, -0.04]))
    rough = replace(left, T_camera_lidar=T_left, covariance=vague)
    both = RigVerification(rig.views, rig.stated, {"front": front, "left": rough}, {})
    (sensor,) = both.moved_sensors
    T_by_front = np.linalg.inv(rig.stated["front"]) @ front.T_camera_lidar
    assert sensor.T_stated_found == pytest.approx(T_by_front, abs=1e-4)
    (of_both,) = rig.moved_sensors
    assert (np.diag(of_both.covariance) < np.diag(sensor.covariance)).all()


def test_a_late_clock_is_no_displacement() -> None:
    rig = rig_of({}, ("lidar",))
    late = {
        name: verification(rig.stated[name], found.T_camera_lidar, clock_ms=30.0)
        for name, found in rig.verifications.items()
    }
    of_clock = RigVerification(rig.views, rig.stated, late, {})
    assert (of_clock.verdict, of_clock.moved_sensors) == ("fail", ())


def test_a_transform_without_a_verdict_fails_the_rig() -> None:
    rig = rig_of({"lidar": MOVED}, ("lidar",))
    (name, found), (other, _) = rig.verifications.items()
    failed = RigVerification(rig.views, rig.stated, {name: found}, {other: "no image"})
    assert (failed.verdict, failed.moved_sensors) == ("failed", ())
    assert failed.failure == f"1 of 2 cameras could not be verified; {other}: no image"
    assert failed.deciding == f"{other}, of 2 cameras"


def verify(*arguments: object) -> Result:
    return invoke("verify", *arguments, "-q")


def with_transforms(rig: Path, folder: Path, transforms: Mapping[str, Pose]) -> Path:
    """Write a copy of a rig whose drives state other transforms."""
    shutil.copytree(rig.parent, folder)
    for name, T in transforms.items():
        file = folder / name / "drive.yaml"
        file.write_text(document_text(read_document(file) | {"T_camera_lidar": T.tolist()}, "yaml"))
    return folder


def stated(rig: Path) -> dict[str, Pose]:
    return {
        name: np.array(read_document(rig.parent / name / "drive.yaml")["T_camera_lidar"]) for name in NAMES
    }


def test_a_rig_that_holds_passes_and_each_sweep_is_read_once(
    rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[Path] = []
    original = point_clouds.read_point_clouds

    def counting(files: list[tuple[Path, Path | None]], *others: Any) -> Any:
        read.extend(points.resolve() for points, _ in files)
        return original(files, *others)

    monkeypatch.setattr(point_clouds, "read_point_clouds", counting)
    images = tmp_path / "images"
    found = verify(rig, "--max-rotation-deg", 0.5, "--overlay", images)
    assert found.exit_code == PASS, found.output
    assert found.stdout.endswith("[rig]\nverdict          pass: 2 cameras\n")
    assert len(read) == len(set(read)) == SMALL.num_frames
    assert {path.parent.name for path in images.glob("*/*.png")} == {*NAMES}


def test_the_camera_that_is_off_is_named(rig: Path, tmp_path: Path) -> None:
    other = with_transforms(rig, tmp_path / "rig", {NAMES[1]: MOVED @ stated(rig)[NAMES[1]]})
    found = verify(other, "--max-rotation-deg", 0.5, "--junit", tmp_path / "junit.xml")
    assert found.exit_code == FAIL, found.output
    assert found.stdout.endswith("[rig]\nverdict          fail: camera_1, of 2 cameras\n")
    (suite,) = junitparser.JUnitXml.fromfile(str(tmp_path / "junit.xml"))
    failed = [case.name for case in suite if any(isinstance(r, junitparser.Failure) for r in case.result)]
    assert {name.partition(" ")[0] for name in failed} == {"camera_1:"}


def test_a_displaced_lidar_is_found(rig: Path, tmp_path: Path) -> None:
    """The stated transforms are those of a LiDAR that has moved since."""
    before = {name: T @ np.linalg.inv(MOVED) for name, T in stated(rig).items()}
    found = verify(with_transforms(rig, tmp_path / "rig", before), "--max-rotation-deg", 0.5, "--json")
    assert found.exit_code == FAIL
    document = json.loads(found.stdout)
    assert [each["verdict"] for each in document["transforms"].values()] == ["fail", "fail"]
    (moved,) = document["moved_sensors"]
    assert moved["kind"] == "only_lidar"
    assert document["topics"] == [MOVED_SENSOR]
    assert is_near(np.array(moved["T_stated_found"]), MOVED, 0.2, 1.5)


def test_the_files_that_a_result_names_are_verified(
    rig: Path, rig_results: tuple[Result, Path], tmp_path: Path
) -> None:
    """On the drives that they were calibrated from, results cannot be confirmed; other transforms are not asked."""
    other = with_transforms(rig, tmp_path / "rig", {name: np.eye(4) for name in NAMES})
    results = tmp_path / "results"
    shutil.copytree(rig_results[1], results)
    (results / "camera_0.yaml").rename(results / "night.yaml")
    file = results / "rig_calibration.yaml"
    file.write_text(file.read_text().replace("calibration: camera_0.yaml", "calibration: night.yaml"))
    for result in (results, file):
        document = json.loads(verify(other, result, "--json").stdout)
        assert document["verdict"] == "inconclusive"
        for transform in document["transforms"].values():
            assert any("check it on another drive" in reason for reason in transform["reasons"])


def test_a_camera_that_fails_stops_no_other_and_is_an_error_for_ci(rig: Path, tmp_path: Path) -> None:
    other = with_transforms(rig, tmp_path / "rig", {})
    shutil.rmtree(other / NAMES[0] / "image_labels")
    junit = tmp_path / "junit.xml"
    found = verify(other, "--max-rotation-deg", 0.5, "--json", "--junit", junit)
    assert isinstance(found.exception, CalibrationError)
    assert str(found.exception).startswith("1 of 2 cameras could not be verified; camera_0: ")
    document = json.loads(found.stdout)
    assert document["verdict"] == document["transforms"][NAMES[0]]["verdict"] == "failed"
    assert document["transforms"][NAMES[1]]["verdict"] == "pass"
    (suite,) = junitparser.JUnitXml.fromfile(str(junit))
    assert (suite.failures, suite.errors) == (0, 1)
    shown = verify(other, "--max-rotation-deg", 0.5).stdout
    assert "[camera_0]\nfailed " in shown
    assert shown.endswith("verdict          failed: camera_0, of 2 cameras\n")


@pytest.mark.parametrize(
    "place",
    [
        "rig/camera_1/images/000000.png",
        "rig/camera_1/image_labels/000000.png",
        "rig/camera_1/drive.yaml",
        "results/rig_calibration.yaml",
        "results/camera_1.yaml",
        "rig/rig.yaml",
    ],
)
def test_no_input_is_replaced(
    rig: Path, rig_results: tuple[Result, Path], tmp_path: Path, place: str
) -> None:
    shutil.copytree(rig.parent, tmp_path / "rig")
    shutil.copytree(rig_results[1], tmp_path / "results")
    file = tmp_path / place
    before = file.read_bytes()
    found = verify(tmp_path / "rig", tmp_path / "results", "--junit", file)
    assert str(found.exception) == f"{file}: found a file that this run reads or writes; choose another name"
    assert file.read_bytes() == before


def test_what_is_wrong_is_said_before_the_work(
    rig: Path, rig_results: tuple[Result, Path], tmp_path: Path
) -> None:
    other = with_transforms(rig, tmp_path / "rig", {})
    file = other / NAMES[1] / "drive.yaml"
    file.write_text(document_text({**read_document(file), "T_camera_lidar": None}, "yaml"))
    missing = verify(other).exception
    assert isinstance(missing, InputError)
    assert str(missing) == (
        f"{other}/rig.yaml: found no transform of camera_1 to verify; `semcal verify {other}/rig.yaml RESULTS` takes "
        "those that `semcal calibrate` wrote"
    )
    (tmp_path / "taken").write_text("")
    for words, complaint in (
        ((rig_results[1] / "camera_0.yaml",), "found one transform for camera_0 and camera_1"),
        (("--overlay", tmp_path / "taken"), "found a file, expected a folder for images"),
    ):
        assert complaint in str(verify(rig, *words).exception)
    (tmp_path / "team.yaml").write_text("semcal_options: 1\nverify: {report: page.html}\n")
    for option in (
        ("--config", tmp_path / "team.yaml"),
        ("--report", tmp_path / "a.html"),
        ("--direction", "lidar-to-camera"),
        ("--camera", "front"),
        ("--frames", "0:2"),
    ):
        usage = verify(rig, *option)
        assert usage.exit_code == USAGE, usage.output
