"""What segments say of a pose that edges found: they only bring it near, but must not speak for another one."""

from __future__ import annotations

import numpy as np

from semcal_cli.assessment.rivals import sigmas_behind
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.pose_error import compare_poses
from semcal_cli.geometry.poses import Pose
from semcal_cli.geometry.twists import displaced
from semcal_cli.result.stage import Finding

MAX_SIGMAS = 2.0
"""Standard errors by which segments may prefer another pose. At the right poses of three real drives of 13 to 15 frames
they told 3 to 12 standard errors more than at poses 0.6 to 6 degrees away."""
NUM_OTHERS = 8
OTHERS_DEG, OTHERS_M = 3.0, 0.3
"""Number of poses around the found one that it is compared with, and their distance: segments end up to 4 degrees
off."""


def check_guide(guide: Observations, T_camera_lidar: Pose, T_initial: Pose) -> tuple[Finding, ...]:
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
    if -behind[best] <= MAX_SIGMAS:
        return ()
    away = compare_poses(others[best], T_camera_lidar)
    found = (
        f"segments and labels of the pictures prefer a pose {away.rotation_deg:.1f} degrees and "
        f"{away.camera_center_cm:.0f} cm away from that of edges, by {-behind[best]:.1f} standard errors, needed at "
        f"most {MAX_SIGMAS:g}"
    )
    return (
        Finding(
            "cues-disagree",
            found,
            "add frames from other places, or check with `semcal overlay --by edge` whether edges coincide",
        ),
    )
