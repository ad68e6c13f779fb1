"""Rounding of transforms is removed once, where they are read; what a program wrote stays as it is."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import make_pose, poses
from hypothesis import given
from test_calibration import make_calibration

from semcal_cli.fleet.fleet_drives import _Line
from semcal_cli.formats import read_extrinsic, read_transform, write_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import as_transform, check_rigid, inverse, orthonormal, quaternion_xyzw
from semcal_cli.result.calibration_document import (
    CalibrationDocument,
    calibration_text,
    read_calibration,
    write_calibration,
)

POSE = make_pose((0.7, -1.1, 0.4), (0.31, -0.52, 0.17))
ROUNDED, STRETCHED = np.round(POSE, 3), POSE * [[1.0001, 1.0001, 1.0001, 1.0]]
RIGID = 1e-14  # a few roundings of numbers up to 1


def error_of(T: Any) -> float:
    R = np.array(T)[:3, :3]
    return float(np.abs(R @ R.T - np.eye(3)).max())


def document_of(T: Pose) -> dict[str, Any]:
    """A calibration whose forms of the pose agree as they are stated."""
    document = json.loads(calibration_text(make_calibration(POSE), "json"))
    document |= {"T_camera_lidar": T.tolist(), "T_lidar_camera": inverse(T).tolist()}
    document |= {"translation_m": T[:3, 3].tolist(), "quaternion_xyzw": quaternion_xyzw(T).tolist()}
    document["stages"]["initial"]["T_camera_lidar"] = T.tolist()
    document["hypotheses"][0]["T_camera_lidar"] = T.tolist()
    return document


@given(T=poses)
def test_what_semcal_writes_is_read_back_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, T: Pose
) -> None:
    folder, written = tmp_path_factory.getbasetemp(), make_calibration(T).pose
    write_transform(written, folder / "T.yaml", "semcal")
    write_calibration(make_calibration(T), folder / "c.json")
    for name in ("T.yaml", "c.json"):
        assert read_transform(folder / name).tobytes() == (written + 0.0).tobytes()
    for each in (as_transform(written, "T"), orthonormal(written)):
        assert each.tobytes() == written.tobytes()


@pytest.mark.parametrize("T", [ROUNDED, STRETCHED])
def test_rounding_is_removed_once(T: Pose, tmp_path: Path) -> None:
    check_rigid(T)
    assert error_of(T) > 1e-4
    found = as_transform(T.tolist(), "T")
    assert error_of(found) < RIGID
    np.testing.assert_array_equal(found[:, 3], T[:, 3])
    np.testing.assert_array_equal(as_transform(found, "T"), found)
    (tmp_path / "T.json").write_text(json.dumps({"semcal_transform": 1, "T_camera_lidar": T.tolist()}))
    np.testing.assert_array_equal(read_transform(tmp_path / "T.json"), found)


@pytest.mark.parametrize("T", [ROUNDED, STRETCHED])
def test_a_calibration_that_is_read_is_rigid_in_every_form(T: Pose, tmp_path: Path) -> None:
    """Forms are compared as they are stated, and made from one pose after that."""
    (tmp_path / "c.json").write_text(json.dumps(document_of(T)))
    found, expected = read_calibration(tmp_path / "c.json"), orthonormal(T)
    for pose in (found.pose, found.T_camera_lidar, read_transform(tmp_path / "c.json")):
        np.testing.assert_array_equal(pose, expected)
    assert read_extrinsic(tmp_path / "c.json").record == found
    np.testing.assert_array_equal(found.T_lidar_camera, inverse(expected))
    assert np.linalg.norm(found.quaternion_xyzw) == pytest.approx(1.0, abs=RIGID)
    for part in (found.stages["initial"], found.hypotheses[0]):
        assert error_of(part.T_camera_lidar) < RIGID
    assert CalibrationDocument.model_validate(json.loads(calibration_text(found, "json"))) == found


def test_a_line_of_a_summary_is_rigid() -> None:
    line = {
        "drive": "a",
        "status": "trusted",
        "exit_code": 0,
        "reasons": [],
        "stamp": None,
        "result": "a/c.yaml",
    }
    line |= {
        "T_camera_lidar": ROUNDED.tolist(),
        "covariance": None,
        "camera": "a",
        "mutual_information_nats": 1.0,
    }
    assert error_of(_Line.model_validate(line).T_camera_lidar) < RIGID
