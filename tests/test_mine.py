import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from conftest import make_pose

from semcal_cli import core
from semcal_cli.estimation.refine.level_points import sample
from semcal_cli.estimation.refine.statistics_network import Adam, DonskerVaradhan, StatisticsNetwork
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.observations import Observations

ERROR = 0.1
CHANNEL_MI = math.log(2) + ERROR * math.log(ERROR) + (1 - ERROR) * math.log(1 - ERROR)
SAMPLING = 0.02  # nats; the standard error of the mean over so many pairs is a tenth of it
LEARNED = 0.03  # nats below the truth that a short training may end


def channel(count: int, generator: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
    """Pairs of a binary symmetric channel: x, and y as a one-hot vector."""
    x = torch.randint(2, (count,), generator=generator)
    flipped = torch.rand(count, generator=generator) < ERROR
    return x, torch.nn.functional.one_hot(x ^ flipped.long(), 2).float()


def expectations(statistics: torch.Tensor, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Over the pairs, and over all pairs of an x and a y, both x being equally frequent."""
    return statistics.gather(1, x[:, None]).mean(), statistics.exp().mean()


def test_the_bound_is_tight_at_the_pointwise_information() -> None:
    x, y = channel(100_000, torch.Generator().manual_seed(0))
    right, wrong = math.log(2 * (1 - ERROR)), math.log(2 * ERROR)
    statistics = y @ torch.tensor([[right, wrong], [wrong, right]])
    bound, _ = DonskerVaradhan(0.9)(*expectations(statistics, x))
    assert abs(bound.item() - CHANNEL_MI) < SAMPLING


def test_the_network_learns_the_channels_information() -> None:
    generator = torch.Generator().manual_seed(1)
    network, bound = StatisticsNetwork(2, 2, 16, generator), DonskerVaradhan(0.9)
    optimizer = torch.optim.Adam(network.parameters(), 1e-2)
    for _ in range(300):
        x, y = channel(2000, generator)
        _, objective = bound(*expectations(network(y), x))
        optimizer.zero_grad()
        (-objective).backward()
        optimizer.step()
    x, y = channel(100_000, generator)
    learned, _ = DonskerVaradhan(0.9)(*expectations(network(y), x))
    assert CHANNEL_MI - LEARNED < learned.item() < CHANNEL_MI + SAMPLING


def test_shares_have_the_derivative_of_the_pose(
    street_observations: Observations, street_truth: Pose
) -> None:
    points = core.AnchoredPoints(
        street_observations.without_edge_band.core, street_truth, factor=8, visible_only=False
    )
    indices = torch.arange(0, len(points.classes), 401)
    # Just beside the anchor: at the middle of a block the gradient jumps.
    T = torch.from_numpy(make_pose((1e-3, 2e-3, -1e-3), (0.01, 0.0, 0.0)) @ street_truth).requires_grad_()
    assert torch.autograd.gradcheck(
        lambda T: sample(points, indices, T)[1], (T,), eps=1e-7, atol=1e-4, rtol=1e-4
    )


def test_points_amid_one_class_count_as_if_drawn(
    street_observations: Observations, street_truth: Pose
) -> None:
    def joint(constant_radius: int) -> np.ndarray:
        points = core.AnchoredPoints(
            street_observations.core,
            street_truth,
            factor=4,
            visible_only=True,
            constant_radius=constant_radius,
        )
        counts.append(len(points.classes))
        batch = points.sample(np.arange(len(points.classes)), street_truth)
        return np.asarray(batch.weights.T @ batch.shares)

    counts: list[int] = []
    np.testing.assert_allclose(joint(3), joint(0), rtol=1e-6, atol=1e-6)
    assert 0 < counts[0] < counts[1]


def test_an_index_beyond_the_points_is_refused(street_observations: Observations, street_truth: Pose) -> None:
    points = core.AnchoredPoints(street_observations.core, street_truth, factor=4, visible_only=False)
    with pytest.raises(ValueError, match="an index is not one of the"):
        points.sample(np.array([len(points.classes)]), street_truth)


def descended(make: Callable[..., Any], set_rate: Callable[[Any, float], None]) -> list[torch.Tensor]:
    """The weights of a small network after steps of several rates."""
    generator = torch.Generator().manual_seed(2)
    network = StatisticsNetwork(3, 5, 8, generator)
    optimizer = make(network.parameters(), 1e-2, betas=(0.9, 0.99))
    for step in range(20):
        set_rate(optimizer, 1e-2 / (1 + step))
        network(torch.rand(64, 5, generator=generator)).square().sum().backward()
        optimizer.step()
        optimizer.zero_grad()
    return [weights.detach() for weights in network.parameters()]


def test_adam_is_torchs_to_the_last_bit() -> None:
    ours = descended(Adam, lambda adam, rate: setattr(adam, "rate", rate))
    torchs = descended(torch.optim.Adam, lambda adam, rate: adam.param_groups[0].update(lr=rate))
    for found, expected in zip(ours, torchs, strict=True):
        torch.testing.assert_close(found, expected, rtol=0.0, atol=0.0)


def test_a_network_leaves_torchs_random_numbers_alone() -> None:
    before = torch.get_rng_state()
    StatisticsNetwork(3, 5, 8, torch.Generator().manual_seed(2))
    assert torch.equal(torch.get_rng_state(), before)


def test_mine_loads_no_compiler(street: Path) -> None:
    # torch's compiler takes longer to load than several levels take.
    script = f"""
import sys
from semcal_cli.config.mine_config import MineConfig
from semcal_cli.drive.document import read_drive
from semcal_cli.observations.reading import load_observations
from semcal_cli.formats import read_transform
from semcal_cli.estimation.refine.mine import MineEstimator
observations = load_observations(read_drive({str(street)!r}))
config = MineConfig(steps_per_level=4, warm_up_steps=1)
MineEstimator(observations, config, 0).ascend(8, read_transform({str(street)!r}), visible_only=True)
assert not {{"sympy", "torch._dynamo"}} & set(sys.modules)
"""
    # Isolated, so that the installed package is loaded and not the sources in the working folder.
    subprocess.run([sys.executable, "-I", "-c", script], check=True)
