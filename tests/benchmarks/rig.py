"""Rigs of several cameras: whether the intervals of pairs hold, and what one run saves.

    python tests/benchmarks/rig.py --seeds 20

Synthetic rigs, each with another world and other mountings, 20 % wrong labels on both sides. Prints a Markdown table:
over all pairs of trusted cameras and six axes, how often 95 % intervals hold the true pose of one camera beside the
other, in how many pairs the region of all six axes does, and the time of one run beside that of a run for each camera.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from subprocess import DEVNULL, run
from tempfile import TemporaryDirectory
from time import perf_counter

import click
import numpy as np

from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.experiments.page_tables import run_script
from semcal_cli.experiments.speed import SEMCAL
from semcal_cli.experiments.summary import markdown_table
from semcal_cli.files.documents import read_document
from semcal_cli.synthetic.synthesis import synthesize, synthesize_rig


def timed(*arguments: object) -> float:
    """Run the command, and give its seconds."""
    start = perf_counter()
    code = run([*SEMCAL, *map(str, arguments), "-q"], stdout=DEVNULL, check=False).returncode
    if code not in (0, 3):
        raise click.ClickException(f"semcal {' '.join(map(str, arguments))}: exit code {code}")
    return perf_counter() - start


def make_rig(config: SynthConfig, num_cameras: int, out: Path, same_view: bool) -> None:
    """Make a rig of cameras all around the LiDAR, or of cameras that all look ahead."""
    if not same_view:
        synthesize_rig(config, num_cameras, out)
        return
    names = [f"camera_{index}" for index in range(num_cameras)]
    for index, name in enumerate(names):
        camera = replace(config, rig_seed=config.seed + 1000 * index, camera_azimuth_deg=0.0)
        synthesize(camera, out / name, sweeps=f"../{names[0]}" if index else None, camera=index)
    (out / "rig.yaml").write_text(f"semcal_rig: 1\ncameras: {{{', '.join(f'{n}: {n}' for n in names)}}}\n")


@click.command()
@click.option("--seeds", default=20, show_default=True)
@click.option("--first-seed", default=60_000, show_default=True)
@click.option("--cameras", "num_cameras", default=3, show_default=True)
@click.option("--frames", "num_frames", default=5, show_default=True)
@click.option("--same-view", is_flag=True, help="All cameras look ahead, and see the same points.")
@click.option("--width", default=1280, show_default=True, help="Columns of the pictures, 16 to 9.")
def main(seeds: int, first_seed: int, num_cameras: int, num_frames: int, same_view: bool, width: int) -> None:
    """Measure."""
    street = SynthConfig(num_frames=num_frames, width=width, height=width * 9 // 16, label_noise=0.2)
    held, explained, ratios, num_pairs = [], 0, [], 0
    for seed in range(first_seed, first_seed + seeds):
        with TemporaryDirectory() as folder:
            rig, out = Path(folder) / "rig", Path(folder) / "out"
            make_rig(replace(street, seed=seed), num_cameras, rig, same_view)
            drives = [rig / f"camera_{index}" for index in range(num_cameras)]
            alone = sum(timed("calibrate", drive, "-o", f"{folder}/alone.yaml") for drive in drives)
            together = timed("calibrate", rig, "-o", out)
            ratios.append(together / alone)
            document = read_document(out / "rig_calibration.yaml")
            for pair in document["pairs"]:
                num_pairs += 1
                if any(document["cameras"][pair[side]]["status"] != "trusted" for side in "ab"):
                    continue
                found, stated = pair["reference"], pair["uncertainty"]
                off = [0.01 * x for x in found["camera_center_xyz_cm"]] + found["rotation_xyz_deg"]
                half = stated["half_width_95_camera_center_m"] + stated["half_width_95_rotation_deg"]
                held.append(np.abs(off) <= half)
                explained += found["is_explained"]
            click.echo(
                f"{seed}: {np.sum(held)} of {np.size(held)} axes, {ratios[-1]:.2f} of the time", err=True
            )
    header = "| cameras | pairs | trusted | axes within 95 % intervals | regions of all six | one run, of the time |"
    shares = (f"{np.mean(held):.1%}", explained) if held else ("", "")
    row = (num_cameras, num_pairs, len(held), *shares, f"{np.median(ratios):.2f}")
    click.echo(markdown_table(header, [row]), nl=False)


if __name__ == "__main__":
    run_script(main)
