"""Counts how `semcal verify` decides on the truth and on transforms that are off, on real and on synthetic drives.

    python tests/benchmarks/verify.py DATA [--only NAME] [--synthetic 7]

Real drives are the KITTI sets, by edges; synthetic ones have a lens each, also fisheyes, by labels. Each is verified
with the true transform and with ones that are turned or moved about a random axis. The estimate is made anew each
time, starting at the transform. Prints a Markdown table of the verdicts.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmark import script, street, table
from real_data import real_drives

from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.loading import load
from semcal_cli.pipeline.verification import verify

OFFSETS = {
    "truth": (0.0, 0.0),
    "0.4 deg": (0.4, 0.0),
    "8 cm": (0.0, 0.08),
    "0.2 deg": (0.2, 0.0),
    "5 cm": (0.0, 0.05),
}
"""Rotation, degrees, and distance, metres, by which the transform is off."""
LENSES = ("standard", "wide", "fisheye", "narrow", "standard", "fisheye", "wide")


def drives(
    data: Path, folder: Path, only: tuple[str, ...], synthetic: int
) -> Iterator[tuple[str, Drive, Pose, str]]:
    """List the drives with their true poses (4, 4) and the cue to verify by."""
    for real in real_drives(data, folder):
        if (
            "KITTI" in real.name
            and "DiCENet" not in real.name
            and (not only or any(x in real.name for x in only))
        ):
            drive = read_drive(real.path)
            yield real.name, drive, np.array(drive.T_camera_lidar), "edges"
    for seed, lens in enumerate(LENSES[:synthetic], start=70):
        path = folder / f"synthetic_{seed}"
        drive, truth = street(path, seed, 12, 1280, lens=lens, label_noise=0.05)
        yield f"synthetic {seed}, {lens}", drive, truth, "labels"


def main(data: Path, *, only: tuple[str, ...] = (), synthetic: int = len(LENSES)) -> Iterator[str]:
    """Verify all transforms on all drives."""
    counts = {name: dict.fromkeys(("pass", "inconclusive", "fail"), 0) for name in OFFSETS}

    def rows() -> Iterator[tuple[object, ...]]:
        with TemporaryDirectory() as folder:
            for name, drive, truth, cue in drives(data.resolve(), Path(folder), only, synthetic):
                config = CalibrationConfig(cues=(cue,))
                loaded = load(drive, config)
                for offset, (angle_deg, distance_m) in OFFSETS.items():
                    T = displace(
                        truth, angle_deg, distance_m, np.random.default_rng(len(counts[offset]) + len(name))
                    )
                    found = verify(loaded, InitialPose(T, "the transform"), config=config)
                    counts[offset][found.verdict] += 1
                    visible = found.smallest_visible
                    shown = (
                        ""
                        if visible is None
                        else (
                            f"{100.0 * max(visible.camera_center_m):.1f} cm, {max(visible.rotation_deg):.3f} deg"
                        )
                    )
                    total = {check.name: check for check in found.checks}
                    widths = [
                        "-" if (half := total[f"{part} overall"].half_width) is None else f"{half:.2f}"
                        for part in ("camera centre", "rotation")
                    ]
                    yield (
                        name,
                        offset,
                        found.verdict,
                        found.has_moved,
                        *widths,
                        shown,
                        ", ".join(found.topics),
                    )

    yield from table("drive | off | verdict | moved | +- cm | +- deg | would have shown | reasons", rows())
    yield ""
    for offset, verdicts in counts.items():
        yield f"{offset}: {', '.join(f'{count} {verdict}' for verdict, count in verdicts.items())}"


if __name__ == "__main__":
    script(main)
