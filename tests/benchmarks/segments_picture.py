"""Draw a real frame before and after `--cue segments,intensity`: segments of the sweep on borders of labels.

    python tests/benchmarks/segments_picture.py ../shared/data -o docs/pictures/segments.png

The frame is the first of KITTI's jam, of which no picture is shown: only what a network and the sweep's shape say.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import cv2
import numpy as np
from real_drives import START_DEG, START_M, jam

from semcal_cli import _core
from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.cues import SEGMENTS
from semcal_cli.drive.document import read_drive
from semcal_cli.drive.loading import LoadedDrive, load
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import Pose
from semcal_cli.geometry.twists import displaced
from semcal_cli.pipeline import polish, refine
from semcal_cli.report.colors import segment_colors

SCALE, WIDTH = 2, 1400
GREY, BORDER = 235, (90, 90, 90)


def draw(data: LoadedDrive, T: Pose, title: str) -> np.ndarray:
    """One panel: borders of the labels, and the visible points coloured by segment."""
    observations = data.of_cue("segments")
    labels = observations.images[0].classes
    panel = np.full((*(SCALE * np.array(labels.shape)), 3), GREY, np.uint8)
    large = cv2.resize(labels, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_NEAREST)
    edges = cv2.morphologyEx(large, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
    panel[edges] = BORDER
    points = observations.clouds[0].points
    segmented = _core.segment_sweep(points, SEGMENTS.segmentation)
    projected = _core.project_points(core_camera(data.drive.camera), points, T)
    seen = np.isfinite(projected.ranges) & ~projected.is_hidden & (segmented.ids != _core.NO_SEGMENT)
    colors = segment_colors(segmented)[0][seen]
    for (u, v), color in zip(SCALE * (projected.pixels[seen] + 0.5), colors.tolist(), strict=True):
        cv2.circle(panel, (round(u), round(v)), 2, color, -1, cv2.LINE_AA)
    cv2.putText(panel, title, (12, 30), cv2.FONT_HERSHEY_SIMPLEX, 0.9, (0, 0, 0), 2, cv2.LINE_AA)
    return panel


def poses(data: LoadedDrive, T: Pose, seed: int) -> Mapping[str, Pose]:
    """The start, and where it leads."""
    config = CalibrationConfig(cues=data.cues).refinement
    start = displaced(T, START_DEG, START_M, np.random.default_rng(seed))
    refined = refine(data, start, config)
    found = polish(data, refined.T_camera_lidar, config).T_camera_lidar
    return {f"before: {START_DEG:g} degrees and {START_M:g} m off": start, "after": found}


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
@click.option("--max-frames", default=70, help="Frames of the drive.")
@click.option("--seed", default=3, help="Seed of the start.")
def main(data: Path, output: Path, max_frames: int, seed: int) -> None:
    """Draw both panels into one picture."""
    with TemporaryDirectory() as folder:
        ((_, where),) = jam(data.resolve(), Path(folder))
        drive = read_drive(where)
        drive = drive.model_copy(update={"frames": drive.frames[:max_frames]})
        found = load(drive, CalibrationConfig(cues=("segments", "intensity")))
        panels = [
            draw(found, T, title) for title, T in poses(found, read_transform(drive.path), seed).items()
        ]
    picture = np.vstack(panels)
    size = WIDTH, round(picture.shape[0] * WIDTH / picture.shape[1])
    cv2.imwrite(str(output), cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
    print(f"written to {output}")


if __name__ == "__main__":
    main()
