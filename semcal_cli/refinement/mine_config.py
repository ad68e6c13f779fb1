"""Settings of MINE, the paper's estimator. Nothing heavy is imported here, so that `semcal --help` can show them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from semcal_cli.config import EDGE_BAND_PX, MAX_BASELINE_M

Optimizer: TypeAlias = Literal["adam", "sgd"]


@dataclass(frozen=True)
class MineConfig:
    """Network, learning rates, scheduler and batches of MINE (Alg. 1).

    Steps of the pose are in motions that each move the points by one block, independently of one another, so that they
    fit any lens, picture and scene.
    """

    steps_per_level: int = 80
    """Steps of theta and pose together at each level."""
    warm_up_steps: int = 60
    """Steps at the first level in which only theta learns. Later levels take a third of it."""
    batch_size: int = 2048
    """Points in a mini-batch."""
    max_points: int = 200_000
    """Points, over all frames and directions, that are looked at."""
    constant_radius: int = 8
    """Points at least this number of blocks inside one class are summed up once: steps do not take them out of it."""
    num_hidden: int = 32
    """Units of each hidden layer of the network."""
    num_embedding: int = 16
    """Dimensions of the space in which vectors of points and of pixels are compared."""
    learning_rate_theta: float = 1e-2
    """Learning rate of the network's parameters theta."""
    learning_rate_pose: float = 0.15
    """Learning rate of the pose, in blocks."""
    final_rate: float = 0.05
    """Share of the pose's rate that is left at each level's end. The scheduler lowers it along a cosine."""
    mean_decay: float = 0.9
    """Decay of the running mean in the bias-corrected gradient."""
    max_baseline_m: float = MAX_BASELINE_M
    """Largest distance between camera and LiDAR."""
    edge_band_px: int = EDGE_BAND_PX
    """Pixels less than this from one of another class count a tenth."""
    optimizer: Optimizer = "adam"
    """Optimiser of theta and of the pose."""
    min_points: int = 50
    """A level with fewer points tells nothing, and the pose stays as it is."""


MINE_WITH_VECTORS = MineConfig(
    steps_per_level=120, warm_up_steps=100, batch_size=1024, num_hidden=64, learning_rate_theta=3e-3
)
"""Defaults for feature vectors, of which a mini-batch says less than of labels."""
