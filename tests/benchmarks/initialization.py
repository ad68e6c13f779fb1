"""Prints a Markdown table: the initial calibration against the truth, over mountings, sensors, lenses and label noise.

python tests/benchmarks/initialization.py --pool DIR --first-seed 2000 --seeds 20

Drives are synthesised once and kept in DIR; each is used with its four frames, and with each frame alone.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from semcal_cli.drive import read_drive
from semcal_cli.formats import read_transform
from semcal_cli.initialization import InitializationConfig, initialize
from semcal_cli.metrics import compare_poses
from semcal_cli.observations import Observations, load_observations
from semcal_cli.synthesis import synthesize
from semcal_cli.synthesis_config import SynthConfig

NUM_FRAMES = 4
ANY_ROLL = 180.0

CONDITIONS: dict[str, dict[str, object]] = {
    "64 channels, 90-degree lens, any azimuth": {},
    "camera forward": {"camera_azimuth_deg": 0.0},
    "camera left": {"camera_azimuth_deg": 90.0},
    "camera right": {"camera_azimuth_deg": -90.0},
    "camera backward": {"camera_azimuth_deg": 180.0},
    "32 channels": {"channels": 32},
    "16 channels": {"channels": 16},
    "rosette, no lidar block": {"pattern": "rosette"},
    "70-degree lens": {"hfov_deg": 70.0},
    "35-degree lens": {"lens": "narrow"},
    "100-degree lens": {"lens": "wide"},
    "20 % wrong labels on both sides": {"label_noise": 0.2},
    "50 % wrong labels on both sides": {"label_noise": 0.5},
    "disjoint ontologies": {"ontology": "disjoint"},
    "baseline 0.1 m": {"baseline_m": 0.1},
    "baseline 0.5 m": {"baseline_m": 0.5},
    "baseline 1 m": {"baseline_m": 1.0},
    "camera pitched 35 degrees up": {"camera_pitch_deg": 35.0},
    "camera pitched 35 degrees down": {"camera_pitch_deg": -35.0},
    "camera rolled 45 degrees, `--roll any`": {"camera_roll_deg": 45.0},
    "camera rolled 90 degrees, `--roll any`": {"camera_roll_deg": 90.0},
    "LiDAR tilted 20 degrees": {"lidar_tilt_deg": 20.0},
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pool", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=2000)
    parser.add_argument("--only-synthesise", action="store_true")
    arguments = parser.parse_args()
    for name, changes in CONDITIONS.items():
        for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
            config = SynthConfig(**{"num_frames": NUM_FRAMES, "seed": seed, **changes})
            path = arguments.pool / f"{name.replace(' ', '_')}_{seed}"
            if not (path / "drive.yaml").exists():
                synthesize(config, path, force=True)
                for picture in (path / "images").iterdir():
                    picture.unlink()


if __name__ == "__main__":
    main()
