"""Rigs whose cameras are tied by known transforms: what these add to each camera alone, and wrong ones.

    python tests/benchmarks/rig_constraints.py --seeds 20

Synthetic rigs, each with another world and other mountings, 20 % wrong labels on both sides. Each camera is tied to the
next by its true transform with normal errors of `--sigma-m` and `--sigma-deg`. Prints a Markdown table: the errors of
the cameras alone and tied, how often 95 % intervals of tied cameras hold the truth, and how often a constraint that is
two degrees off is named, with the others alone left to draw the poses.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import yaml
from benchmark import SEMCAL, run_process, script, table

from semcal_cli.config.synthetic import SynthConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses, inverse
from semcal_cli.geometry.twists import pose_at
from semcal_cli.many.rig.adjustment import adjust
from semcal_cli.many.rig.rig_document import Constraint
from semcal_cli.result.calibration_document import CalibrationDocument, read_calibration
from semcal_cli.synthetic.synthesis import synthesize_rig

WRONG_DEG = 2.0


def main(
    *,
    seeds: int = 20,
    first_seed: int = 63_000,
    cameras: int = 4,
    frames: int = 5,
    sigma_m: float = 1e-3,
    sigma_deg: float = 0.01,
    width: int = 1280,
    cue: str = "auto",
) -> Iterator[str]:
    """Calibrate the cameras of each rig, and tie them."""
    config = SynthConfig(num_frames=frames, width=width, height=width * 9 // 16, label_noise=0.2)
    ratios, held, num_named, num_trusted = [], [], 0, 0
    for seed in range(first_seed, first_seed + seeds):
        rng = np.random.default_rng(seed)
        with TemporaryDirectory() as folder:
            rig, out = Path(folder) / "rig", Path(folder) / "out"
            synthesize_rig(replace(config, seed=seed), cameras, rig)
            run_process([*SEMCAL, "calibrate", str(rig), "-o", str(out), "--cue", cue, "-q"])
            names = list(yaml.safe_load((rig / "rig.yaml").read_text())["cameras"])
            truth = {name: np.array(read_drive(rig / name).T_camera_lidar) for name in names}
            alone = {
                name: read_calibration(out / f"{name}.yaml")
                for name in names
                if (out / f"{name}.yaml").exists()
            }
        trusted = {name: calibration for name, calibration in alone.items() if calibration.trusted}
        num_trusted += len(trusted)
        ties = [_tie(to, source, truth, sigma_m, sigma_deg, rng) for to, source in pairwise(trusted)]
        _, tied = adjust(trusted, ties)
        for name, (T, uncertainty) in tied.items():
            errors = [compare_poses(pose, truth[name]) for pose in (trusted[name].pose, T)]
            ratios.append([[error.rotation_deg, error.camera_center_cm] for error in errors])
            held.append(np.abs(errors[1].offsets) <= uncertainty.half_widths)
        num_named += _is_named(trusted, ties, rng)
    of_errors = np.array(ratios)
    alone_deg, alone_cm = np.median(of_errors[:, 0], axis=0)
    tied_deg, tied_cm = np.median(of_errors[:, 1], axis=0)
    yield from table(
        "cameras | trusted | alone, deg | cm | tied, deg | cm | axes within 95 % intervals | wrong constraints named",
        [
            (
                f"{seeds * cameras}",
                f"{num_trusted}",
                f"{alone_deg:.4f}",
                f"{alone_cm:.3f}",
                f"{tied_deg:.4f}",
                f"{tied_cm:.3f}",
                f"{np.mean(held):.1%}",
                f"{num_named} of {seeds}",
            )
        ],
    )


def _tie(
    to: str, source: str, truth: dict[str, Pose], sigma_m: float, sigma_deg: float, rng: np.random.Generator
) -> Constraint:
    sigmas = np.repeat([sigma_m, np.radians(sigma_deg)], 3)
    T = pose_at(truth[to] @ inverse(truth[source]), sigmas * rng.standard_normal(6))
    return Constraint.model_validate(
        {"from": source, "to": to, "T_to_from": T.tolist(), "sigma_m": sigma_m, "sigma_deg": sigma_deg}
    )


def _is_named(
    cameras: dict[str, CalibrationDocument], ties: list[Constraint], rng: np.random.Generator
) -> bool:
    """Turn one of the constraints, and see whether it alone is left out, and draws no camera."""
    if not ties:
        return False
    place, axis = int(rng.integers(len(ties))), rng.standard_normal(3)
    turn = np.radians(WRONG_DEG) * axis / np.linalg.norm(axis)
    wrong = pose_at(ties[place].pose, np.concatenate([np.zeros(3), turn]))
    spoiled = [
        tie if index != place else tie.model_copy(update={"T_to_from": wrong})
        for index, tie in enumerate(ties)
    ]
    adjustment, found = adjust(cameras, spoiled)
    _, expected = adjust(cameras, [tie for index, tie in enumerate(ties) if index != place])
    is_kept = [compared.is_explained for compared in adjustment.constraints]
    is_same = all(np.allclose(found[name][0], expected[name][0], atol=1e-12) for name in cameras)
    return is_same and is_kept == [index != place for index in range(len(ties))]


if __name__ == "__main__":
    script(main)
