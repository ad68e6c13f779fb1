"""Settings of the methods that semcal is compared with."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SoicConfig:
    """How SOIC computes its cost, and how Powell's method minimises it."""

    block_px: int = 2
    """Side of the blocks in which distances to classes are stored."""
    max_points: int = 400_000
    """Largest number of points, inside the images or near them, that the cost uses."""
    step_deg: float = 2.0
    """Largest rotation of the camera in a line search."""
    step_m: float = 0.3
    """Largest movement of the camera in a line search."""
    tolerance: float = 1e-3
    """Precision of a line search, relative to its step."""
    max_rounds: int = 30
    """Largest number of rounds of Powell's method from each start."""
    max_restarts: int = 20
    """Largest number of starts. Powell's method restarts until that gains nothing."""
