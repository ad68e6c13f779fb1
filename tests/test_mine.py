import math

import torch

from semcal_cli.mine import DonskerVaradhan, StatisticsNetwork

ERROR = 0.1
CHANNEL_MI = math.log(2) + ERROR * math.log(ERROR) + (1 - ERROR) * math.log(1 - ERROR)
SAMPLING = 0.02  # nats; the standard error of the mean over so many pairs is a tenth of it
LEARNED = 0.03  # nats below the truth that a short training may end


def channel(count: int, generator: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
    """Pairs of a binary symmetric channel: x, and y as a one-hot vector."""
    x = torch.randint(2, (count,), generator=generator)
    flipped = torch.rand(count, generator=generator) < ERROR
    return x, torch.nn.functional.one_hot(x ^ flipped.long(), 2).float()


def test_the_bound_is_tight_at_the_pointwise_information() -> None:
    x, y = channel(100_000, torch.Generator().manual_seed(0))
    right, wrong = math.log(2 * (1 - ERROR)), math.log(2 * ERROR)
    statistics = y @ torch.tensor([[right, wrong], [wrong, right]])
    bound, _ = DonskerVaradhan(0.9)(statistics, x, torch.tensor([0.5, 0.5]), torch.ones(len(x)))
    assert abs(bound.item() - CHANNEL_MI) < SAMPLING


def test_any_other_statistic_gives_less() -> None:
    x, y = channel(100_000, torch.Generator().manual_seed(0))
    statistics = y @ torch.tensor([[0.5, -0.2], [-1.0, 0.3]])
    bound, _ = DonskerVaradhan(0.9)(statistics, x, torch.tensor([0.5, 0.5]), torch.ones(len(x)))
    assert bound.item() < CHANNEL_MI - SAMPLING


def test_the_network_learns_the_channels_information() -> None:
    generator = torch.Generator().manual_seed(1)
    network, bound = StatisticsNetwork(2, 2, 16, generator), DonskerVaradhan(0.9)
    optimizer = torch.optim.Adam(network.parameters(), 1e-2)
    for _ in range(300):
        x, y = channel(2000, generator)
        _, ascent = bound(network(y), x, torch.tensor([0.5, 0.5]), torch.ones(len(x)))
        optimizer.zero_grad()
        (-ascent).backward()
        optimizer.step()
    x, y = channel(100_000, generator)
    learned, _ = DonskerVaradhan(0.9)(network(y), x, torch.tensor([0.5, 0.5]), torch.ones(len(x)))
    assert CHANNEL_MI - LEARNED < learned.item() < CHANNEL_MI + SAMPLING
