"""Whether labels agree as well with the camera turned about the LiDAR's z axis."""

from __future__ import annotations

import numpy as np

from semcal_cli.checks.pose_fit import NO_FIT, fit_at, relative_information
from semcal_cli.errors import format_against_limit
from semcal_cli.estimation.uncertainty.information import compared_by
from semcal_cli.findings.check import Check, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.phrases import BY_HAND, ELSEWHERE
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.observations import Observations

OTHER_AZIMUTH = Check(
    topic="other-azimuth",
    advice=BY_HAND,
    advice_beside_start=ELSEWHERE,
    entry=Entry(
        title="Labels fit another azimuth",
        section=PageSection.MOUNTING,
        quotes=(
            (
                "turned by 90 degrees, the camera still fits 71% as well (limit 65%), so its direction is "
                "ambiguous: add frames from other places, or measure the mounting by hand and give it with "
                "--init-rpy-xyz"
            ),
        ),
        meaning="The labels look nearly the same all around the LiDAR.",
        cause="The scene repeats itself (an open field, a straight street canyon), or there are few classes.",
        remedy=(
            "Record at crossings and among poles, cars and trees, or measure the mounting and give it "
            "with `--init-rpy-xyz`."
        ),
        figure=(
            "Information with the camera turned about the LiDAR's z axis in steps of 30 degrees, as a "
            "share of that at the pose."
        ),
    ),
)
TURN_DEG = 30.0
"""Step between the azimuths to which the camera is turned."""
MIN_OVERLAP_SHARE = 0.5
"""Overlap at another azimuth, relative to that at the pose, from which the azimuth is compared."""


def check_azimuth(observations: Observations, T_camera_lidar: Pose) -> Measured:
    """Check that labels agree less well with the camera turned about the LiDAR's z axis to where points are visible."""
    own, best, best_deg = fit_at(observations, T_camera_lidar), 0.0, 0.0
    for turn_deg in np.arange(TURN_DEG, 360.0, TURN_DEG).tolist():
        c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
        T_about_z = np.eye(4)
        T_about_z[:2, :2] = [[c, -s], [s, c]]
        turned = fit_at(observations, T_camera_lidar @ T_about_z)
        is_seen = turned.agreement.overlap >= MIN_OVERLAP_SHARE * own.agreement.overlap
        if turned.information > best and is_seen:
            best, best_deg = turned.information, turn_deg
    by, turned_by = compared_by(observations), f"with the camera turned by {best_deg:.0f} degrees"
    sentence = f"points and images {NO_FIT}" + f", and fit better {turned_by}" * (best_deg > 0.0)
    if own.information > 0.0:
        as_well, most = format_against_limit(best / own.information, OTHER_AZIMUTH.limit(by), unit="%")
        sentence = (
            f"turned by {best_deg:.0f} degrees, the camera still fits {as_well} as well (limit {most}), so its "
            "direction is ambiguous"
        )
    return OTHER_AZIMUTH.measured(relative_information(best, own.information), sentence, by)
