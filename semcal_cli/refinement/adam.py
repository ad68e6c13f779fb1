"""Adam for a few small tensors (Kingma and Ba, arXiv 1412.6980), step by step the arithmetic of `torch.optim.Adam`."""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

EPSILON = 1e-8


class Adam:
    """Descends the gradients of tensors, which it keeps together in one.

    `torch.optim` loads torch's compiler when its first optimiser is made, which takes as long as 200 steps of MINE, and
    it takes each step tensor by tensor. Both end at the same bits.
    """

    def __init__(
        self, parameters: Iterable[Tensor], rate: float, betas: tuple[float, float] = (0.9, 0.999)
    ) -> None:
        """Take the tensors over: they and their gradients become views of what is kept here.

        Args:
            parameters: Leaves that require gradients, of one dtype and on one device.
            rate: Learning rate, which may be changed between steps.
            betas: Decays of the means of gradients and of their squares.
        """
        leaves = list(parameters)
        self.rate, self.betas = rate, betas
        self._values = torch.cat([leaf.detach().reshape(-1) for leaf in leaves])
        self._gradient, self._mean, self._mean_square = (torch.zeros_like(self._values) for _ in range(3))
        self._num_steps = begin = 0
        for leaf in leaves:
            part = slice(begin, begin + leaf.numel())
            leaf.data, leaf.grad = self._values[part].view_as(leaf), self._gradient[part].view_as(leaf)
            begin = part.stop

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

    def zero_grad(self) -> None:
        """Forget the gradients, in place."""
        self._gradient.zero_()
