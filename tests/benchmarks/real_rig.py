"""Prints a Markdown table: DDAD's cameras as one rig, by edges, each from 2 degrees and 0.2 m off.

    python tests/benchmarks/real_rig.py ../shared/data [--cameras 6] [--starts 3]

The points are in the frame of the vehicle, and rays start on its roof, at the place that `ray_origin.py` finds. Each
rig is calibrated twice: its cameras alone, and with `match_images`.
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
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.result.calibration_document import read_calibration

ORIGIN_M = [1.38, 0.0, 1.63]


def main(data: Path, *, cameras: int = 6, starts: int = 3) -> Iterator[str]:
    """Calibrate the rig from several starts, and compare each camera with its published pose."""
    columns = "camera | start | alone: deg | cm | matched: deg | cm | status"
    yield from table(
        columns, [row for start in range(starts) for row in _rows(data.resolve(), start, cameras)]
    )


def _rows(data: Path, start: int, cameras: int) -> Iterator[tuple[str, ...]]:
    with TemporaryDirectory() as folder:
        published = _written_rig(data, Path(folder), start, cameras)
        errors = dict[str, list[str]]((name, []) for name in published)
        for matched in (False, True):
            rig = {"semcal_rig": 1, "cameras": {name: name for name in published}, "match_images": matched}
            (Path(folder) / RIG_FILE).write_text(yaml.safe_dump(rig))
            out = Path(folder) / f"matched_{matched}"
            run_process(
                [*SEMCAL, "calibrate", str(Path(folder) / RIG_FILE), "--cue", "edges", "-o", str(out), "-q"]
            )
            results = {name: read_calibration(out / f"{name}.yaml") for name in published}
            for name, T_published in published.items():
                error = compare_poses(results[name].pose, T_published)
                errors[name] += [f"{error.rotation_deg:.2f}", f"{error.camera_center_cm:.1f}"]
        for name in published:
            yield name.removesuffix("_3_pairs"), f"{start}", *errors[name], results[name].status


def _written_rig(data: Path, folder: Path, start: int, cameras: int) -> dict[str, Pose]:
    """Write the drives of the rig's cameras, and return their published poses."""
    published = {}
    for index, real in enumerate([*READERS["ddad_scene"](data / "ddad_scene", folder)][:cameras]):
        name, document = real.path.name, yaml.safe_load((real.path / DRIVE_FILE).read_text())
        published[name] = np.array(read_drive(real.path).T_camera_lidar)
        rng = np.random.default_rng(100 * start + index)
        T_start = displace(published[name], *STARTS["near"], rng)
        document |= {"T_camera_lidar": T_start.tolist(), "lidar": {"origin_m": ORIGIN_M}}
        (real.path / DRIVE_FILE).write_text(yaml.safe_dump(document))
    return published


if __name__ == "__main__":
    script(main)
