"""Whether segments and image labels prefer another pose to the one that edges found."""

from __future__ import annotations

import numpy as np

from semcal_cli.errors import format_against_limit
from semcal_cli.estimation.uncertainty.information import sigmas_behind
from semcal_cli.findings.check import Check, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.phrases import ELSEWHERE
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.observations import Observations

CUES_DISAGREE = Check(
    topic="cues-disagree",
    advice=f"{ELSEWHERE}, or check with `semcal overlay --by edge` whether edges line up",
    entry=Entry(
        title="Segments prefer another pose",
        section=PageSection.MOUNTING,
        quotes=(
            (
                "segments and image labels prefer a pose 3.0 degrees and 30 cm from the one that edges "
                "found, by 3.1 standard errors (limit 2): add frames from other places, or check "
                "with `semcal overlay --by edge` whether edges line up"
            ),
        ),
        meaning=(
            "Segments are too coarse for an exact pose, but they distinguish the right pose from one "
            "that is off by degrees."
        ),
        cause="Edges have found a wrong maximum, or the image labels do not belong to the images.",
        remedy=(
            "Look at the edges: if poles and cars line up, check the image labels; if not, add frames "
            "or give `--init`."
        ),
        figure=(
            "How much more information segments have at another pose. The check applies to edges with "
            "image labels."
        ),
    ),
)
NUM_OTHERS = 8
OTHERS_DEG, OTHERS_M = 3.0, 0.3
"""Number of poses around the pose that it is compared with, and their distance: segments end up to 4 degrees off."""


def check_coarse_cue(coarse_cue: Observations, T_camera_lidar: Pose, T_initial: Pose) -> Measured:
    """Check that segments and image labels do not prefer another pose to the one that edges found.

    Args:
        coarse_cue: Points and pixels by segments.
        T_camera_lidar: (4, 4) pose by edges, metres.
        T_initial: (4, 4) pose from which edges started.
    """
    rng = np.random.default_rng(0)
    others = [T_initial, *(displace(T_camera_lidar, OTHERS_DEG, OTHERS_M, rng) for _ in range(NUM_OTHERS))]
    behind = sigmas_behind(coarse_cue, T_camera_lidar, others)
    best = int(np.argmin(behind))
    away = compare_poses(others[best], T_camera_lidar)
    ahead, most = format_against_limit(-behind[best], CUES_DISAGREE.limit(), 1)
    sentence = (
        f"segments and image labels prefer a pose {away.rotation_deg:.1f} degrees and "
        f"{away.camera_center_cm:.0f} cm from the one that edges found, by {ahead} standard errors (limit {most})"
    )
    return CUES_DISAGREE.measured(-behind[best], sentence)
