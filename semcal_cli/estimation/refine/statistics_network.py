"""Statistics networks F(x, y), the Donsker-Varadhan bound on mutual information (eq. 5), and its optimiser.

Source: Belghazi et al., *Mutual Information Neural Estimation* (arXiv 1801.04062), with its bias-corrected gradient.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import torch
from torch import Tensor

from semcal_cli.config.mine_config import MineConfig

MAX_STATISTIC = 30.0
"""Upper bound of a statistic, so that its exponential does not overflow in float32 sums."""
EPSILON = 1e-8
"""Keeps the steps of Adam finite."""


class StatisticsNetwork(torch.nn.Module):
    """F(x, y) for discrete x and a vector y of class shares: one output for each x.

    With an output for each x, the expectation over x in the second term of the bound is a sum over all classes instead
    of shuffled pairs. That removes most of the noise of the estimate at half the cost.
    """

    def __init__(self, num_x: int, num_y: int, num_hidden: int, generator: torch.Generator) -> None:
        """Initialise theta at random.

        Args:
            num_x: Number of classes of x.
            num_y: Number of classes of y.
            num_hidden: Width of each hidden layer.
            generator: Generator of the weights.
        """
        super().__init__()
        self.layers = _perceptron([num_y, num_hidden, num_hidden, num_x], generator)

    def forward(self, y: Tensor) -> Tensor:
        """Compute F(x, y_i) for all x: (N, num_y) float32 -> (N, num_x) float32."""
        output: Tensor = self.layers(y)
        return output


class SeparableNetwork(torch.nn.Module):
    """F(x, y) = g(x) . h(y) for vectors x and y.

    The second term of the bound is then an average over all pairs of a mini-batch.
    """

    def __init__(self, num_x: int, num_y: int, config: MineConfig, generator: torch.Generator) -> None:
        """Initialise theta at random.

        Args:
            num_x: Channels of x.
            num_y: Channels of y.
            config: Widths of the layers.
            generator: Generator of the weights.
        """
        super().__init__()
        inner = [config.num_hidden, config.num_hidden, config.num_embedding]
        self.of_x, self.of_y = (_perceptron([width, *inner], generator) for width in (num_x, num_y))

    def forward(self, x: Tensor, y: Tensor) -> Tensor:
        """Compute F(x_i, y_j) for all pairs: (N, num_x) and (N, num_y) float32 -> (N, N) float32."""
        statistics: Tensor = self.of_x(x) @ self.of_y(y).T
        return statistics.clamp(max=MAX_STATISTIC)


def _perceptron(widths: Sequence[int], generator: torch.Generator) -> torch.nn.Sequential:
    layers: list[torch.nn.Module] = []
    for wide_in, wide_out in pairwise(widths):
        # Linear draws weights from torch's global generator, whose state is restored. (A layer on the device "meta" has
        # no weights, but moving it to the CPU loads sympy, which takes longer than 50 steps.)
        with torch.random.fork_rng(devices=[]):
            linear = torch.nn.Linear(wide_in, wide_out)
        bound = wide_in**-0.5
        torch.nn.init.uniform_(linear.weight, -bound, bound, generator=generator)
        torch.nn.init.zeros_(linear.bias)
        layers += [linear, torch.nn.ELU()]
    return torch.nn.Sequential(*layers[:-1])


class DonskerVaradhan(torch.nn.Module):
    """The bound I(X; Y) >= E_p(x,y)[F] - log E_p(x)p(y)[exp F] (eq. 5), estimated on mini-batches.

    The gradient of the logarithm of a mini-batch mean is biased. As in MINE, its denominator is therefore a running
    mean.
    """

    def __init__(self, decay: float) -> None:
        """Start without a running mean, which keeps the fraction `decay` of itself at each mini-batch."""
        super().__init__()
        self.decay = decay
        self._mean_exp: Tensor | None = None

    def forward(self, joint: Tensor, mean_exp: Tensor) -> tuple[Tensor, Tensor]:
        """Estimate the bound from both expectations over a mini-batch.

        Args:
            joint: Scalar E_p(x,y)[F], over the pairs that were observed.
            mean_exp: Scalar E_p(x)p(y)[exp F], over independent pairs.

        Returns:
            The bound in nats, detached, and a scalar whose gradient is the bias-corrected gradient of the bound.
        """
        detached = mean_exp.detach()
        previous = detached if self._mean_exp is None else self._mean_exp
        self._mean_exp = self.decay * previous + (1 - self.decay) * detached
        bound = joint - mean_exp.log()
        return bound.detach(), joint - mean_exp / self._mean_exp


class Adam:
    """Adam (Kingma and Ba, arXiv 1412.6980) for a few small tensors, equal to that of `torch.optim` to the last bit.

    `torch.optim` loads torch's compiler when its first optimiser is made, which takes as long as 200 steps of MINE.
    """

    def __init__(
        self, parameters: Iterable[Tensor], rate: float, betas: tuple[float, float] = (0.9, 0.999)
    ) -> None:
        """Take over the tensors: they and their gradients become views of tensors kept here.

        Args:
            parameters: Leaves that require gradients, of one dtype and on one device.
            rate: Learning rate, which may be changed between steps.
            betas: Decays of the two means of gradients.
        """
        leaves = list(parameters)
        self.rate, self.betas, self._num_steps = rate, betas, 0
        self._values = torch.cat([leaf.detach().reshape(-1) for leaf in leaves])
        self._gradient, self._mean, self._mean_square = (torch.zeros_like(self._values) for _ in range(3))
        sizes = [leaf.numel() for leaf in leaves]
        parts = zip(leaves, torch.split(self._values, sizes), torch.split(self._gradient, sizes), strict=True)
        for leaf, values, gradient in parts:
            leaf.data, leaf.grad = values.view_as(leaf), gradient.view_as(leaf)

    @torch.no_grad()
    def step(self) -> None:
        """Descend by one step."""
        self._num_steps += 1
        for_mean, for_square = self.betas
        self._mean.lerp_(self._gradient, 1.0 - for_mean)
        self._mean_square.mul_(for_square).addcmul_(self._gradient, self._gradient, value=1.0 - for_square)
        # Both means start at zero, and these factors correct the bias.
        length = self.rate / (1.0 - for_mean**self._num_steps)
        scale = (1.0 - for_square**self._num_steps) ** 0.5
        self._values.addcdiv_(self._mean, (self._mean_square.sqrt() / scale).add_(EPSILON), value=-length)

    def zero_grad(self) -> None:
        """Set the gradients to zero in place."""
        self._gradient.zero_()
