"""Settings of MINE, the paper's estimator. Nothing heavy is imported here, so that `semcal --help` is fast."""

from __future__ import annotations

from dataclasses import dataclass

from semcal_cli.config.setting import setting


@dataclass(frozen=True)
class MineConfig:
    """Network, learning rates, scheduler and batches of MINE (Alg. 1).

    The pose is stepped in independent motions, each of which moves the points by one block. The same step sizes then
    suit any lens, image and scene.
    """

    steps_per_level: int = setting(
        80, "Steps at each level of the pyramid.", minimum=1, maximum=100_000, option="--mine-steps"
    )
    warm_up_steps: int = setting(
        60,
        "Steps at the first level before the pose moves; later levels take a third of them.",
        minimum=0,
        maximum=100_000,
        option="--mine-warm-up",
    )
    batch_size: int = setting(
        2048, "Points in a mini-batch.", minimum=1, maximum=1 << 20, option="--mine-batch"
    )
    max_points: int = 40_000
    """Number of points in the images that is enough, over all frames."""
    constant_radius: int = 8
    """Points at least this many blocks inside one class are summed up once, because steps do not move them out of
    it."""
    num_hidden: int = setting(
        32, "Units in each hidden layer of the network.", minimum=1, maximum=4096, option="--mine-units"
    )
    num_embedding: int = 16
    """Dimension of the space in which the vectors of points and pixels are compared."""
    learning_rate_theta: float = setting(
        1e-2, "Learning rate of the network.", above=0.0, option="--mine-theta-rate", metavar="R"
    )
    learning_rate_pose: float = setting(
        0.15,
        "Learning rate of the pose, in blocks of a level.",
        above=0.0,
        option="--mine-pose-rate",
        metavar="R",
    )
    final_rate: float = 0.05
    """Learning rate of the pose at the end of each level, relative to its start. It decreases along a cosine."""
    mean_decay: float = 0.9
    """Decay of the running mean in the bias-corrected gradient."""
    min_points: int = 50
    """A level with fewer points leaves the pose unchanged."""


MINE_WITH_VECTORS = MineConfig(
    steps_per_level=120, warm_up_steps=100, batch_size=1024, num_hidden=64, learning_rate_theta=3e-3
)
"""Defaults for feature vectors, of which a mini-batch contains less information than of labels."""
