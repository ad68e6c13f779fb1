import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from conftest import make_pose, poses
from hypothesis import given, strategies as st

from semcal_cli.drive.camera import Camera
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.geometry.arrays import Pose
from semcal_cli.result.calibration_document import (
    CalibrationDocument,
    calibration_text,
    read_calibration,
    write_calibration,
)
from semcal_cli.result.sections import HeldOut, Hypothesis, Input, InputFrame, Quality, Settings, Stage
from semcal_cli.result.uncertainty import LabelBleed, Uncertainty

POSE = make_pose((0.1, -1.2, 0.3), (0.5, -0.0, -2.0))
UNCERTAINTY = Uncertainty(
    covariance=(1e-6 * np.eye(6)).tolist(),
    degrees_of_freedom=[30.0] * 6,
    sigma_camera_center_m=[0.001] * 3,
    sigma_translation_m=[0.0012] * 3,
    sigma_rotation_deg=[0.05] * 3,
    half_width_95_camera_center_m=[0.002] * 3,
    half_width_95_rotation_deg=[0.1] * 3,
    weak_directions=["in yaw: +- 0.59 degrees; add frames"],
    label_bleed=LabelBleed(camera_center_m=[0.003] * 3, rotation_deg=[0.02] * 3),
)
EXACT = 1e-12  # a few roundings of numbers up to 100


def make_calibration(T_camera_lidar: Pose, options: dict[str, Any] | None = None) -> CalibrationDocument:
    return CalibrationDocument.from_pose(
        T_camera_lidar,
        status="not_assessed",
        reasons=("no check applies: 1 frame",),
        quality=Quality(
            mutual_information_nats=np.float64(0.1),
            bias_nats=0.01,
            label_agreement=0.8,
            overlap=0.25,
            num_points=9,
            num_frames=1,
            runner_up_margin=3.5,
        ),
        hypotheses=(
            Hypothesis(
                T_camera_lidar=np.eye(4).tolist(),
                mutual_information_nats=1.0,
                bias_nats=0.01,
                sigma_nats=None,
                overlap=0.5,
                num_pairs=10,
                num_inliers=20,
                rotation_from_best_deg=0.0,
            ),
        ),
        stages={"initial": Stage(T_camera_lidar=np.eye(4).tolist(), mutual_information_nats=1e-5)},
        uncertainty=UNCERTAINTY,
        repeatability=None,
        polish=HeldOut(accepted=True, held_out_gain_nats=0.01, held_out_sigma_nats=None),
        input=Input(
            drive="drive.yaml",
            camera=Camera(model="fisheye", width=2, height=2, K=[[1, 0, 0], [0, 1, 0], [0, 0, 1]]),
            frames=[InputFrame(points="0.bin")],
            sha256={"0.bin": "0" * 64},
        ),
        settings=Settings(options=options or {}, seed=0, versions={"semcal": "0.1.0"}),
    )


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
@given(T=poses, options=st.dictionaries(st.text(), st.text() | st.floats(-1e308, 1e308)))
def test_round_trip(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, T: Pose, options: dict[str, Any]
) -> None:
    path = tmp_path_factory.getbasetemp() / f"calibration{suffix}"
    calibration = make_calibration(T, options)
    write_calibration(calibration, path)
    again = read_calibration(path)
    assert again == calibration
    assert calibration_text(again, "yaml") == calibration_text(calibration, "yaml")
    np.testing.assert_allclose(calibration.pose, T, atol=EXACT)
    assert calibration.quaternion_xyzw[3] >= 0.0


def test_yaml_is_the_design() -> None:
    text = calibration_text(make_calibration(np.eye(4)), "yaml")
    assert list(yaml.safe_load(text)) == [
        each.alias or name for name, each in CalibrationDocument.model_fields.items()
    ]
    assert text.startswith(
        "# yaml-language-server: $schema=https://semcal.readthedocs.io/schemas/semcal_calibration-1.schema.json\n"
        "semcal_calibration: 1\nstatus: not_assessed\nreasons:\n- 'no check applies: "
    )
    assert "\nT_camera_lidar:\n- [1.0, 0.0, 0.0, 0.0]\n- [0.0, 1.0, 0.0, 0.0]\n" in text
    assert "\nuncertainty:\n  covariance:\n  - [1.0e-06, 0.0, 0.0, 0.0, 0.0, 0.0]\n" in text
    assert "-0.0" not in text


