"""Compares gradient ascent with Powell's method on the same mutual information: the paper's reason for gradients.

    python tests/benchmarks/gradient.py [--seeds 20]

From the same starts, both maximise the exact mutual information of the same points over the same pyramid, where each
level starts at the end of the one before. Adam follows the gradient; Powell's method, that of SciPy with its default
tolerances, compares values only. Writes results.csv, summary.json and table.md to a folder in `semcal_experiments`,
where a stopped run resumes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np
import numpy.typing as npt
from benchmark import OUTPUT, KeptTable, run_experiment, script

from semcal_cli import core
from semcal_cli.config import FAR_DEG, ExactConfig, PyramidConfig
from semcal_cli.estimation.refine.pyramid import pyramid_factors
from semcal_cli.experiments.drives import Pool
from semcal_cli.experiments.experiment_run import Experiment, Report
from semcal_cli.experiments.pairs_and_noise import START_DEG, START_M
from semcal_cli.experiments.summary import ERRORS, NUMBER, SECONDS, Column, common, digits, measure_of, median
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses, cross_matrix
from semcal_cli.geometry.twists import apply_twist, displace
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.reading import load_observations

NUM_PAIRS = 5
"""Number of pairs of each drive."""
MAX_POINTS = 20_000
"""Number of randomly chosen points of a level, all of which each evaluation uses."""
BETAS, EPSILON = (0.9, 0.999), 1e-8
"""Adam's decay rates, and its constant that keeps steps finite."""

Array = npt.NDArray[np.float64]
Optimizer = Callable[["Objective"], Pose]


class Objective:
    """The exact mutual information of chosen points at one level of the pyramid, and its gradient."""

    def __init__(self, observations: Observations, T_start: Pose, factor: int, seed: int) -> None:
        """Choose among the points that lie in the image at the start.

        Args:
            observations: Labelled points and label images of all frames.
            T_start: (4, 4) T_camera_lidar at which the level starts.
            factor: Side of a block in pixels.
            seed: Seed of the choice of points.
        """
        self.points = core.AnchoredPoints(
            observations.without_edge_band.core, T_start, factor=factor, visible_only=False
        )
        count = len(self.points.classes)
        chosen = np.random.default_rng(seed).permutation(count)[:MAX_POINTS]
        self.indices: npt.NDArray[np.int64] = np.sort(chosen).astype(np.int64)
        self.T_start, self.num_evaluations = T_start, 0

    def pose(self, v: Array) -> Pose:
        """Pose (4, 4) at a twist v (6,), a unit of each of whose entries moves the points by one block."""
        return apply_twist(self.T_start, self.points.preconditioner @ v)

    def value(self, T: Pose) -> float:
        """Mutual information at a pose, in nats."""
        return self._evaluate(T)[0]

    def gradient(self, T: Pose) -> Array:
        """Derivative (6,) of the mutual information by a twist on the left of a pose, in blocks."""
        _, pointwise, total, batch = self._evaluate(T)
        # The marginals contribute a constant to the derivative of sum p log p / (p_x p_y).
        of_shares = batch.weights @ pointwise / total
        of_T = batch.pull_back(of_shares)
        generators = np.zeros((6, 3, 4))
        for axis in range(3):
            generators[axis, axis, 3] = 1.0
            generators[3 + axis] = cross_matrix(np.eye(3)[axis]) @ T[:3]
        twist: Array = np.einsum("kij,ij->k", generators, of_T)
        return np.asarray(self.points.preconditioner.T @ twist)

    def _evaluate(self, T: Pose) -> tuple[float, Array, float, core.MiniBatch]:
        """Compute the mutual information, its pointwise values (C_x, C_y), the histogram's sum, and the batch."""
        self.num_evaluations += 1
        batch = self.points.sample(self.indices, T)
        joint = batch.weights.T @ batch.shares
        total = max(float(joint.sum()), np.finfo(np.float64).tiny)
        joint = joint / total
        independent = joint.sum(1, keepdims=True) * joint.sum(0, keepdims=True)
        seen = joint > 0.0
        pointwise = np.zeros_like(joint)
        pointwise[seen] = np.log(joint[seen] / independent[seen])
        return float((joint * pointwise).sum()), pointwise, total, batch


