"""Set cues beside each other on synthetic drives, as a Markdown table: labels, edges and intensity, alone and together.

    python tests/benchmarks/cues.py --seeds 10 --first-seed 40000
    python tests/benchmarks/cues.py --cue edges --rig 16_channels --rig rosette --rig narrow --rig wide --rig fisheye

Every run starts 2 degrees and 0.2 m off, in a direction of its own. On stderr: how intensity and grey values spread
within classes and between them, so that one sees that they are no labels by other names.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import reduce
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import cv2
import numpy as np
from benchmark import script, street, summary
from laboratory.label_errors import imitate_network
from laboratory.rates import median_and_worst
from laboratory.rigs import RIGS

from semcal_cli import core
from semcal_cli.cli.options import CUES as CUE_NAMES
from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.document import Drive
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.experiments.summary import NUMBER, common, count, error_columns
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.cues.cue_table import summed
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.observations.reading import read_frame_image
from semcal_cli.pipeline import calibrate

START_DEG, START_M = 2.0, 0.2
CUES = ("labels", "edges", "intensity", "labels,edges", "labels,intensity")
FISHEYE: dict[str, dict[str, object]] = {"fisheye": {"lens": "fisheye"}}
MEDIAN_AND_WORST = error_columns("median, worst", median_and_worst)
COLUMNS = (
    common("rig", "rig"),
    common("cue", "cue"),
    NUMBER,
    *MEDIAN_AND_WORST,
    count("trusted", lambda result: result.status == "trusted"),
)


class Result(NamedTuple):
    """Where a run ended."""

    rig: str
    cue: str
    rotation_deg: float
    camera_center_cm: float
    status: str


def start(T: Pose, seed: int) -> InitialPose:
    """A pose that is off by the angle and the distance."""
    return InitialPose(displace(T, START_DEG, START_M, np.random.default_rng(seed)), "start")


def spreads(drive: Drive, T: Pose) -> str:
    """Standard deviation within classes by that between them, of intensity and of grey values, over visible points."""
    values: list[np.ndarray] = []
    for frame in drive.frames:
        cloud = np.fromfile(drive.resolve(frame.points), np.float32).reshape(-1, 4)
        labels = np.fromfile(drive.resolve(str(frame.point_labels)), np.uint32) & 0xFFFF
        projected = core.project_points(core_camera(drive.camera), cloud[:, :3].copy(), T)
        seen = np.isfinite(projected.ranges) & ~projected.is_hidden
        image = read_frame_image(drive, frame)
        assert image is not None
        u, v = np.rint(projected.pixels[seen]).astype(int).T
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        grey = grey[v.clip(0, grey.shape[0] - 1), u.clip(0, grey.shape[1] - 1)]
        values.append(np.column_stack([labels[seen], cloud[seen, 3], grey]))
    labels, *both = np.concatenate(values).T
    ids, counts = np.unique(labels, return_counts=True)
    found = []
    for side in both:
        means, variances = ([f(side[labels == id_]) for id_ in ids] for f in (np.mean, np.var))
        between = np.average((np.array(means) - side.mean()) ** 2, weights=counts)
        found.append(np.sqrt(np.average(variances, weights=counts) / between))
    return ", ".join(f"{each:.2f}" for each in found)


def by_a_network(data: LoadedDrive, rng: np.random.Generator) -> LoadedDrive:
    """Make the labels those of a network, and leave other cues as they are."""
    labels = imitate_network(data.of_cue("labels"), rng)
    others = [data.of_cue(cue) for cue in data.cues if cue != "labels"]
    return replace(data, observations=reduce(summed, [labels, *others]))


def run(rig: str, cue: str, drive: Drive, T: Pose, seed: int, by_network: bool) -> Result:
    """Calibrate a drive by cues, and compare with the truth."""
    config = CalibrationConfig(cues=tuple(CUE_NAMES.convert(cue, None, None)))
    data = load(drive, config)
    if by_network and "labels" in config.cues:
        data = by_a_network(data, np.random.default_rng(seed))
    calibration = calibrate(data, config, initial_pose=start(T, seed))
    error = compare_poses(calibration.pose, T)
    return Result(rig, cue, error.rotation_deg, error.camera_center_cm, calibration.status)


def main(
    *,
    seeds: int = 10,
    first_seed: int = 40_000,
    cue: tuple[str, ...] = CUES,
    rig: tuple[str, ...] = ("default",),
    label_noise: float = 0.0,
    by_network: bool = False,
    frames: int = 20,
    width: int = 1280,
) -> Iterator[str]:
    """Calibrate each drive by every cue."""

    def results(name: str) -> list[Result]:
        more: dict[str, Any] = {"label_noise": label_noise, **(RIGS | FISHEYE)[name]}
        found = []
        for seed in range(first_seed, first_seed + seeds):
            with TemporaryDirectory() as folder:
                drive, T = street(Path(folder) / "drive", seed, frames, width, **more)
                print(f"seed {seed}: within by between classes {spreads(drive, T)}", file=sys.stderr)
                found += [run(name, each, drive, T, seed, by_network) for each in cue]
        return found

    yield from summary(map(results, rig), COLUMNS)


if __name__ == "__main__":
    script(main)
