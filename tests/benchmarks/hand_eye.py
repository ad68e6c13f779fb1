"""Prints a Markdown table: the mounting's rotation by camera motion against LiDAR motion, and edges that start there.

    python tests/benchmarks/hand_eye.py [--drives 10] [--without-edges] [--folder DIR]

Each drive has three images a sweep, in 20 streets, and no labels; the camera looks anywhere. In turning drives each
street has another speed and turn, in straight ones none turns. Drives are kept in a folder, if one is named, and those
that are there are not made again.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from benchmark import script, table
from consecutive_images import LongSweeps, write_images

from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.document import DRIVE_FILE, read_drive
from semcal_cli.errors import InputError
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.initialization.handeye import NotDetermined, hand_eye
from semcal_cli.pipeline import calibrate


def by_motion_alone(folder: Path, config: LongSweeps) -> tuple[str, ...]:
    found, name = hand_eye(read_drive(folder)), f"{config.motion}, seed {config.seed}"
    if isinstance(found, NotDetermined):
        return name, "not determined" if "too few turns" in found.why else found.why, "-", "-", "-"
    off = compare_poses(found.T_camera_lidar, read_transform(folder))
    start = f"{off.rotation_deg:.2f} deg, {off.camera_center_cm:.0f} cm"
    return name, start, f"+- {found.half_width_deg:.2f} deg", "-", "-"


def row(folder: Path, config: LongSweeps, *, without_edges: bool) -> tuple[str, ...]:
    if not (folder / DRIVE_FILE).exists():
        write_images(config, folder)
    if without_edges:
        return by_motion_alone(folder, config)
    truth, name = read_transform(folder), f"{config.motion}, seed {config.seed}"
    try:
        result = calibrate(folder, CalibrationConfig(cues=("edges",)))
    except InputError as error:
        is_told = "too few turns" in str(error)
        return name, "not determined" if is_told else str(error), "-", "-", "refused"
    by_motion: Any = result.settings.options["hand_eye"]
    start, end = (
        compare_poses(np.array(stage.T_camera_lidar), truth)
        for stage in (result.stages["initial"], result.stages["polished"])
    )
    return (
        name,
        f"{start.rotation_deg:.2f} deg, {start.camera_center_cm:.0f} cm",
        f"+- {by_motion['half_width_95_deg']:.2f} deg",
        f"{end.rotation_deg:.3f} deg, {end.camera_center_cm:.2f} cm",
        result.status.replace("_", " "),
    )


def main(
    *,
    drives: int = 10,
    first_seed: int = 101,
    width: int = 1280,
    folder: str = "",
    without_edges: bool = False,
) -> Iterator[str]:
    """Print the table, turning drives first."""
    with tempfile.TemporaryDirectory() as name:
        root = Path(folder or name)
        size = {"width": width, "height": width * 9 // 16}
        cases = [
            (root / f"{motion}_{seed}", LongSweeps(num_frames=20, seed=seed, motion=motion, **size))
            for motion in ("mixed", "steady")
            for seed in range(first_seed, first_seed + drives)
        ]
        header = "drive | hand-eye | its 95 % interval | edges from there | verdict"
        yield from table(header, (row(*case, without_edges=without_edges) for case in cases))


if __name__ == "__main__":
    script(main)
