"""Writes a small valid file of each kind for the fuzz targets to start from, by the tests' own generators."""

from __future__ import annotations

import hashlib
import io
import json
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import yaml

TESTS = Path(__file__).parents[1]
CORPUS = Path(__file__).parent / "corpus"
sys.path.insert(0, str(TESTS))

import camera_infos  # noqa: E402
import dataset_trees  # noqa: E402
import fleets  # noqa: E402
from conftest import DRIVE  # noqa: E402
from format_files import FILES, KIT, ROBOT, SENSORS, T_ANY  # noqa: E402
from targets import IMPORTS, RESULT, VERSION  # noqa: E402
from test_calibration import POSE, make_calibration  # noqa: E402

from semcal_cli.config import Limits  # noqa: E402
from semcal_cli.fleet.combination import combine_drives  # noqa: E402
from semcal_cli.fleet.record import describe_fleet  # noqa: E402
from semcal_cli.result.calibration import Calibration, calibration_text  # noqa: E402
from semcal_cli.result.uncertainty import Uncertainty  # noqa: E402

FULL_DRIVE = """
semcal_drive: 1
camera:
  model: thin_prism
  width: 64
  height: 32
  K: [[50.0, 0.0, 31.5], [0.0, 51.0, 15.5], [0.0, 0.0, 1.0]]
  distortion: [-0.1, 0.2, 0.001, 0.002, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
  intrinsics_sigma: {fx: 0.5, cy: 1}
lidar: {channels: 64, columns: 1024, fov_up_deg: 10.0, fov_down_deg: -30.0}
frames:
- points: points/0.bin
  point_labels: labels/0.label
  image_labels: labels/0.png
  image: images/0.png
  points_stamp: 12.30
  image_stamp: 12.31
  point_features: f/0.npy
  image_features: g/0.npy
- {points: points/1.bin}
ignore: {points: [0], image: [255]}
classes:
  points: {road: [40, 44], car: [10, 252]}
  image: {road: [0], car: [13]}
palette: {road: [128, 64, 128]}
motion: {twist: {linear_m_s: [1, 0, 0], angular_rad_s: [0, 0, 0.1]}}
T_camera_lidar: [[0, -1, 0, 0.1], [0, 0, -1, 0.2], [1, 0, 0, 0.3], [0, 0, 0, 1]]
"""
SPHERE_DRIVE = """{"semcal_drive": 1, "camera": {"model": "double_sphere", "width": 64, "height": 32,
"K": [[50, 0, 31.5], [0, 50, 15.5], [0, 0, 1]], "parameters": {"xi": -0.2, "alpha": 0.6}},
"frames": [{"points": "0.bin"}], "motion": {"poses": "poses.txt", "point_times": "absolute"}}
"""
RIG = """
semcal_rig: 1
cameras: {left: left/drive.yaml, right: right}
T_camera_camera:
  left: {right: [[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}
"""
POSES = """# stamp x y z qx qy qz qw
1.0 0 0 0 0 0 0 1
1.1 0.5 0.1 0 0 0 0.0998334 0.9950042
1.2, 1.0, 0.2, 0, 0, 0, 0.1986693, 0.9800666
"""
ONTOLOGY = """
ignore: [0]
classes:
  road: {ids: [1, 2], color: [128, 64, 128]}
  car: {ids: [10]}
"""
KITTI_POSES = "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 0.9\n1 0 0 0.1 0 1 0 0 0 0 1 1.8\n"
KITTI_CALIB = (
    "P0: 5 0 3 0 0 5 2 0 0 0 1 0\nP2: 5 0 3 1 0 5 2 0 0 0 1 0\nTr: 0 -1 0 0.1 0 0 -1 0.2 1 0 0 0.3\n"
)
PLY = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty int semantic\n"
    b"element face 0\nproperty list uchar int i\nend_header\n" + bytes(8)
)


