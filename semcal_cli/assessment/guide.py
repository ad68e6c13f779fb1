"""What segments say of a pose that edges found: they only bring it near, but must not speak for another one."""

from __future__ import annotations

import numpy as np

from semcal_cli.assessment.rivals import sigmas_behind
from semcal_cli.checks.check import Measured
from semcal_cli.checks.mounting import CUES_DISAGREE
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.pose_error import compare_poses
from semcal_cli.geometry.poses import Pose
from semcal_cli.geometry.twists import displaced

NUM_OTHERS = 8
OTHERS_DEG, OTHERS_M = 3.0, 0.3
"""Number of poses around the found one that it is compared with, and their distance: segments end up to 4 degrees
off."""


def check_guide(guide: Observations, T_camera_lidar: Pose, T_initial: Pose) -> Measured:
    """Check that segments and labels of the pictures do not prefer another pose to the one that edges found.

    Args:
        guide: Points and pixels by segments.
        T_camera_lidar: (4, 4) pose by edges, metres.
        T_initial: (4, 4) pose from which edges started.
    """
    rng = np.random.default_rng(0)
    others = [
        T_initial,
        *(displaced(T_camera_lidar, OTHERS_DEG, OTHERS_M, rng) for _ in range(NUM_OTHERS)),
    ]
    behind = sigmas_behind(guide, T_camera_lidar, others)
    best = int(np.argmin(behind))
    away = compare_poses(others[best], T_camera_lidar)
    found = (
        f"segments and labels of the pictures prefer a pose {away.rotation_deg:.1f} degrees and "
        f"{away.camera_center_cm:.0f} cm away from that of edges, by {-behind[best]:.1f} standard errors, needed at "
        f"most {CUES_DISAGREE.limit():g}"
    )
    return CUES_DISAGREE.measured(-behind[best], found)
