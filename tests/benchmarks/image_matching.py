"""Prints a Markdown table: what overlapping images show of the cameras of a rig, from right and from wrong poses.

    python tests/benchmarks/image_matching.py ../shared/data [--seeds 5]

DDAD's six cameras, and rigs of six synthetic ones. Poses are the published or true ones, or each is turned by 3 degrees
and moved by 0.2 m.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmark import script, table
from real_data import READERS

from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.geometry.poses import compare_poses, inverse
from semcal_cli.geometry.twists import displace
from semcal_cli.many.rig.image_matching import fit_all, pair_images
from semcal_cli.many.rig.rig_document import read_rig
from semcal_cli.synthetic.synthesis import synthesize_rig

WRONG = 3.0, 0.2


def main(data: Path, *, seeds: int = 5, first_seed: int = 64_000, frames: int = 5) -> Iterator[str]:
    """Match the images of the rigs, and compare what they show with the transforms between the cameras."""
    columns = "rig | poses | pairs of cameras | features: median | deg: median, worst | cm: median, worst"
    yield from table(columns, _rows(data.resolve(), range(first_seed, first_seed + seeds), frames))


def _rows(data: Path, seeds: range, frames: int) -> Iterator[tuple[str, ...]]:
    with TemporaryDirectory() as folder:
        real = READERS["ddad_scene"](data / "ddad_scene", Path(folder))
        drives = {each.path.name: read_drive(each.path) for each in real}
        yield from _of_rigs("DDAD, 3 sweeps", [drives], range(max(len(seeds), 1)))
    with TemporaryDirectory() as folder:
        rigs = []
        for seed in seeds:
            synthesize_rig(SynthConfig(num_frames=frames, seed=seed), 6, Path(folder) / f"{seed}")
            rigs.append(read_rig(Path(folder) / f"{seed}" / "rig.yaml").read_drives())
        yield from _of_rigs(f"{len(rigs)} synthetic, {frames} sweeps", rigs, range(1))


def _of_rigs(name: str, rigs: list[dict[str, Drive]], seeds: range) -> Iterator[tuple[str, ...]]:
    right = [error for drives in rigs for error in _errors(drives, None)]
    wrong = [error for drives in rigs for seed in seeds for error in _errors(drives, seed)]
    for poses, errors in (("right", right), ("wrong", wrong)):
        deg, cm, features = zip(*errors, strict=True) if errors else ((np.nan,), (np.nan,), (np.nan,))
        yield (
            name,
            poses,
            f"{len(errors)}",
            f"{np.median(features):.0f}",
            f"{np.median(deg):.2f}, {np.max(deg):.2f}",
            f"{np.median(cm):.1f}, {np.max(cm):.1f}",
        )


def _errors(drives: Mapping[str, Drive], seed: int | None) -> Iterator[tuple[float, float, int]]:
    truth = {name: np.array(drive.T_camera_lidar) for name, drive in drives.items()}
    rng = np.random.default_rng(seed)
    poses = truth if seed is None else {name: displace(T, *WRONG, rng) for name, T in truth.items()}
    for shown in fit_all(pair_images(drives, poses, SweepCache()), poses):
        error = compare_poses(shown.pose, truth[shown.to] @ inverse(truth[shown.source]))
        yield error.rotation_deg, error.camera_center_cm, shown.num_matches


if __name__ == "__main__":
    script(main)
