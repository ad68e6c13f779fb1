"""`semcal verify` for a rig: which camera is off, and whether its LiDAR is instead."""

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import junitparser
import numpy as np
import pytest
from click.testing import Result
from commands import invoke
from conftest import NAMES, SMALL, make_pose

from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.files import point_clouds
from semcal_cli.files.documents import document_text, read_document
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses

PASS, FAIL, INCONCLUSIVE = 0, 3, 4
TURNED = make_pose((0.0, 0.0, np.radians(0.9)), (0.03, 0.01, 0.0))
"""Displacement by 0.9 degrees and 3.2 cm."""


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
    truth = stated(rig)
    other = with_transforms(rig, tmp_path / "rig", {NAMES[1]: TURNED @ truth[NAMES[1]]})
    found = verify(other, "--max-rotation-deg", 0.5, "--junit", tmp_path / "junit.xml")
    assert found.exit_code == FAIL, found.output
    assert found.stdout.endswith("[rig]\nverdict          fail: camera_1, of 2 cameras\n")
    (suite,) = junitparser.JUnitXml.fromfile(str(tmp_path / "junit.xml"))
    failed = [case.name for case in suite if any(isinstance(r, junitparser.Failure) for r in case.result)]
    assert {name.partition(" ")[0] for name in failed} == {"camera_1:"}


def test_a_displaced_lidar_is_told_from_displaced_cameras(rig: Path, tmp_path: Path) -> None:
    """The stated transforms are those of a LiDAR that has moved since."""
    now = TURNED
    other = with_transforms(
        rig, tmp_path / "rig", {name: T @ np.linalg.inv(now) for name, T in stated(rig).items()}
    )
    limits = ("--max-rotation-deg", 0.5)
    document = json.loads(verify(other, *limits, "--json").stdout)
    assert [camera["verdict"] for camera in document["cameras"].values()] == ["fail", "fail"]
    (displaced,) = document["displaced_lidars"]
    error = compare_poses(np.array(displaced["T_stated_found"]), now)
    assert (error.rotation_deg, error.camera_center_cm) < (0.2, 1.5)
    found = verify(other, *limits)
    assert found.exit_code == FAIL
    assert "explains all its cameras: look at its mount first" in " ".join(found.stdout.split())


def test_the_results_of_a_rig_are_verified(
    rig: Path, rig_results: tuple[Result, Path], tmp_path: Path
) -> None:
    """On the drives that they were calibrated from, results cannot be confirmed; other transforms are not asked."""
    other = with_transforms(rig, tmp_path / "rig", {name: np.eye(4) for name in NAMES})
    for result in (rig_results[1], rig_results[1] / "rig_calibration.yaml"):
        document = json.loads(verify(other, result, "--json").stdout)
        assert document["verdict"] == "inconclusive"
        for camera in document["cameras"].values():
            assert any("check it on another drive" in reason for reason in camera["reasons"])


def test_a_camera_that_fails_stops_no_other(rig: Path, tmp_path: Path) -> None:
    other = with_transforms(rig, tmp_path / "rig", {})
    shutil.rmtree(other / NAMES[0] / "image_labels")
    found = verify(other, "--max-rotation-deg", 0.5, "--json", "--junit", tmp_path / "junit.xml")
    assert isinstance(found.exception, CalibrationError)
    assert str(found.exception).startswith("1 camera could not be verified; camera_0: ")
    cameras = json.loads(found.stdout)["cameras"]
    assert [cameras[name]["verdict"] for name in NAMES] == ["failed", "pass"]
    (suite,) = junitparser.JUnitXml.fromfile(str(tmp_path / "junit.xml"))
    assert suite.failures == 1


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
    assert "found no key semcal_rig_calibration" in str(
        verify(rig, rig_results[1] / "camera_0.yaml").exception
    )
    assert "found a file that this run reads" in str(
        verify(rig, "--junit", rig.parent / "camera_0/drive.yaml").exception
    )
    for option in (("--report", tmp_path / "a.html"), ("--direction", "lidar-to-camera")):
        usage = verify(rig, *option)
        assert (usage.exit_code, "is for one camera" in usage.stderr) == (2, True), usage.stderr
    assert "--frames, --exclude: found a rig" in verify(rig, "--frames", "0:2").stderr
