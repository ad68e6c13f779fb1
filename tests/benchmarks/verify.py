"""Counts how `semcal verify` decides on the truth and on transforms that are off, on real and on synthetic drives.

    python tests/benchmarks/verify.py DATA [--only NAME] [--synthetic 7]
    python tests/benchmarks/verify.py DATA --by-other --synthetic 0 --directions 3

Real drives are the KITTI sets, by edges; synthetic ones have a lens each, also fisheyes, by labels. Each is verified
with the true transform and with ones that are turned about, or moved along, random axes. For real drives, the
published pose stands for the truth, or with `--by-other`, the pose that semcal finds on the other set of the same
camera. The estimate is made anew each time, starting at the transform. Prints a Markdown table of the verdicts.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from zlib import crc32

import numpy as np
from benchmark import script, street, table
from real_data import real_drives

from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.errors import InputError
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.loading import load
from semcal_cli.pipeline import calibrate
from semcal_cli.pipeline.verification import Verification, verify

OFFSETS = {
    "truth": (0.0, 0.0),
    "0.4 deg": (0.4, 0.0),
    "8 cm": (0.0, 0.08),
    "0.2 deg": (0.2, 0.0),
    "5 cm": (0.0, 0.05),
}
"""Rotation, degrees, and distance, metres, by which the transform is off."""
OF_ONE_CAMERA = ("KITTI object", "KITTI jam")
"""Beginnings of the names of the sets of one camera."""
LENSES = ("standard", "wide", "fisheye", "narrow", "standard", "fisheye", "wide")


def drives(
    data: Path, folder: Path, only: tuple[str, ...], synthetic: int, *, by_other: bool
) -> Iterator[tuple[str, Drive, Pose, str]]:
    """List the drives with their true poses (4, 4) and the cue to verify by."""
    real = {
        each.name: read_drive(each.path)
        for each in real_drives(data, folder)
        if "KITTI" in each.name and "DiCENet" not in each.name
    }
    by_name = {name: name for name in real}
    if by_other:
        pair = [name for start in OF_ONE_CAMERA for name in real if name.startswith(start)]
        if len(pair) != len(OF_ONE_CAMERA):
            raise InputError(f"{data}: --by-other needs {' and '.join(OF_ONE_CAMERA)}")
        by_name = dict(zip(pair, reversed(pair), strict=True))
    for name, other in by_name.items():
        if not only or any(part in name for part in only):
            T = _calibrated(real[other]) if by_other else np.array(real[name].T_camera_lidar)
            yield name, real[name], T, "edges"
    for seed, lens in enumerate(LENSES[:synthetic], start=70):
        path = folder / f"synthetic_{seed}"
        drive, truth = street(path, seed, 12, 1280, lens=lens, label_noise=0.05)
        yield f"synthetic {seed}, {lens}", drive, truth, "labels"


def _calibrated(drive: Drive) -> Pose:
    """Calibrate a drive from near its published pose."""
    start = displace(np.array(drive.T_camera_lidar), 2.0, 0.2, np.random.default_rng(0))
    return calibrate(drive, CalibrationConfig(cues=("edges",)), initial_pose=InitialPose(start, "near")).pose


def main(
    data: Path,
    *,
    only: tuple[str, ...] = (),
    synthetic: int = len(LENSES),
    by_other: bool = False,
    directions: int = 1,
) -> Iterator[str]:
    """Verify all transforms on all drives."""
    counts = {name: dict.fromkeys(("pass", "inconclusive", "fail"), 0) for name in OFFSETS}

    def rows() -> Iterator[tuple[object, ...]]:
        with TemporaryDirectory() as folder:
            of_sets = drives(data.resolve(), Path(folder), only, synthetic, by_other=by_other)
            for name, drive, truth, cue in of_sets:
                config = CalibrationConfig(cues=(cue,))
                loaded = load(drive, config)
                for offset, direction in product(OFFSETS, range(directions)):
                    if offset == "truth" and direction > 0:
                        continue
                    T = displace(
                        truth, *OFFSETS[offset], np.random.default_rng([direction, crc32(name.encode())])
                    )
                    found = verify(loaded, InitialPose(T, "the transform"), config=config)
                    counts[offset][found.verdict] += 1
                    of_part = {check.name: check.half_width for check in found.checks}
                    widths = [of_part[f"{part} overall"] for part in ("camera centre", "rotation")]
                    yield (
                        name,
                        offset,
                        direction,
                        found.verdict,
                        found.has_moved,
                        *("-" if width is None else f"{width:.2f}" for width in widths),
                        _shown(found),
                        ", ".join(found.topics),
                    )

    yield from table(
        "drive | off | direction | verdict | moved | +- cm | +- deg | would have shown | reasons", rows()
    )
    yield ""
    for offset, verdicts in counts.items():
        yield f"{offset}: {', '.join(f'{count} {verdict}' for verdict, count in verdicts.items())}"


def _shown(found: Verification) -> str:
    visible = found.smallest_visible
    if visible is None:
        return ""
    return f"{100.0 * max(visible.camera_center_m):.1f} cm, {max(visible.rotation_deg):.3f} deg"


if __name__ == "__main__":
    script(main)
