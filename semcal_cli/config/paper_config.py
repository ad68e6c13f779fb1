"""Settings of the paper's method."""

from __future__ import annotations

from dataclasses import dataclass, field

from semcal_cli.config import FAR_DEG, InitializationConfig, PyramidConfig
from semcal_cli.config.mine_config import MineConfig


@dataclass(frozen=True)
class PaperConfig:
    """The method as published, with choices where the paper leaves them open.

    Nothing of ours is added: no climb of hypotheses, no edge band, no removal of hidden points, no polish.
    """

    initialization: InitializationConfig = field(default_factory=lambda: InitializationConfig(zoom="paper"))
    """Settings of Alg. 2."""
    pyramid: PyramidConfig = field(
        default_factory=lambda: PyramidConfig(coarsest_block_deg=FAR_DEG, hidden_below_block_deg=0.0)
    )
    """Levels of the pyramid of Alg. 1, coarse enough for the start from Alg. 2."""
    mine: MineConfig = field(default_factory=MineConfig)
    """Network, optimiser, rates and steps of Alg. 1."""
