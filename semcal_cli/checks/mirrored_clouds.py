"""Whether clouds or images are mirrored: by labels before a calibration, by edges after one that found no pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from semcal_cli.checks.refits import EXACT, PYRAMID
from semcal_cli.config import InitializationConfig
from semcal_cli.errors import CalibrationError, InputError
from semcal_cli.estimation.refine.pyramid import refine_exactly
from semcal_cli.estimation.search.mounting_search import search_mountings
from semcal_cli.estimation.uncertainty.information import information_by_squares, paired_gain
from semcal_cli.findings.check import Check, Limit, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.findings.symptoms import OF_A_WRONG_POSE
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.observations import Observations

MIRRORED_CLOUDS = Check(
    topic="mirrored-clouds",
    explains=OF_A_WRONG_POSE | {"far-start", "shifted-pairing"},
    entry=Entry(
        title="Clouds seem mirrored",
        section=PageSection.INSPECTION,
        quotes=(
            "the clouds seem mirrored: with y negated, labels share 0.62 nats instead of 0.31",
            (
                "clouds or images seem mirrored, since near the start, points with y negated fit 17.8 standard errors "
                "better than at the pose (limit 3): negate y of the points, or flip the images back"
            ),
        ),
        meaning="Mirrored clouds explain the labels, or the edges, better than the clouds as they are.",
        cause="The clouds are in a left-handed frame, as simulators write them, or the images were flipped.",
        remedy="Negate one axis of the points, and import the clouds again, or flip the images back.",
        figure=(
            "Standard errors by which mirrored clouds explain the labels better. By edges, they are refined from the "
            "start where the pose is lost, since images of other frames fit as well or a turned camera does."
        ),
    ),
    settings={
        "": Limit(at_most=2.0, unit="standard errors", source="a normal error exceeds it in one case of 44"),
        "edges": Limit(
            at_most=3.0,
            unit="standard errors",
            source=(
                "with the images or the clouds of two KITTI drives mirrored it is 5.3 and 17.8; with sweeps of other "
                "frames at most 1.0, on six drives"
            ),
        ),
    },
)


def _mirrored(observations: Observations) -> Observations:
    """Make the same observations with y of all points negated."""
    flip = np.array([1.0, -1.0, 1.0], np.float32)
    return observations.with_clouds(cloud.with_points(cloud.points * flip) for cloud in observations.clouds)


def check_mirrored_edges(observations: Observations, T_camera_lidar: Pose, T_start: Pose) -> list[Measured]:
    """Compare a lost pose (4, 4) with one of mirrored clouds, which a coarse refinement finds near the start (4, 4)."""
    mirrored = _mirrored(observations)
    refined = refine_exactly(mirrored, T_start, EXACT, PYRAMID) if observations.is_multimodal else None
    if refined is None:
        return []
    own = information_by_squares(observations, T_camera_lidar)
    better = paired_gain(own, information_by_squares(mirrored, refined.T_camera_lidar)).significance
    sentence = (
        f"clouds or images seem mirrored, since near the start, points with y negated fit {better:.1f} standard errors "
        f"better than at the pose (limit {MIRRORED_CLOUDS.limit('edges'):g}): negate y of the points, or flip the "
        "images back"
    )
    return [MIRRORED_CLOUDS.measured(better, sentence, "edges")]


def check_mirroring(observations: Observations) -> tuple[Finding, ...]:
    """Register a few frames unchanged and with y negated, because clouds may be mirrored."""
    mirrored = _mirrored(observations)
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
