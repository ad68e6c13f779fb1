"""The choice of an estimator of mutual information."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from semcal_cli.config import ExactConfig, RefinementConfig
from semcal_cli.config.mine_config import MINE_WITH_VECTORS, MineConfig
from semcal_cli.errors import InputError, check_torch, torch_import
from semcal_cli.estimation.refine.pyramid import ExactEstimator, LevelOptimizer
from semcal_cli.estimation.refine.several_starts import SeveralStarts
from semcal_cli.events import Listener, Progress, ignore
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.observations import Observations


def make_estimator(
    observations: Observations,
    config: RefinementConfig,
    seed: int,
    on_event: Listener = ignore,
    candidates: Sequence[Pose] = (),
) -> tuple[LevelOptimizer, dict[str, object]]:
    """Make the estimator, and return it with its settings; torch is loaded only where it is needed.

    With several starts, `candidates` are poses (4, 4) that stay in the comparison besides the pose to start from.

    Raises:
        InputError: features need MINE, segments need the exact estimator, torch is missing, or the device is.
    """
    shared = observations.shared_settings
    if observations.has_vectors and config.estimator == "exact":
        raise InputError("--estimator exact: found features, which have no histogram; add --estimator mine")
    if observations.has_partitions and config.estimator == "mine":
        raise InputError(
            "--estimator mine: found segments, which differ from frame to frame; add --estimator exact"
        )
    if config.estimator == "exact":
        if (starts := observations.starts) is None:
            estimator = ExactEstimator(observations, ExactConfig(), seed)
            return estimator, {"exact": asdict(estimator.config) | shared}
        several = SeveralStarts(observations, ExactConfig(), seed, starts, candidates)
        recorded_starts = asdict(several.starts)
        if several.starts.coarse is not None:
            recorded_starts["coarse"] |= shared
        return several, {"exact": asdict(several.config) | shared, "starts": recorded_starts}
    check_torch("--estimator mine")
    on_event(Progress("loading torch"))
    with torch_import():
        from semcal_cli.estimation.refine.mine import MineEstimator

    mine = MINE_WITH_VECTORS if observations.has_vectors else MineConfig()
    return MineEstimator(observations, mine, seed, config.device), {
        "mine": asdict(mine) | shared,
        "device": config.device,
    }
