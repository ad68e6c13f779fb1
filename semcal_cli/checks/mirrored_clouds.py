"""Whether clouds are mirrored."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from semcal_cli.config import InitializationConfig
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.estimation.search.mounting_search import search_mountings
from semcal_cli.findings.check import Check, Limit
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.observations.observations import Observations

MIRRORED_CLOUDS = Check(
    topic="mirrored-clouds",
    entry=Entry(
        title="Clouds seem mirrored",
        section=PageSection.INSPECTION,
        quotes=("the clouds seem mirrored: with y negated, labels share 0.62 nats instead of 0.31",),
        meaning="Mirrored clouds explain the labels better than the clouds as they are.",
        cause="The clouds are in a left-handed frame, as simulators write them.",
        remedy="Negate one axis of the points, and import the clouds again.",
        figure="Standard errors by which mirrored clouds explain the labels better.",
    ),
    settings={
        "": Limit(at_most=2.0, unit="standard errors", source="a normal error exceeds it in one case of 44")
    },
)


def check_mirroring(observations: Observations) -> tuple[Finding, ...]:
    """Register a few frames unchanged and with y negated, because clouds may be mirrored."""
    flip = np.array([1.0, -1.0, 1.0], np.float32)
    mirrored = observations.with_clouds(
        cloud.with_points(cloud.points * flip) for cloud in observations.clouds
    )
    if (lidar := observations.lidar) is not None:
        x_m, y_m, z_m = lidar.origin_m
        mirrored = replace(mirrored, lidar=lidar.model_copy(update={"origin_m": (x_m, -y_m, z_m)}))
    try:
        best, other = (
            search_mountings(clouds, InitializationConfig(), seed=0).hypotheses[0]
            for clouds in (observations, mirrored)
        )
    except (CalibrationError, InputError):
        return ()
    sentence = (
        f"the clouds seem mirrored: with y negated, labels share {other.corrected_nats:.2f} nats instead of "
        f"{best.corrected_nats:.2f}"
    )
    return MIRRORED_CLOUDS.measured(other.margin(best), sentence).findings