def ascend(objective: Objective) -> Pose:
    """Ascend the gradient with Adam, whose step size falls along a cosine."""
    config, T = ExactConfig(), objective.T_start
    mean, square = np.zeros(6), np.zeros(6)
    for step in range(config.steps):
        gradient = objective.gradient(T)
        mean = BETAS[0] * mean + (1.0 - BETAS[0]) * gradient
        square = BETAS[1] * square + (1.0 - BETAS[1]) * gradient**2
        corrected = mean / (1.0 - BETAS[0] ** (step + 1))
        spread = np.sqrt(square / (1.0 - BETAS[1] ** (step + 1)))
        cosine = 0.5 * (1.0 + math.cos(math.pi * step / config.steps))
        rate = config.step_size * (config.final_step + (1.0 - config.final_step) * cosine)
        T = apply_twist(T, objective.points.preconditioner @ (rate * corrected / (spread + EPSILON)))
    return T


def climb_by_powell(objective: Objective) -> Pose:
    """Maximise with Powell's method."""
    from scipy.optimize import minimize

    def loss(v: Array) -> float:
        return -objective.value(objective.pose(v))

    return objective.pose(minimize(loss, np.zeros(6), method="Powell").x)


OPTIMIZERS: dict[str, Optimizer] = {"gradient": ascend, "Powell": climb_by_powell}


@dataclass(frozen=True)
class Case:
    """One optimiser on the drive of one seed."""

    optimizer: str
    """Key of `OPTIMIZERS`."""
    seed: int
    """Seed of the drive."""


@dataclass(frozen=True)
class Result:
    """The end of one optimisation."""

    optimizer: str
    seed: int
    rotation_deg: float
    camera_center_cm: float
    num_evaluations: int
    """Number of evaluations of the mutual information or of its gradient, over all levels."""
    seconds: float
    """Time from pairs in memory to a pose."""


def cases(seeds: range) -> list[Case]:
    """List the runs; the optimisers take turns, so that a busy machine slows both."""
    return [Case(optimizer, seed) for seed in seeds for optimizer in OPTIMIZERS]


def run(pool: Pool, changes: Mapping[str, object], case: Case) -> list[Result]:
    """Maximise over the pyramid from a wrong start, on a drive with some changes to its `SynthConfig`."""
    drive, truth = pool.read("drive", {**changes, "num_frames": NUM_PAIRS}, case.seed)
    observations = load_observations(drive)
    T = displace(truth, START_DEG, START_M, np.random.default_rng(case.seed))
    _ = observations.core
    start, num_evaluations = perf_counter(), 0
    for factor in pyramid_factors(drive.camera, PyramidConfig(coarsest_block_deg=FAR_DEG)):
        objective = Objective(observations, T, factor, case.seed)
        T = OPTIMIZERS[case.optimizer](objective)
        num_evaluations += objective.num_evaluations
    seconds, error = perf_counter() - start, compare_poses(T, truth)
    errors = error.rotation_deg, error.camera_center_cm
    return [Result(case.optimizer, case.seed, *errors, num_evaluations, seconds)]


COLUMNS = (
    common("optimizer", ""),
    NUMBER,
    *ERRORS,
    Column("evaluations", {"num_evaluations": measure_of("num_evaluations", median)}, digits(0)),
    SECONDS,
)


def main(*, seeds: int = 20, first_seed: int = 55_000, jobs: int = 1, output: Path = OUTPUT) -> KeptTable:
    """Run both optimisers on each drive."""
    folder = output / "gradient"
    drives = folder / "drives"
    listed = cases(range(first_seed, first_seed + seeds))
    run_case, report = partial(run, Pool(drives), {}), partial(Report.of, columns=COLUMNS)
    return run_experiment(
        Experiment("gradient", folder, listed, run_case, Result, report, scratch=drives), jobs
    )


if __name__ == "__main__":
    script(main)