PICTURE_CARD = """
semcal_picture_model: 1
size: [1024, 512]
fit: tiles
color: bgr
scale: 0.5
mean: [0.4, 0.5, 0.6]
std: [0.2]
layout: channels_last
output: y
kind: logits
align_corners: true
classes: {road: [0], car: [13, 14]}
ignore: [255]
"""
POINT_CARD = """
semcal_point_model: 1
rows: 64
columns: 2048
elevation_deg: [-25.0, 3.0]
azimuth_deg: [45.0, -45.0]
row_by: ring
outside: drop
channels: [range, x, mask]
mean: [12.1, 10.9, 0]
std: [12.3, 11.5, 1]
empty: -1
intensity_scale: 0.1
neighbors: {count: 3, search: 7, sigma_px: 2.0, max_difference_m: 0.5}
classes: [road, car]
"""


def save(target: str, name: str, content: str | bytes) -> None:
    """Keep a file for a target."""
    path = CORPUS / target / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)


def seed_results() -> None:
    """Write calibrations, the result of a fleet, and what a batch keeps."""
    uncertainty = Uncertainty.from_covariance(POSE, 1e-6 * np.diag(np.arange(1.0, 7.0)), np.full(6, 30.0))
    calibration = make_calibration(POSE, {"a": [1, None, "x"]}).model_copy(
        update={"status": "trusted", "uncertainty": uncertainty}
    )
    save("calibration", "whole.yaml", calibration_text(calibration, "yaml"))
    save("calibration", "whole.json", json.dumps(calibration.model_dump()))
    save("fleet", "fleet.json", json.dumps(fleet_document()))
    outcome = outcome_of(calibration)
    save("summary", "three", "".join(json.dumps(outcome | {"drive": name}) + "\n" for name in "ab") + FAILED)
    save("summary", "fleet", "".join(map(fleet_line, range(6))))
    asked = {"drive": "drive", "path": "drive", "command": "calibrate", "arguments": []}
    record = {
        "semcal_record": 1,
        "asked": asked | {"version": VERSION.decode()},
        "timed_out_s": None,
        "outcome": outcome | {"drive": "drive", "result": "drive/calibration.yaml"},
        "result": {"size": len(RESULT), "mtime_ns": 1, "sha256": hashlib.sha256(RESULT).hexdigest()},
        "files": {"missing": None},
    }
    save("record", "whole.json", json.dumps(record))
    gone = {"size": 1, "mtime_ns": 2, "sha256": "0" * 64}
    save("record", "changed.json", json.dumps(record | {"files": {"/missing": gone}}))
    failed = json.loads(FAILED) | {"drive": "drive"}
    save(
        "record", "failed.json", json.dumps(record | {"outcome": failed, "result": None, "timed_out_s": 5.0})
    )
    save("verification", "pass.json", json.dumps(VERIFICATION))


VERIFICATION = {
    "verdict": "pass",
    "checks": [{"name": "x", "value": 0.1, "half_width": 0.01, "limit": 0.2, "verdict": "pass"}],
    "reasons": ["none"],
    "notes": [],
    "T_camera_lidar": T_ANY.tolist(),
}
FAILED = json.dumps(
    {
        **{"drive": "c", "status": "failed", "exit_code": 1, "reasons": ["no such file"], "stamp": None},
        **dict.fromkeys(
            ("T_camera_lidar", "covariance", "mutual_information_nats", "camera", "result"), None
        ),
    }
)


def outcome_of(calibration: Calibration) -> Mapping[str, object]:
    """The line of a calibration in a summary."""
    assert calibration.uncertainty is not None
    return {
        "drive": "a",
        "status": "trusted",
        "exit_code": 0,
        "reasons": [],
        "stamp": 1.7e9,
        "T_camera_lidar": calibration.T_camera_lidar,
        "covariance": calibration.uncertainty.covariance,
        "mutual_information_nats": 0.7,
        "camera": "0123456789abcdef",
        "result": None,
    }


