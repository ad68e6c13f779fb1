"""Hostile transforms: files that `convert` and the other commands read a pose from."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from format_files import SENSORS, T_ANY, T_KIT_LIDAR, sensor
from hostile_commands import Hostile

RIGID = 1e-9
"""Largest error of a rotation that semcal computed."""


def kit(*names: str) -> Callable[[Path], object]:
    """Makes a sensor kit of Autoware's."""
    sensors = {name: sensor(T) for name, T in zip(names, (T_KIT_LIDAR @ T_ANY, T_KIT_LIDAR), strict=True)}
    return lambda folder: (folder / "kit.yaml").write_text(yaml.safe_dump({"kit_base_link": sensors}))


def table(folder: Path) -> None:
    """Makes a table of nuScenes', whose sensors have a token and a channel."""
    rows = [row | {"sensor_token": f"of {row['token']}"} for row in SENSORS]
    channels = [{"token": "of a", "channel": "CAM_FRONT"}, {"token": "of b", "channel": "LIDAR_TOP"}]
    (folder / "calibrated_sensor.json").write_text(json.dumps(rows))
    (folder / "sensor.json").write_text(json.dumps(channels))


def rounded(T: np.ndarray) -> np.ndarray:
    return np.round(T, 3)


def scaled(by: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda T: T * [[by, by, by, 1.0]]


def start(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], object]:
    """Makes a transform that is almost that of the drive, and almost rigid."""

    def make(folder: Path) -> None:
        T = np.array(yaml.safe_load((folder / "drive/drive.yaml").read_text())["T_camera_lidar"])
        document = {"semcal_transform": 1, "T_camera_lidar": change(T).tolist()}
        (folder / "T.yaml").write_text(yaml.safe_dump(document))

    return make


def is_rigid(folder: Path) -> None:
    """Asserts that every transform of a result is rigid."""
    made = folder / "out.yaml"
    found = list(transforms(yaml.safe_load((made if made.exists() else folder / ".stdout").read_text())))
    assert found
    for T in found:
        R = np.array(T)[:3, :3]
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=RIGID)


def transforms(document: Any) -> list[Any]:
    if isinstance(document, list):
        return [T for item in document for T in transforms(item)]
    if not isinstance(document, dict):
        return []
    inner = [T for key, value in document.items() if key != "T_camera_lidar" for T in transforms(value)]
    return [*inner, *([document["T_camera_lidar"]] if "T_camera_lidar" in document else [])]


NAME = r"^semcal: error: kit.yaml: found sensors {}; add --{} to name (one of them|the LiDAR's own)$"
READ = ("convert", "kit.yaml", "--to", "semcal")
TRANSFORMS: dict[str, Hostile] = {
    "a part of a word makes a camera no LiDAR": Hostile(
        kit("pos_camera", "gnss"), (*READ, "--frame", "optical"), NAME.format("gnss, pos_camera", "lidar")
    ),
    "a camera of a LiDAR's maker": Hostile(
        kit("hesai_cam", "gnss"), (*READ, "--frame", "optical"), NAME.format("gnss, hesai_cam", "camera")
    ),
    "a camera of a LiDAR's maker that is named": Hostile(
        kit("hesai_cam", "gnss"),
        (*READ, "--frame", "optical", "--camera", "hesai_cam"),
        NAME.format("gnss, hesai_cam", "lidar"),
    ),
    "a LiDAR named as the camera": Hostile(
        kit("camera0/camera_link", "velodyne_top"),
        (*READ, "--frame", "optical", "--camera", "velodyne_top"),
        NAME.format("camera0/camera_link, velodyne_top", "lidar"),
    ),
    "a camera named as the LiDAR": Hostile(
        kit("camera0/camera_link", "velodyne_top"),
        (*READ, "--lidar", "camera0/camera_link"),
        NAME.format("camera0/camera_link, velodyne_top", "camera"),
    ),
    "a token and a channel of one sensor": Hostile(
        table,
        ("convert", "calibrated_sensor.json", "--to", "semcal", "--camera", "b", "--lidar", "LIDAR_TOP"),
        "found one sensor as camera and LiDAR, 'b' and 'LIDAR_TOP', expected two sensors$",
    ),
    "the LiDAR's usual name for the camera": Hostile(
        lambda folder: None,
        ("convert", "drive", "--to", "tf2", "--to-camera", "lidar"),
        "--to-camera, --to-lidar: found 'lidar' for both, expected two names$",
    ),
}

WIDE = ("--max-rotation-deg", "5", "--max-translation-m", "1")
for how, change, command in (
    ("rounded to three decimals", rounded, ("verify", "drive", "T.yaml", "--json", *WIDE)),
    ("stretched by 1.0001", scaled(1.0001), ("refine", "drive", "--init", "T.yaml", "-o", "out.yaml")),
    ("stretched by 1.0004", scaled(1.0004), ("calibrate", "drive", "--init", "T.yaml", "-o", "out.yaml")),
):
    # The JSON of a verification has its verdict.
    told = "^$" if "--json" in command else "^verdict trusted: .*$"
    TRANSFORMS[f"a transform {how}, {command[0]}"] = Hostile(
        start(change), (*command, "--quiet"), told, exit_code=0, check=is_rigid
    )
