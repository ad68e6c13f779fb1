"""MINE: mutual information as a neural network's lower bound (eqs. 1 and 2).

Source: Belghazi et al., *Mutual Information Neural Estimation* (arXiv 1801.04062), with its bias-corrected gradient.
"""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor


class StatisticsNetwork(torch.nn.Module):
    """F(x, y) for discrete x and a vector y of class shares: one output for each x.

    With an output for each x, the expectation over x in the second term of the bound is a sum over all classes
    instead of over shuffled pairs, which takes most of the noise out of the estimate at half the cost.
    """

    def __init__(self, num_x: int, num_y: int, num_hidden: int, generator: torch.Generator) -> None:
        super().__init__()
        widths = [num_y, num_hidden, num_hidden, num_x]
        layers: list[torch.nn.Module] = []
        for wide_in, wide_out in pairwise(widths):
            # Built without weights: torch would draw them from its global generator.
            linear = torch.nn.Linear(wide_in, wide_out, device="meta").to_empty(device="cpu")
            bound = wide_in**-0.5
            torch.nn.init.uniform_(linear.weight, -bound, bound, generator=generator)
            torch.nn.init.zeros_(linear.bias)
            layers += [linear, torch.nn.ELU()]
        self.layers = torch.nn.Sequential(*layers[:-1])

    def forward(self, y: Tensor) -> Tensor:
        """F(x, y_i) for all x: (N, num_y) -> (N, num_x)."""
        output: Tensor = self.layers(y)
        return output


class DonskerVaradhan(torch.nn.Module):
    """The bound I(X; Y) >= E_p(x,y)[F] - log E_p(x)p(y)[exp F] (eq. 2) over mini-batches.

    The gradient of the logarithm of a mini-batch mean is biased; as in MINE, its denominator is a running mean.
    """

    def __init__(self, decay: float) -> None:
        super().__init__()
        self.decay = decay
        self._mean_exp: Tensor | None = None

    def forward(self, statistics: Tensor, x: Tensor, p_x: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
        """Estimate the bound.

        Args:
            statistics: (N, num_x), F(x, y_i) for all x.
            x: (N,) int64, the x that was seen with each y.
            p_x: (num_x,), the distribution of x.
            weights: (N,), how much each pair counts.

        Returns:
            The bound in nats, and a scalar whose gradient is the bias-corrected gradient of the bound.
        """
        weights = weights / weights.sum()
        joint = weights @ statistics.gather(1, x[:, None])[:, 0]
        mean_exp = weights @ (statistics.exp() @ p_x)
        detached = mean_exp.detach()
        previous = detached if self._mean_exp is None else self._mean_exp
        self._mean_exp = self.decay * previous + (1 - self.decay) * detached
        bound = joint - mean_exp.log()
        return bound.detach(), joint - mean_exp / self._mean_exp
