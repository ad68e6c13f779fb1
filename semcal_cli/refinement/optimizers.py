"""Optimisers of a few small tensors, with the arithmetic of `torch.optim`.

`torch.optim` loads torch's compiler when its first optimiser is made, which takes as long as 200 steps of MINE, and it
takes each step tensor by tensor. Adam ends at the same bits here.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

EPSILON = 1e-8


class GradientDescent:
    """Descends the gradients of tensors, which it keeps together in one."""

    def __init__(self, parameters: Iterable[Tensor], rate: float) -> None:
        """Take the tensors over: they and their gradients become views of what is kept here.

        Args:
            parameters: Leaves that require gradients, of one dtype and on one device.
            rate: Learning rate, which may be changed between steps.
        """
        leaves = list(parameters)
        self.rate = rate
        self._values = torch.cat([leaf.detach().reshape(-1) for leaf in leaves])
        self._gradient = torch.zeros_like(self._values)
        begin = 0
        for leaf in leaves:
            part = slice(begin, begin + leaf.numel())
            leaf.data, leaf.grad = self._values[part].view_as(leaf), self._gradient[part].view_as(leaf)
            begin = part.stop

    @torch.no_grad()
    def step(self) -> None:
        """Descend by one step."""
        self._values.add_(self._gradient, alpha=-self.rate)

    def zero_grad(self) -> None:
        """Forget the gradients, in place."""
        self._gradient.zero_()


class Adam(GradientDescent):
    """Adam: Kingma and Ba, arXiv 1412.6980."""

    def __init__(
        self, parameters: Iterable[Tensor], rate: float, betas: tuple[float, float] = (0.9, 0.999)
    ) -> None:
        """Take the tensors over as `GradientDescent` does; `betas` are the decays of the two means of gradients."""
        super().__init__(parameters, rate)
        self.betas, self._num_steps = betas, 0
        self._mean, self._mean_square = torch.zeros_like(self._values), torch.zeros_like(self._values)

    @torch.no_grad()
    def step(self) -> None:
        """Descend by one step."""
        self._num_steps += 1
        for_mean, for_square = self.betas
        self._mean.lerp_(self._gradient, 1.0 - for_mean)
        self._mean_square.mul_(for_square).addcmul_(self._gradient, self._gradient, value=1.0 - for_square)
        # Both means begin at zero; the corrections take that out.
        length = self.rate / (1.0 - for_mean**self._num_steps)
        scale = (1.0 - for_square**self._num_steps) ** 0.5
        self._values.addcdiv_(self._mean, (self._mean_square.sqrt() / scale).add_(EPSILON), value=-length)
