"""Set cues beside each other on synthetic drives, as a Markdown table: labels, edges and intensity, alone and together.

    python tests/benchmarks/cues.py --seeds 10 --first-seed 40000
    python tests/benchmarks/cues.py --cue edges --rig 16_channels --rig rosette --rig narrow --rig wide --rig fisheye

Every run starts 2 degrees and 0.2 m off, in a direction of its own. Beside the errors: how intensity and grey values
spread within classes and between them, so that one sees that they are no labels by other names.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import reduce
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from semcal_cli import _core
from semcal_cli.cli.options import CUES as CUE_NAMES
from semcal_cli.config import CalibrationConfig
from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.cues.table import summed
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.loading import LoadedDrive, load
from semcal_cli.drive.reading import read_frame_image
from semcal_cli.experiments.accuracy import RIGS as RIGS_BY_LABELS
from semcal_cli.experiments.page_tables import run_script
from semcal_cli.formats import read_transform
from semcal_cli.geometry.poses import Pose, camera_center, compare_poses
from semcal_cli.initialization.initial_pose import InitialPose
from semcal_cli.pipeline import calibrate
from semcal_cli.synthetic.label_noise import as_by_a_network
from semcal_cli.synthetic.synthesis import synthesize

START_DEG, START_M = 2.0, 0.2
CUES = ("labels", "edges", "intensity", "labels,edges", "labels,intensity")
RIGS: dict[str, dict[str, object]] = RIGS_BY_LABELS | {"fisheye": {"lens": "fisheye"}}


def start(T: Pose, seed: int) -> Pose:
    """A pose that is off by the angle and the distance."""
    rng = np.random.default_rng(seed)
    axis, direction = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    R = Rotation.from_rotvec(np.radians(START_DEG) * axis).as_matrix() @ T[:3, :3]
    off = np.eye(4)
    off[:3, :3], off[:3, 3] = R, -R @ (camera_center(T) + START_M * direction)
    return off


def spreads(drive: Drive, T: Pose) -> tuple[float, float]:
    """Standard deviation within classes by that between them, of intensity and of grey values, over visible points."""
    values: list[np.ndarray] = []
    for frame in drive.frames:
        cloud = np.fromfile(drive.resolve(frame.points), np.float32).reshape(-1, 4)
        labels = np.fromfile(drive.resolve(str(frame.point_labels)), np.uint32) & 0xFFFF
        projected = _core.project_points(core_camera(drive.camera), cloud[:, :3].copy(), T)
        seen = np.isfinite(projected.ranges) & ~projected.is_hidden
        picture = read_frame_image(drive, frame)
        assert picture is not None
        u, v = np.rint(projected.pixels[seen]).astype(int).T
        grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        grey = grey[v.clip(0, grey.shape[0] - 1), u.clip(0, grey.shape[1] - 1)]
        values.append(np.column_stack([labels[seen], cloud[seen, 3], grey]))
    labels, *both = np.concatenate(values).T
    ids, counts = np.unique(labels, return_counts=True)
    found = []
    for side in both:
        means = np.array([side[labels == id_].mean() for id_ in ids])
        variances = np.array([side[labels == id_].var() for id_ in ids])
        between = np.average((means - side.mean()) ** 2, weights=counts)
        found.append(float(np.sqrt(np.average(variances, weights=counts) / between)))
    return found[0], found[1]


def run(
    street: SynthConfig, cues: Sequence[str], *, by_network: bool
) -> Iterator[tuple[str, float, float, str]]:
    """One drive, by every cue: errors in degrees and centimetres, and the status."""
    with TemporaryDirectory() as folder:
        synthesize(street, Path(folder) / "drive")
        drive = read_drive(Path(folder) / "drive")
        T = read_transform(drive.path)
        within = spreads(drive, T)
        click.echo(
            f"seed {street.seed}: within by between classes {within[0]:.2f}, {within[1]:.2f}", err=True
        )
        for cue in cues:
            config = CalibrationConfig(cues=tuple(CUE_NAMES.convert(cue, None, None)))
            data = load(drive, config)
            if by_network and "labels" in config.cues:
                data = _by_network(data, np.random.default_rng(street.seed))
            calibration = calibrate(data, config, initial_pose=InitialPose(start(T, street.seed), "start"))
            error = compare_poses(calibration.pose, T)
            yield cue, error.rotation_deg, error.camera_center_cm, calibration.status


def _by_network(data: LoadedDrive, rng: np.random.Generator) -> LoadedDrive:
    """Make the labels those of a network, and leave other cues as they are."""
    labels = as_by_a_network(data.of_cue("labels"), rng)
    others = [data.of_cue(cue) for cue in data.cues if cue != "labels"]
    return replace(data, observations=reduce(summed, [labels, *others]))


@click.command()
@click.option("--seeds", default=10)
@click.option("--first-seed", default=40000)
@click.option("--cue", "cues", multiple=True, default=CUES)
@click.option("--rig", "rigs", multiple=True, type=click.Choice(list(RIGS)), default=["default"])
@click.option("--label-noise", default=0.0)
@click.option("--by-network", is_flag=True, help="Labels of both sides as by a network.")
@click.option("--frames", default=20, show_default=True)
@click.option("--width", default=1280, show_default=True, help="Columns of the pictures, 16 to 9.")
def main(
    seeds: int,
    first_seed: int,
    cues: Sequence[str],
    rigs: Sequence[str],
    label_noise: float,
    by_network: bool,
    frames: int,
    width: int,
) -> None:
    """Print the table."""
    print("| rig | cue | n | rotation, deg: median, worst | camera centre, cm: median, worst | trusted |")
    print("|---|---|---|---|---|---|")
    for rig in rigs:
        common: dict[str, Any] = {"width": width, "height": width * 9 // 16, **RIGS[rig]}
        streets = [
            SynthConfig(num_frames=frames, seed=seed, label_noise=label_noise, **common)
            for seed in range(first_seed, first_seed + seeds)
        ]
        results = [result for street in streets for result in run(street, cues, by_network=by_network)]
        for cue in cues:
            found = [result for result in results if result[0] == cue]
            (deg, cm), trusted = np.array([r[1:3] for r in found]).T, sum(r[3] == "trusted" for r in found)
            cells = f"{np.median(deg):.4f}, {deg.max():.4f} | {np.median(cm):.2f}, {cm.max():.2f} | {trusted}"
            print(f"| {rig} | {cue} | {len(found)} | {cells} |", flush=True)


if __name__ == "__main__":
    run_script(main)