@pytest.mark.parametrize(
    ("key", "value", "complaint"),
    [
        (
            "T_lidar_camera",
            POSE.tolist(),
            "found T_lidar_camera off by 3.18, expected the inverse of T_camera_lidar within 1e-06",
        ),
        (
            "translation_m",
            [0.5, 0.00001, -2.0],
            "found translation_m off by 1e-05, expected the translation of T_camera_lidar within 1e-06",
        ),
        (
            "quaternion_xyzw",
            [0.0, 0.0, 0.0, 1.0],
            "found quaternion_xyzw off by 0.562, expected the rotation of T_camera_lidar within 1e-06",
        ),
        ("quaternion_xyzw", [0.0, 0.0, 1.0], "quaternion_xyzw: found a list of 3, needed at least 4"),
        ("status", "fine", "status: found 'fine', expected 'trusted', 'not_trusted' or 'not_assessed'"),
        ("stages", {"a b": {}}, "stages['a b'].T_camera_lidar: found nothing, expected a value"),
        ("reason", [], "unknown key 'reason'; the nearest known key is 'reasons'"),
    ],
)
def test_wrong_value(tmp_path: Path, key: str, value: object, complaint: str) -> None:
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps(json.loads(calibration_text(make_calibration(POSE), "json")) | {key: value}))
    with pytest.raises(InputError) as error:
        read_calibration(path)
    assert str(error.value) == f"{path}: {complaint}"


def test_either_sign_of_the_quaternion_is_read(tmp_path: Path) -> None:
    document = json.loads(calibration_text(make_calibration(POSE), "json"))
    document["quaternion_xyzw"] = [-x for x in document["quaternion_xyzw"]]
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps(document))
    np.testing.assert_allclose(read_calibration(path).pose, POSE, atol=EXACT)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("{", "line 1: Expecting property name enclosed in double quotes"),
        ('{"a": NaN}', "found NaN, expected a finite number"),
        ('{"a": 1, "a": 2}', "key 'a' is given twice"),
        ("[" * 100000, "nested too deeply"),
    ],
)
def test_malformed_json(tmp_path: Path, content: str, complaint: str) -> None:
    path = tmp_path / "calibration.json"
    path.write_text(content)
    with pytest.raises(InputError) as error:
        read_calibration(path)
    assert str(error.value) == f"{path}: {complaint}"


@pytest.mark.parametrize(
    ("cues", "found"),
    [("x", "cues: 'x'"), ([], "cues: a list of 0"), ({"edges": {}, "auto": {}}, "cues auto, edges")],
)
def test_cues_that_there_are_not_are_refused(tmp_path: Path, cues: Any, found: str) -> None:
    document = yaml.safe_load(calibration_text(make_calibration(POSE), "yaml"))
    document["settings"]["options"]["cues"] = cues
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(document))
    with pytest.raises(InputError) as error:
        read_calibration(tmp_path / "c.yaml")
    needed = "settings of cues by their names, such as labels or edges"
    assert str(error.value) == f"{tmp_path / 'c.yaml'}: settings.options: found {found}, expected {needed}"


@pytest.mark.parametrize("T", [np.full((4, 4), np.nan), np.diag([1.0, 1.0, -1.0, 1.0])])
def test_no_calibration_without_a_pose(T: Pose) -> None:
    with pytest.raises(CalibrationError, match=r"^T_camera_lidar"):
        make_calibration(T)


def test_unknown_suffix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        write_calibration(make_calibration(POSE), tmp_path / "a.txt")
    assert str(error.value) == f"{tmp_path / 'a.txt'}: found suffix '.txt', expected .yaml, .yml, .json"


def test_failed_write_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("old")

    def full_disk(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full_disk)
    with pytest.raises(InputError, match=r"cannot be written: no space left on device$"):
        write_calibration(make_calibration(POSE), path)
    assert [file.name for file in tmp_path.iterdir()] == ["a.yaml"]
    assert path.read_text() == "old"
