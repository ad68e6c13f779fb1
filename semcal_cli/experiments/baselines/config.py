"""Settings of the methods to compare with."""

from __future__ import annotations

from dataclasses import dataclass, field

from semcal_cli.config import FAR_DEG, InitializationConfig, PyramidConfig
from semcal_cli.config.mine import MineConfig


@dataclass(frozen=True)
class PaperConfig:
    """The method as published, with the choices that the paper leaves open.

    Nothing of ours is added: no climb of hypotheses, no edge band, no removal of hidden points, no polish.
    """

    initialization: InitializationConfig = field(default_factory=lambda: InitializationConfig(zoom="paper"))
    """Settings of Alg. 2."""
    pyramid: PyramidConfig = field(
        default_factory=lambda: PyramidConfig(coarsest_block_deg=FAR_DEG, hidden_below_block_deg=0.0)
    )
    """Levels of the pyramid of Alg. 1, coarse enough for the start that Alg. 2 gives."""
    mine: MineConfig = field(default_factory=lambda: MineConfig(edge_band_px=0))
    """Network, optimiser, rates and steps of Alg. 1."""


@dataclass(frozen=True)
class SoicConfig:
    """How SOIC computes centroids and costs, and how Powell's method minimises the cost."""

    num_sectors: int = 24
    """Directions in which centroids are computed."""
    centroid_error_deg: float = 5.0
    """Centroids of what is seen from elsewhere, and partly, are no more exact than this."""
    min_centroids: int = 8
    """Number of centroids that have to agree on a pose."""
    min_pixels: int = 50
    """Classes with fewer pixels in a picture or fewer points in a sector have no centroid there."""
    block_px: int = 2
    """Side of the blocks in which distances to classes are kept."""
    max_points: int = 400_000
    """Points in the pictures or beside them that are looked at."""
    step_deg: float = 2.0
    """A line search turns the camera by at most this."""
    step_m: float = 0.3
    """A line search moves the camera by at most this."""
    tolerance: float = 1e-3
    """A line search ends within this share of its step."""
    max_rounds: int = 30
    """Rounds of Powell's method from each start."""
    max_restarts: int = 20
    """Largest number of starts. Powell's method starts again until that gains nothing."""
