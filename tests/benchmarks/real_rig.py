"""Prints a Markdown table: DDAD's cameras as one rig, by edges, each from 2 degrees and 0.2 m off.

    python tests/benchmarks/real_rig.py ../shared/data [--cameras 6]

The points are in the frame of the vehicle, and rays start on its roof, at the place that `ray_origin.py` finds.
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
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.result.calibration_document import read_calibration

ORIGIN_M = [1.38, 0.0, 1.63]


def main(data: Path, *, cameras: int = 6) -> Iterator[str]:
    """Calibrate the rig, and compare each camera with its published pose."""
    with TemporaryDirectory() as folder:
        yield from table("camera | deg | cm | status", _rows(data.resolve(), Path(folder), cameras))


def _rows(data: Path, folder: Path, cameras: int) -> Iterator[tuple[str, ...]]:
    published, out = {}, folder / "out"
    for seed, real in enumerate([*READERS["ddad_scene"](data / "ddad_scene", folder)][:cameras]):
        name, document = real.path.name, yaml.safe_load((real.path / DRIVE_FILE).read_text())
        published[name] = np.array(read_drive(real.path).T_camera_lidar)
        start = displace(published[name], *STARTS["near"], np.random.default_rng(seed))
        document |= {"T_camera_lidar": start.tolist(), "lidar": {"origin_m": ORIGIN_M}}
        (real.path / DRIVE_FILE).write_text(yaml.safe_dump(document))
    rig = {"semcal_rig": 1, "cameras": {name: name for name in published}}
    (folder / RIG_FILE).write_text(yaml.safe_dump(rig))
    run_process([*SEMCAL, "calibrate", str(folder / RIG_FILE), "--cue", "edges", "-o", str(out), "-q"])
    for name, T_published in published.items():
        calibration = read_calibration(out / f"{name}.yaml")
        error = compare_poses(calibration.pose, T_published)
        yield name, f"{error.rotation_deg:.2f}", f"{error.camera_center_cm:.1f}", calibration.status


if __name__ == "__main__":
    script(main)
