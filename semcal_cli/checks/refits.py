"""Whether labels agree less well after refinements with other focal lengths and other delays of the images.

All refinements use the same frames and settings. The agreement distinguishes focal lengths even in a single frame,
although they hardly change its curvature.
"""

from __future__ import annotations

from semcal_cli.checks.focal_length import check_focal_length, zoomed_observations
from semcal_cli.checks.pose_fit import PoseFit, fit_at
from semcal_cli.checks.wrong_clocks import check_clocks, delayed_observations
from semcal_cli.config import ExactConfig, PyramidConfig
from semcal_cli.estimation.refine.pyramid import refine_exactly
from semcal_cli.findings.check import Measured
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.observations import Observations
from semcal_cli.threads import thread_pool

EXACT = ExactConfig(batch_size=1024, max_points=10_000)
PYRAMID = PyramidConfig(coarsest_block_deg=1.0)
"""Settings of the refinements."""


def check_other_models(
    observations: Observations, T_camera_lidar: Pose, estimated_s: float | None
) -> list[Measured]:
    """Check that labels agree less well with other focal lengths, and with other delays if the motion shows them.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4) refined pose, metres.
        estimated_s: Estimate of the time offset, seconds; None if the motion shows none.
    """
    zoomed = zoomed_observations(observations)
    late = {} if estimated_s is None else delayed_observations(observations)

    def refit(model: Observations) -> PoseFit | None:
        refined = refine_exactly(model, T_camera_lidar, EXACT, PYRAMID)
        return None if refined is None else fit_at(model, refined.T_camera_lidar, refined.agreement)

    # Each refinement is a sequence of small steps, so several run in parallel.
    with thread_pool() as pool:
        own, *others = pool.map(refit, [observations, *zoomed.values(), *late.values()])
    if own is None:
        return []
    # A refinement may end at a lower maximum than the one that it left.
    own = max(own, fit_at(observations, T_camera_lidar), key=lambda fit: fit.information)
    fits = {key: fit for key, fit in zip([*zoomed, *late], others, strict=True) if fit is not None}
    measured = check_focal_length(own, {key: fits[key] for key in zoomed if key in fits})
    if estimated_s is None:
        return measured
    late_fits = {key: (late[key], fits[key]) for key in late if key in fits}
    return [*measured, *check_clocks(observations, own, late_fits, estimated_s)]
