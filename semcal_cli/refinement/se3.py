"""Rigid motions by the matrix exponential of the generators of SE(3) (eq. 3), for torch."""

from __future__ import annotations

import torch
from torch import Tensor


def exp_se3(twist: Tensor) -> Tensor:
    """Map a twist to a rigid motion, differentiably (eq. 3).

    Args:
        twist: (6,) floats (rho, phi): translation in metres first, then rotation in radians.

    Returns:
        (4, 4) of the twist's dtype, the matrix exponential of `sum_i twist_i B_i` with the generators `B_i` of SE(3).
    """
    motion: Tensor = torch.linalg.matrix_exp((twist[:, None, None] * generators(twist)).sum(0))
    return motion


def generators(like: Tensor) -> Tensor:
    """Make the six generators of SE(3): three translations, then rotations about x, y and z.

    Args:
        like: A tensor of the dtype and on the device that the result has.

    Returns:
        (6, 4, 4).
    """
    basis = torch.zeros(6, 4, 4, dtype=like.dtype, device=like.device)
    for axis in range(3):
        basis[axis, axis, 3] = 1.0
        j, k = (axis + 1) % 3, (axis + 2) % 3
        basis[3 + axis, k, j], basis[3 + axis, j, k] = 1.0, -1.0
    return basis