def fleet_line(index: int) -> str:
    """A line of the summary of drives that scatter."""
    member = fleets.series_of("change", 24)[3 * index + 4]
    assert member.T_camera_lidar is not None
    assert member.covariance is not None
    line = outcome_of(make_calibration(POSE)) | {
        "drive": member.drive,
        "stamp": member.stamp,
        "T_camera_lidar": np.round(member.T_camera_lidar, 5).tolist(),
        "covariance": member.covariance.tolist(),
        "result": f"{member.drive}/calibration.yaml",
    }
    return json.dumps(line, separators=(",", ":")) + "\n"


def fleet_document() -> dict[str, object]:
    """The result of a fleet, without the parts for readers."""
    whole = describe_fleet(combine_drives(fleets.series_of("still", 6), Limits()), {})
    return {name: whole[name] for name in ("semcal_fleet", *LISTED)}


LISTED = ("status", "T_camera_lidar", "T_lidar_camera", "translation_m", "quaternion_xyzw", "uncertainty")


def seed_transforms() -> None:
    """Write a file of each format of transforms, and the variants that the tests know."""
    for label, (name, text, _) in FILES.items():
        target, _, variant = label.partition(", ")
        save(f"transform-{target}", f"{(variant or 'usual').replace(' ', '-')}{Path(name).suffix}", text)
    array = io.BytesIO()
    np.save(array, T_ANY)
    save("transform-npy", "usual.npy", array.getvalue())
    save(
        "transform-semcal", "bare.yaml", yaml.dump({"semcal_transform": 1, "T_camera_lidar": T_ANY.tolist()})
    )
    save("transform-semcal", "drive.yaml", FULL_DRIVE)
    save("transform-semcal", "fleet.json", json.dumps(fleet_document()))
    save("transform-kitti-odometry", "four.txt", KITTI_CALIB)
    save("transform-urdf", "robot.urdf", ROBOT)
    save("transform-autoware", "kit.json", json.dumps(KIT))
    save("transform-nuscenes", "sensors.json", json.dumps(SENSORS, indent=1))


def seed_others() -> None:
    """Write drives, rigs, cameras, poses and lists."""
    save("drive", "small.yaml", DRIVE)
    save("drive", "full.yaml", FULL_DRIVE)
    save("drive", "sphere.json", SPHERE_DRIVE)
    save("rig", "pair.yaml", RIG)
    save("rig", "pair.json", '{"cameras": {"a": "a", "b": "b"}, "semcal_rig": 1}')
    save("poses", "three.txt", POSES)
    save("ontology", "two.yaml", ONTOLOGY)
    save("ontology", "names.yaml", "road: [1, 2]\ncar: [10]\n")
    save("card", "picture.yaml", PICTURE_CARD)
    save("card", "points.yaml", POINT_CARD)
    save("list", "three.txt", "# of today\nb/2\n\n./a/drive.yaml\r\n/x\n")
    save("ply", "window.ply", PLY)
    for name in ("ROS", "ROS_MESSAGE", "ROS_ECHO", "KALIBR", "OPENCV"):
        save("intrinsics", f"{name.lower()}.yaml", getattr(camera_infos, name))
    for name in ("ROS", "ROS_MESSAGE", "ROS_ECHO"):
        save("camera-info", f"{name.lower()}.yaml", getattr(camera_infos, name))
    save("intrinsics", "opencv.xml", camera_infos.OPENCV_XML)
    save("intrinsics", "mei.yaml", dataset_trees.KITTI_360_FISHEYE)


def seed_imports() -> None:
    """Write the calibration files of the data sets."""
    for name, (dataset, file, _) in IMPORTS.items():
        with tempfile.TemporaryDirectory() as folder:
            dataset_trees.TREES[dataset](Path(folder))
            path = Path(folder) / file
            save(f"import-{name}", f"usual{path.suffix}", path.read_bytes() if path.exists() else KITTI_POSES)


if __name__ == "__main__":
    seed_results()
    seed_transforms()
    seed_others()
    seed_imports()
