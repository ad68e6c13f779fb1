"""Calibrate by features alone, as a Markdown table: labels replaced by random embeddings with noise.

    python tests/benchmarks/features.py --seeds 3 --first-seed 41000

Each side's classes get vectors of 16 random numbers, drawn independently; noise is added whose length is on average the
distance between two classes. Labels are then thrown away. Runs start 2 degrees and 0.2 m off.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import click
import cues
import numpy as np
import yaml

from semcal_cli.config import CalibrationConfig, RefinementConfig
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.reading import read_observations
from semcal_cli.experiments.page_tables import run_script
from semcal_cli.experiments.summary import markdown_table
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.initialization.initial_pose import InitialPose
from semcal_cli.pipeline import calibrate
from semcal_cli.synthetic.synthesis import synthesize

CHANNELS = 16


def embedded(drive: Drive, seed: int, noise: float) -> Drive:
    """Write features beside a drive, and give one that has these and no labels."""
    observations = read_observations(drive)
    rng = np.random.default_rng(seed)
    document = yaml.safe_load(drive.path.read_text())
    for key in ("classes", "ignore", "T_camera_lidar"):
        document.pop(key, None)
    sides = {
        "point": [cloud.classes for cloud in observations.clouds],
        "image": [image.classes for image in observations.images],
    }
    centres = {side: rng.normal(size=(256, CHANNELS)) for side in sides}
    # Two random vectors are on average sqrt(2 C) apart; noise of unit variance is sqrt(C) long.
    sigma = noise * np.sqrt(2.0)
    for number, frame in enumerate(document["frames"]):
        for side, classes in sides.items():
            vectors = centres[side][classes[number]]
            vectors = vectors + sigma * rng.normal(size=vectors.shape)
            name = f"{side}_features_{number:06d}.npy"
            np.save(drive.root / name, vectors.astype(np.float16))
            frame[f"{side}_features"] = name
        del frame["point_labels"], frame["image_labels"], frame["image"]
    path = drive.root / "features.yaml"
    path.write_text(yaml.dump(document))
    return read_drive(path)


@click.command()
@click.option("--seeds", default=3)
@click.option("--first-seed", default=41000)
@click.option("--frames", default=20)
@click.option("--width", default=1280)
@click.option("--noise", default=1.0, help="Length of the noise by the distance between classes.")
@click.option("--from-nothing", is_flag=True)
def main(seeds: int, first_seed: int, frames: int, width: int, noise: float, from_nothing: bool) -> None:
    """Print the table."""
    errors = []
    for seed in range(first_seed, first_seed + seeds):
        with TemporaryDirectory() as folder:
            street = SynthConfig(num_frames=frames, seed=seed, width=width, height=width * 9 // 16)
            synthesize(street, Path(folder) / "drive")
            labelled = read_drive(Path(folder) / "drive")
            T, drive = read_transform(labelled.path), embedded(labelled, seed, noise)
            begin = perf_counter()
            initial_pose = None if from_nothing else InitialPose(cues.start(T, seed), "start")
            config = CalibrationConfig(cues=("features",), refinement=RefinementConfig("mine"))
            calibration = calibrate(drive, config, initial_pose=initial_pose)
            error = compare_poses(calibration.pose, T)
            errors.append((error.rotation_deg, error.camera_center_cm))
            click.echo(f"seed {seed}: {perf_counter() - begin:.0f} s", err=True)
    (deg, cm), name = np.array(errors).T, "features, from nothing" if from_nothing else "features"
    of_deg, of_cm = f"{np.median(deg):.4f}, {deg.max():.4f}", f"{np.median(cm):.2f}, {cm.max():.2f}"
    header = "| cue | n | rotation, deg: median, worst | camera centre, cm: median, worst |"
    click.echo(markdown_table(header, [(name, len(errors), of_deg, of_cm)]), nl=False)


if __name__ == "__main__":
    run_script(main)
