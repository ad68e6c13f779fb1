"""Rigs of several cameras: whether the intervals of pairs hold, and what one run saves.

    python tests/benchmarks/rig.py --seeds 20

Synthetic rigs, each with another world and other mountings, 20 % wrong labels on both sides. Prints a Markdown table:
over all pairs of trusted cameras and six axes, how often 95 % intervals hold the true pose of one camera beside the
other, in how many pairs the region of all six axes does, and the time of one run beside that of a run for each camera.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmark import script, seconds_of, table

from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.files.documents import read_document
from semcal_cli.synthetic.synthesis import synthesize, synthesize_rig


def make_rig(config: SynthConfig, num_cameras: int, out: Path, same_view: bool) -> None:
    """Make a rig of cameras all around the LiDAR, or of cameras that all look ahead and see the same points."""
    if not same_view:
        synthesize_rig(config, num_cameras, out)
        return
    names = [f"camera_{index}" for index in range(num_cameras)]
    for index, name in enumerate(names):
        camera = replace(config, rig_seed=config.seed + 1000 * index, camera_azimuth_deg=0.0)
        synthesize(camera, out / name, sweeps=f"../{names[0]}" if index else None, camera=index)
    (out / "rig.yaml").write_text(f"semcal_rig: 1\ncameras: {{{', '.join(f'{n}: {n}' for n in names)}}}\n")


def main(
    *,
    seeds: int = 20,
    first_seed: int = 60_000,
    cameras: int = 3,
    frames: int = 5,
    same_view: bool = False,
    width: int = 1280,
) -> Iterator[str]:
    config = SynthConfig(num_frames=frames, width=width, height=width * 9 // 16, label_noise=0.2)
    held, explained, ratios, num_pairs = [], 0, [], 0
    for seed in range(first_seed, first_seed + seeds):
        with TemporaryDirectory() as folder:
            rig, out = Path(folder) / "rig", Path(folder) / "out"
            make_rig(replace(config, seed=seed), cameras, rig, same_view)
            drives = [rig / f"camera_{index}" for index in range(cameras)]
            alone = sum(seconds_of("calibrate", drive, "-o", f"{folder}/alone.yaml") for drive in drives)
            ratios.append(seconds_of("calibrate", rig, "-o", out) / alone)
            document = read_document(out / "rig_calibration.yaml")
        for pair in document["pairs"]:
            num_pairs += 1
            if all(document["cameras"][pair[side]]["status"] == "trusted" for side in "ab"):
                found, stated = pair["reference"], pair["uncertainty"]
                off = [0.01 * x for x in found["camera_center_xyz_cm"]] + found["rotation_xyz_deg"]
                half = stated["half_width_95_camera_center_m"] + stated["half_width_95_rotation_deg"]
                held.append(np.abs(off) <= half)
                explained += found["is_explained"]
    shares = (f"{np.mean(held):.1%}", explained) if held else ("", "")
    row = (cameras, num_pairs, len(held), *shares, f"{np.median(ratios):.2f}")
    header = (
        "cameras | pairs | trusted | axes within 95 % intervals | regions of all six | one run, of the time"
    )
    yield from table(header, [row])


if __name__ == "__main__":
    script(main)
