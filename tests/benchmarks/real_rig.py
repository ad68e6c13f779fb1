"""Prints a Markdown table: the cameras of a data set as one rig, by edges, each from 2 degrees and 0.2 m off.

    python tests/benchmarks/real_rig.py ../shared/data [--rig ddad_scene] [--cameras 6] [--starts 3]

Each rig is calibrated twice: its cameras alone, and with `match_images`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

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


def main(data: Path, *, rig: str = "ddad_scene", cameras: int = 6, starts: int = 3) -> Iterator[str]:
    """Calibrate the rig from several starts, and compare its cameras with their published poses."""
    columns = (
        "start | cameras | deg: median, worst | cm: median, worst | within 1 deg, 20 cm | trusted | seconds"
    )
    yield from table(
        columns, [row for start in range(starts) for row in _rows(data.resolve() / rig, start, cameras)]
    )


def _rows(data: Path, start: int, cameras: int) -> Iterator[tuple[str, ...]]:
    with TemporaryDirectory() as folder:
        published = _written_rig(data, Path(folder), start, cameras)
        for name, matched in (("alone", False), ("matched", True)):
            rig = {"semcal_rig": 1, "cameras": {name: name for name in published}, "match_images": matched}
            (Path(folder) / RIG_FILE).write_text(yaml.safe_dump(rig))
            out, begin = Path(folder) / name, perf_counter()
            run_process([*SEMCAL, "calibrate", folder, "--cue", "edges", "-o", str(out), "-q"])
            seconds = perf_counter() - begin
            results = [read_calibration(out / f"{camera}.yaml") for camera in published]
            errors = [
                compare_poses(result.pose, T) for result, T in zip(results, published.values(), strict=True)
            ]
            deg, cm = (
                np.array([getattr(error, unit) for error in errors])
                for unit in ("rotation_deg", "camera_center_cm")
            )
            yield (
                f"{start}",
                name,
                f"{np.median(deg):.2f}, {deg.max():.2f}",
                f"{np.median(cm):.1f}, {cm.max():.1f}",
                f"{np.sum((deg <= 1.0) & (cm <= 20.0))} of {len(errors)}",
                f"{sum(result.trusted for result in results)}",
                f"{seconds:.0f}",
            )


def _written_rig(data: Path, folder: Path, start: int, cameras: int) -> dict[str, Pose]:
    """Write the drives of the rig's cameras, and return their published poses."""
    published = {}
    for index, real in enumerate([*READERS[data.name](data, folder)][:cameras]):
        name, document = real.path.name, yaml.safe_load((real.path / DRIVE_FILE).read_text())
        published[name] = np.array(read_drive(real.path).T_camera_lidar)
        rng = np.random.default_rng(100 * start + index)
        T_start = displace(published[name], *STARTS["near"], rng)
        document |= {"T_camera_lidar": T_start.tolist()}
        (real.path / DRIVE_FILE).write_text(yaml.safe_dump(document))
    return published


if __name__ == "__main__":
    script(main)
