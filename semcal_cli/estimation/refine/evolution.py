"""An evolution strategy on poses, which finds high maxima of a rugged objective where its slope does not lead to them.

Source: Hansen, *The CMA Evolution Strategy: A Tutorial* (arXiv 1604.00772).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.geometry.twists import pose_at

STEP_DEG, STEP_M = 0.17, 0.046
"""Standard deviations of the first poses in rotation and in translation, geometric means over all directions. On a
street of KITTI-360, half of it and as much again find the highest maximum about as often."""
MAX_GENERATIONS, PATIENCE = 100, 15
"""Number of generations, and of those in a row that find no better pose, after which the search ends. Most end after 14
to 37."""
SETTLED = 0.2
"""The search also ends when the poses of a generation spread by less than this share of the first ones."""
MIN_VARIANCE = 1e-6
"""Smallest variance of a direction beside the largest."""


def evolve(objective: Callable[[Pose], float], T_start: Pose, shape: Matrix, seed: int) -> Pose:
    """Look for the highest value of an objective around a pose.

    Args:
        objective: Function of a pose (4, 4); more is better.
        T_start: (4, 4) mean of the first poses, metres.
        shape: (6, 6) covariance of the first poses but for its scale, twists in metres and radians. By an inverse
            curvature, poses spread far where the objective changes little.
        seed: Seed of the poses.

    Returns:
        The best pose (4, 4); the start if none is better.
    """
    from cmaes import CMA

    variances, directions = np.linalg.eigh(0.5 * (shape + shape.T))
    variances = np.maximum(variances, MIN_VARIANCE * variances.max())
    step = np.sqrt(np.radians(STEP_DEG) * STEP_M)
    axes = directions * (step * np.sqrt(variances / np.exp(np.log(variances).mean())))
    strategy = CMA(mean=np.zeros(len(axes)), sigma=1.0, seed=seed)
    T_best, highest, num_vain = T_start, objective(T_start), 0
    for _ in range(MAX_GENERATIONS):
        steps = [strategy.ask() for _ in range(strategy.population_size)]
        poses = [pose_at(T_start, axes @ step) for step in steps]
        values = [objective(T) for T in poses]
        strategy.tell([(step, -value) for step, value in zip(steps, values, strict=True)])
        best = int(np.argmax(values))
        num_vain += 1
        if values[best] > highest:
            T_best, highest, num_vain = poses[best], values[best], 0
        if num_vain > PATIENCE or np.std(steps, axis=0).max() < SETTLED:
            break
    return T_best
