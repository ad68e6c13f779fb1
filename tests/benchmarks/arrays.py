"""Calibrate a drive from arrays and from its files, in turns, and print seconds and peak memory as a Markdown table.

    python tests/benchmarks/arrays.py --pairs 20

Arrays are loaded before the clock starts. Memory is the peak of a process of its own for each, which loads nothing but
what it calibrates; that of arrays is told without the arrays themselves.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from semcal_cli.drive.arrays import ArrayInput
from semcal_cli.drive.document import Drive
from semcal_cli.drive.reading import read_clouds

MIB = float(1 << 20)


def arrays_of(drive: Drive) -> ArrayInput:
    """Load the files of a synthetic drive as a program would, and give them with what else its document says."""
    found: dict[str, Any] = {}

    def load(argument: str, key: str, read: Any) -> None:
        if drive.frames[0].model_dump()[key] is not None:
            found[argument] = [read(drive.resolve(getattr(frame, key))) for frame in drive.frames]

    if drive.motion is None:
        load("points", "points", lambda path: np.fromfile(path, np.float32).reshape(-1, 4))
    else:
        clouds = read_clouds(drive)
        found["points"] = [np.column_stack([cloud.points, cloud.intensity]) for cloud in clouds]
        found["point_times"] = [cloud.time for cloud in clouds]
    load("point_labels", "point_labels", lambda path: np.fromfile(path, np.uint32) & 0xFFFF)
    load("image_labels", "image_labels", lambda path: cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
    load("images", "image", lambda path: cv2.imread(str(path))[..., ::-1])
    for name in ("point_features", "image_features"):
        load(name, name, np.load)
    for argument, key in (("points_stamps", "points_stamp"), ("image_stamps", "image_stamp")):
        if getattr(drive.frames[0], key) is not None:
            found[argument] = [getattr(frame, key) for frame in drive.frames]
    motion = drive.motion
    if motion is not None and motion.poses is not None:
        found["poses"], motion = (
            np.loadtxt(drive.resolve(motion.poses)),
            motion.model_copy(update={"poses": "poses"}),
        )
    same = {key: getattr(drive, key) for key in ("camera", "lidar", "ignore", "classes", "T_camera_lidar")}
    return {**found, **same, "motion": motion, "time_offset_s": drive.time_offset_s}  # type: ignore[typeddict-item]
