"""Prints a Markdown table: what overlapping images show of the cameras of a rig, from right and from wrong poses.

    python tests/benchmarks/image_matching.py ../shared/data [--seeds 5]

DDAD's six cameras, and rigs of six synthetic ones. Poses are the published or true ones, or each is turned by 3 degrees
and moved by 0.2 m.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmark import script, table
from real_data import READERS

from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import RIG_FILE, Drive, read_drive
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.geometry.poses import compare_poses, inverse
from semcal_cli.geometry.twists import displace
from semcal_cli.many.rig.image_matching import fit_all, pair_images
from semcal_cli.many.rig.rig_document import read_rig
from semcal_cli.synthetic.synthesis import synthesize_rig

WRONG = 3.0, 0.2


def main(
    data: Path,
    *,
    only: str = "",
    seeds: int = 5,
    first_seed: int = 64_000,
    frames: int = 5,
    width: int = 1280,
) -> Iterator[str]:
    """Match the images of the rigs whose names have `only`, and compare what they show with the right transforms."""
    config = SynthConfig(num_frames=frames, width=width, height=width * 9 // 16)
    columns = "rig | poses | pairs of cameras | features: median | deg: median, worst | cm: median, worst"
    drawn = range(first_seed, first_seed + seeds)
    yield from table(columns, [*_real(data.resolve(), only, drawn), *_synthetic(config, only, drawn)])


def _real(data: Path, only: str, seeds: range) -> Iterator[tuple[str, ...]]:
    if only in (name := "DDAD, 3 sweeps"):
        with TemporaryDirectory() as folder:
            real = READERS["ddad_scene"](data / "ddad_scene", Path(folder))
            drives = {each.path.name: read_drive(each.path) for each in real}
            yield from _of_rigs(name, [drives], seeds)


def _synthetic(config: SynthConfig, only: str, seeds: range) -> Iterator[tuple[str, ...]]:
    if only in (name := f"{len(seeds)} synthetic, {config.num_frames} sweeps"):
        with TemporaryDirectory() as folder:
            rigs = []
            for seed in seeds:
                synthesize_rig(replace(config, seed=seed), 6, Path(folder) / f"{seed}")
                rigs.append(read_rig(Path(folder) / f"{seed}" / RIG_FILE).read_drives())
            yield from _of_rigs(name, rigs, seeds[:1])


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
    for shown in fit_all(pair_images(drives, poses, SweepCache()).pairs, poses):
        error = compare_poses(shown.pose, truth[shown.to] @ inverse(truth[shown.source]))
        yield error.rotation_deg, error.camera_center_cm, shown.num_matches


if __name__ == "__main__":
    script(main)
