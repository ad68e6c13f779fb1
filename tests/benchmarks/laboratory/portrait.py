"""Cameras on their side."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

TURN = np.array([[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""(4, 4) from the frame of an upright camera to that of one on its side, whose images are turned clockwise."""


def on_side(camera: dict[str, Any]) -> dict[str, Any]:
    """Describe a camera on its side, whose lens has no tangential distortion, as in a drive.yaml."""
    (fx, _, cx), (_, fy, cy), last = camera["K"]
    K = ((fy, 0.0, camera["height"] - 1.0 - cy), (0.0, fx, cx), last)
    return camera | {"K": K, "width": camera["height"], "height": camera["width"]}


def write_portrait_drive(path: Path, folder: Path) -> Path:
    """Write a drive into another folder as the same camera on its side sees it.

    Returns:
        The folder.
    """
    document: dict[str, Any] = yaml.safe_load((path / "drive.yaml").read_text())
    document["camera"] = on_side(document["camera"])
    document["T_camera_lidar"] = (TURN @ document["T_camera_lidar"]).tolist()
    folder.mkdir()
    for number, frame in enumerate(document["frames"]):
        for key in frame.keys() & {"points", "point_labels"}:
            frame[key] = str(path / frame[key])
        for key in frame.keys() & {"image", "image_labels"}:
            stored = cv2.imread(str(path / frame[key]), cv2.IMREAD_UNCHANGED)
            turned = cv2.rotate(stored, cv2.ROTATE_90_CLOCKWISE)
            frame[key] = f"{key}_{number}.png"
            cv2.imwrite(str(folder / frame[key]), turned)
    (folder / "drive.yaml").write_text(yaml.safe_dump(document))
    return folder
