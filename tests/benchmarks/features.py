"""Calibrate by features alone, as a Markdown table: labels replaced by random embeddings with noise.

    python tests/benchmarks/features.py --seeds 3 --first-seed 41000

Each side's classes get vectors of 16 random numbers, drawn independently; noise is added whose length is on average the
distance between two classes (`--noise` times as long). Labels are then thrown away. Runs start 2 degrees and 0.2 m off.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import cues
import numpy as np
import yaml
from benchmark import script, street, summary

from semcal_cli.api.calls import calibrate
from semcal_cli.config import CalibrationConfig, RefinementConfig
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.experiments.summary import NUMBER, common
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.observations.reading import read_observations

CHANNELS = 16
COLUMNS = (common("cue", "cue"), NUMBER, *cues.MEDIAN_AND_WORST)


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


def main(
    *,
    seeds: int = 3,
    first_seed: int = 41_000,
    frames: int = 20,
    width: int = 1280,
    noise: float = 1.0,
    from_nothing: bool = False,
) -> Iterator[str]:
    config = CalibrationConfig(cues=("features",), refinement=RefinementConfig("mine"))
    name, found = "features, from nothing" if from_nothing else "features", []
    for seed in range(first_seed, first_seed + seeds):
        with TemporaryDirectory() as folder:
            labelled, T = street(Path(folder) / "drive", seed, frames, width)
            initial_pose = None if from_nothing else cues.start(T, seed)
            calibration = calibrate(embedded(labelled, seed, noise), config, initial_pose=initial_pose)
            error = compare_poses(calibration.pose, T)
            errors = error.rotation_deg, error.camera_center_cm
            found.append(cues.Result("", name, *errors, calibration.status))
    yield from summary([found], COLUMNS)


if __name__ == "__main__":
    script(main)
