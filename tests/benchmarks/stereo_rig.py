"""Prints a Markdown table: KITTI's left and right camera as one rig, by edges, tied by their published transform.

    python tests/benchmarks/stereo_rig.py ../shared/data

The two drives have other sweeps, of other days. Both start 2 degrees and 0.2 m off.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import yaml
from benchmark import SEMCAL, run_process, script, table
from real_data import READERS
from real_drives import STARTS

from semcal_cli.drive.document import DRIVE_FILE, RIG_FILE, read_drive
from semcal_cli.geometry.poses import compare_poses, inverse
from semcal_cli.geometry.twists import displace
from semcal_cli.result.calibration_document import read_calibration

SOURCES = {"left": "kitti_object", "right": "kitti_raw_right"}


def main(
    data: Path, *, sigma_m: float = 0.005, sigma_deg: float = 0.02, max_frames: int = 70
) -> Iterator[str]:
    """Calibrate the cameras alone and tied, and compare them with their published poses."""
    with TemporaryDirectory() as folder:
        sigmas = {"sigma_m": sigma_m, "sigma_deg": sigma_deg}
        rows = _rows(data.resolve(), Path(folder), sigmas, max_frames)
        yield from table("camera | alone, deg | cm | tied, deg | cm | status", rows)


def _rows(data: Path, folder: Path, sigmas: dict[str, float], max_frames: int) -> Iterator[tuple[str, ...]]:
    published, drives = {}, {}
    for index, (name, source) in enumerate(SOURCES.items()):
        real = next(iter(READERS[source](data / source, folder)))
        published[name] = np.array(read_drive(real.path).T_camera_lidar)
        T_start = displace(published[name], *STARTS["near"], np.random.default_rng(90 + index))
        document = yaml.safe_load((real.path / DRIVE_FILE).read_text()) | {"T_camera_lidar": T_start.tolist()}
        (real.path / DRIVE_FILE).write_text(yaml.safe_dump(document))
        drives[name] = real.path
    T = published["left"] @ inverse(published["right"])
    constraint = {"from": "right", "to": "left", "T_to_from": T.tolist(), **sigmas}
    rig = {"semcal_rig": 1, "cameras": {name: str(path) for name, path in drives.items()}}
    (folder / RIG_FILE).write_text(yaml.safe_dump(rig | {"constraints": [constraint]}))
    options = ["--cue", "edges", "--max-frames", str(max_frames), "-q"]
    run_process([*SEMCAL, "calibrate", str(folder / RIG_FILE), "-o", str(folder / "tied"), *options])
    for name, T_published in published.items():
        tied = read_calibration(folder / "tied" / f"{name}.yaml")
        alone = np.array(tied.stages["polished"].T_camera_lidar)
        errors = [compare_poses(pose, T_published) for pose in (alone, tied.pose)]
        figures = (
            f"{value:.2f}" for error in errors for value in (error.rotation_deg, error.camera_center_cm)
        )
        yield name, *figures, tied.status


if __name__ == "__main__":
    script(main)
