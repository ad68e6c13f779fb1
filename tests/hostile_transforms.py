"""Hostile transforms: files that `convert` and the other commands read a pose from, or write one into."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from format_files import SENSORS, T_ANY, T_KIT_LIDAR, sensor
from hostile_commands import Hostile

NUMBER = re.compile(rb"-?\d+\.\d+(e[-+]\d+)?")
"""A number with a point, as all of a transform have."""
RIGID = 1e-9
"""Largest error of a rotation that semcal computed."""
ROW, LAST = "[1.0, 0.5, 0.5, 0.5]", "[0.0, 0.0, 0.0, 1.0]"


def beside(name: str, content: bytes) -> Callable[[Path], object]:
    """Makes a file, and a copy of it that no command knows."""

    def make(folder: Path) -> None:
        for each in (folder / name, folder / "copy"):
            each.write_bytes(content)

    return make


def kit(*names: str) -> Callable[[Path], object]:
    """Makes a sensor kit of Autoware's."""
    sensors = {name: sensor(T) for name, T in zip(names, (T_KIT_LIDAR @ T_ANY, T_KIT_LIDAR), strict=True)}
    return beside("kit.yaml", yaml.safe_dump({"kit_base_link": sensors}).encode())


def table(folder: Path) -> None:
    """Makes a table of nuScenes', whose sensors have a token and a channel."""
    rows = [row | {"sensor_token": f"of {row['token']}"} for row in SENSORS]
    channels = [{"token": "of a", "channel": "CAM_FRONT"}, {"token": "of b", "channel": "LIDAR_TOP"}]
    beside("calibrated_sensor.json", json.dumps(rows).encode())(folder)
    (folder / "sensor.json").write_text(json.dumps(channels))


def only_numbers_change(name: str) -> Callable[[Path], object]:
    """Asserts that a file has other numbers, and nothing else."""

    def check(folder: Path) -> None:
        after, before = ((folder / each).read_bytes() for each in (name, "copy"))
        assert after != before
        assert NUMBER.sub(b"", after) == NUMBER.sub(b"", before)

    return check


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


NAME = r"^semcal: error: kit.yaml: found sensors {}, needed --{} to name (one of them|the LiDAR's own)$"
READ, INTO = ("convert", "kit.yaml", "--to", "semcal"), ("convert", "drive", "--into")
ONE_SENSOR = "found one sensor as camera and LiDAR, 'b' and 'LIDAR_TOP', needed two sensors$"
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
    "a camera named as the LiDAR, into a kit": Hostile(
        kit("camera0/camera_link", "velodyne_top"),
        (*INTO, "kit.yaml", "--to-lidar", "camera0/camera_link"),
        NAME.format("camera0/camera_link, velodyne_top", "to-camera"),
        kept=("kit.yaml",),
    ),
    "a token and a channel of one sensor": Hostile(
        table,
        ("convert", "calibrated_sensor.json", "--to", "semcal", "--camera", "b", "--lidar", "LIDAR_TOP"),
        ONE_SENSOR,
    ),
    "a token and a channel of one sensor, into a table": Hostile(
        table,
        (*INTO, "calibrated_sensor.json", "--to-camera", "b", "--to-lidar", "LIDAR_TOP"),
        ONE_SENSOR,
        kept=("calibrated_sensor.json",),
    ),
    "the LiDAR's usual name for the camera": Hostile(
        lambda folder: None,
        ("convert", "drive", "--to", "tf2", "--to-camera", "lidar"),
        "--to-camera, --to-lidar: found 'lidar' for both, needed two names$",
    ),
    "into YAML with a byte order mark, CRLF and comments in the matrix": Hostile(
        beside(
            "a.yaml",
            f"\ufeff# rig\r\ncam0:\r\n    T_cam_lidar:  # ours\r\n      - {ROW}  # x\r\n      - {ROW}\r\n"
            f"\r\n      # z\r\n      - {ROW}\r\n      - {LAST}\r\n    <<: {{a: 1}}".encode(),
        ),
        (*INTO, "a.yaml"),
        r"^set the transform in a\.yaml, which had no readable one$",
        exit_code=0,
        check=only_numbers_change("a.yaml"),
    ),
    "into JSON that is indented by tabs": Hostile(
        beside(
            "a.json",
            f'{{\n\t"CAM" : {{\r\n\t\t"lidar2cam":[\n\t\t\t{ROW},'
            f"\n\t\t\t{ROW},{ROW},\n\t\t\t{LAST}\n\t\t]\n\t}}\n}}".encode(),
        ),
        (*INTO, "a.json"),
        r"^set the transform in a\.json, which had no readable one$",
        exit_code=0,
        check=only_numbers_change("a.json"),
    ),
}

WIDE = ("--max-rotation-deg", "5", "--max-translation-m", "1")
for how, change, command in (
    ("rounded to three decimals", rounded, ("verify", "drive", "T.yaml", "--json", *WIDE)),
    ("stretched by 1.0001", scaled(1.0001), ("refine", "drive", "--init", "T.yaml", "-o", "out.yaml")),
    ("stretched by 1.0004", scaled(1.0004), ("calibrate", "drive", "--init", "T.yaml", "-o", "out.yaml")),
):
    TRANSFORMS[f"a transform {how}, {command[0]}"] = Hostile(
        start(change), (*command, "--quiet"), "^$", exit_code=0, check=is_rigid
    )
