"""Draw a real frame before and after `--cue edges`: steps along the scan on the gradients of the image.

    python tests/benchmarks/edges_image.py ../shared/data -o docs/pictures/edges.webp

The frame is one of KITTI's jam, of which no image is shown: only how much it changes from left to right.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import cues
import cv2
import numpy as np
from benchmark import script
from real_data import real_drives

from semcal_cli import core
from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import read_drive
from semcal_cli.formats import read_transform
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.pipeline import calibrate

SCALE, WIDTH, TITLE_PX = 2, 1400, 40
COLORS = {"intensity": (255, 170, 60), "range": (40, 140, 255)}
"""Blue, green and red of steps in intensity and in range."""


def draw(data: LoadedDrive, frame: int, T_camera_lidar: Pose, title: str) -> np.ndarray:
    """One panel: levels of the gradient from black to white, and the visible edges of the sweep."""
    observed = data.observations.frame_observations[frame]
    classes = observed.image.classes
    grey = (220.0 * (classes / classes[classes < 255].max()) ** 3).astype(np.uint8)
    large = cv2.resize(grey, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_LINEAR)
    panel = cv2.copyMakeBorder(
        cv2.cvtColor(large, cv2.COLOR_GRAY2BGR), TITLE_PX, 0, 0, 0, cv2.BORDER_CONSTANT
    )
    cloud = observed.cloud
    projected = core.project_points(core_camera(data.drive.camera), cloud.points, T_camera_lidar)
    seen = np.isfinite(projected.ranges) & ~projected.is_hidden
    for level, name in enumerate(data.observations.point_class_names):
        color = COLORS.get(name.split()[0])
        for u, v in SCALE * (projected.pixels[seen & (cloud.classes == level)] + 0.5) if color else ():
            cv2.circle(panel, (round(u), round(v) + TITLE_PX), 2, color, -1, cv2.LINE_AA)
    cv2.putText(panel, title, (12, 29), cv2.FONT_HERSHEY_SIMPLEX, 0.9, (255, 255, 255), 2, cv2.LINE_AA)
    return panel


def main(data: Path, *, output: Path, frame: int = 6, seed: int = 3, max_frames: int = 70) -> Iterator[str]:
    """Draw both panels, of one frame, into one image."""
    with TemporaryDirectory() as folder:
        jam = next(each for each in real_drives(data.resolve(), Path(folder)) if "jam" in each.name)
        config = CalibrationConfig(cues=("edges",), max_frames=max_frames)
        loaded = load(read_drive(jam.path), config)
        start = cues.start(read_transform(jam.path), seed)
        found = calibrate(loaded, config, initial_pose=start)
        frame = min(frame, len(loaded.drive.frames) - 1)
        title = f"before: {cues.START_DEG:g} degrees and {cues.START_M:g} m off"
        before = draw(loaded, frame, start.T_camera_lidar, title)
        image = np.vstack([before, draw(loaded, frame, found.pose, "after")])
    size = WIDTH, round(image.shape[0] * WIDTH / image.shape[1])
    cv2.imwrite(str(output), cv2.resize(image, size, interpolation=cv2.INTER_AREA))
    yield f"written to {output}"


if __name__ == "__main__":
    script(main)
