import math

import numpy as np
import pytest
import torch
from conftest import make_pose

from semcal_cli import _core
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.poses import Pose
from semcal_cli.refinement.labelled_points import sample_shares
from semcal_cli.refinement.network import DonskerVaradhan, StatisticsNetwork

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


def test_any_other_statistic_gives_less() -> None:
    x, y = channel(100_000, torch.Generator().manual_seed(0))
    statistics = y @ torch.tensor([[0.5, -0.2], [-1.0, 0.3]])
    bound, _ = DonskerVaradhan(0.9)(*expectations(statistics, x))
    assert bound.item() < CHANNEL_MI - SAMPLING


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
    points = _core.AnchoredPoints(
        street_observations.core, street_truth, factor=8, edge_band_px=0, visible_only=False
    )
    indices = torch.arange(0, len(points.classes), 401)
    # Just beside the anchor: at the middle of a block the gradient jumps.
    T = torch.from_numpy(make_pose((1e-3, 2e-3, -1e-3), (0.01, 0.0, 0.0)) @ street_truth).requires_grad_()
    assert torch.autograd.gradcheck(
        lambda T: sample_shares(points, indices, T), (T,), eps=1e-7, atol=1e-4, rtol=1e-4
    )


def test_shares_add_up_to_one(street_observations: Observations, street_truth: Pose) -> None:
    points = _core.AnchoredPoints(
        street_observations.core, street_truth, factor=4, edge_band_px=0, visible_only=True
    )
    indices = torch.arange(0, len(points.classes), 97)
    shares = sample_shares(points, indices, torch.from_numpy(street_truth))
    torch.testing.assert_close(shares.sum(1), torch.ones(len(indices), dtype=torch.float64))


def test_an_index_beyond_the_points_is_refused(street_observations: Observations, street_truth: Pose) -> None:
    points = _core.AnchoredPoints(
        street_observations.core, street_truth, factor=4, edge_band_px=0, visible_only=False
    )
    with pytest.raises(ValueError, match="an index is not one of the"):
        points.shares(np.array([len(points.classes)]), street_truth)
