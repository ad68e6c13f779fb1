"""What speaks against a pose: sentences, each with its figure. None is no proof that the pose is right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from semcal_cli import _core
from semcal_cli.observations import Observations
from semcal_cli.poses import Pose
from semcal_cli.selection import evenly_spaced
from semcal_cli.uncertainty import REGIONS_ACROSS, Sensitivity, is_determined, sandwich

NUM_FRAMES = 4
"""So many frames are looked at."""
MAX_EXCHANGED = 0.55
"""With pictures of other frames, labels may share no more than this of what they share with their own. On eight
development drives of five rigs with 5 and 20 frames it was at most 0.36, with clouds paired with another drive's
pictures or with shuffled labels at least 0.56."""
MAX_ALIKE = 0.8
"""Pictures that are the same in so many pixels say nothing when they are exchanged."""
MAX_TURNED = 0.65
"""With the camera turned to other azimuths, likewise: at most 0.55 on these drives, at least 0.71 with another drive's
pictures."""
TURN_DEG = 30.0
INTRINSICS = ("fx", "fy", "cx", "cy", "k1")
INTRINSICS_BLOCK_PX = 4
"""Wrong intrinsics show in blocks of so many pixels: errors are larger than one."""
INTRINSICS_POINTS = 150_000
MAX_INTRINSICS_CHI2 = 12.83
"""Of five degrees of freedom: one right camera in 40 is beyond, and most of those for less than the next figure. On 45
calibrations of six development drives it was at most 8 where that was exceeded, with K wrong by 10 % at least 16."""
MAX_INTRINSICS_PX = 5.0
"""And freeing them has to move the points by more than this, so that what little is wrong with any camera is let be."""


def doubts(observations: Observations, T_camera_lidar: Pose) -> list[str]:
    """Say what speaks against a pose: its labels, its surroundings, the camera's intrinsics.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4), refined.
    """
    few = observations.of_frames(evenly_spaced(range(observations.num_frames), NUM_FRAMES))
    return [
        *_pairing_doubts(few, T_camera_lidar),
        *_azimuth_doubts(few, T_camera_lidar),
        *_intrinsics_doubts(observations, T_camera_lidar),
    ]


def _information(observations: Observations, T_camera_lidar: Pose) -> float:
    """Mutual information less its bias, nats."""
    agreement = _core.agreement(observations.core, T_camera_lidar)
    return agreement.mutual_information - agreement.bias


def _pairing_doubts(observations: Observations, T_camera_lidar: Pose) -> list[str]:
    """Pair clouds with the pictures of other frames."""
    own = _information(observations, T_camera_lidar)
    images, found = list(observations.image_classes), []
    for shift in range(1, observations.num_frames):
        others = images[shift:] + images[:shift]
        alike = np.mean([np.mean(a == b) for a, b in zip(images, others, strict=True)])
        if alike <= MAX_ALIKE:
            exchanged = replace(observations, image_classes=others, image_shares=())
            found.append(_information(exchanged, T_camera_lidar))
    if not found or max(found) <= MAX_EXCHANGED * own:
        return []
    return [
        f"pictures of other frames fit the clouds almost as well: {max(found):.2f} of {own:.2f} nats, needed at most "
        f"{MAX_EXCHANGED:.0%}: sweeps and pictures may not belong together"
    ]


def _azimuth_doubts(observations: Observations, T_camera_lidar: Pose) -> list[str]:
    """Turn the camera about the LiDAR's z axis, where there is something to see."""
    answer = _core.agreement(observations.core, T_camera_lidar)
    own = answer.mutual_information - answer.bias
    best, best_deg = 0.0, 0.0
    for turn_deg in np.arange(TURN_DEG, 360.0, TURN_DEG).tolist():
        turned = _core.agreement(observations.core, T_camera_lidar @ _about_z(turn_deg))
        information = turned.mutual_information - turned.bias
        if turned.overlap >= 0.5 * answer.overlap and information > best:
            best, best_deg = information, turn_deg
    if best <= MAX_TURNED * own:
        return []
    return [
        f"with the camera turned by {best_deg:.0f} degrees labels fit almost as well: {best:.2f} of {own:.2f} nats, "
        f"needed at most {MAX_TURNED:.0%}"
    ]


def _about_z(angle_deg: float) -> Pose:
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    T = np.eye(4)
    T[:2, :2] = [[c, -s], [s, c]]
    return T


def _intrinsics_doubts(observations: Observations, T_camera_lidar: Pose) -> list[str]:
    """Free fx, fy, cx, cy and k1 beside the pose: a step of Newton's method, and whether it is more than chance."""
    found = _core.sensitivity(
        observations.core,
        T_camera_lidar,
        factor=INTRINSICS_BLOCK_PX,
        edge_band=0,
        max_points=INTRINSICS_POINTS,
        with_intrinsics=True,
        regions_across=REGIONS_ACROSS,
    )
    if found is None:
        return []
    around = Sensitivity(*found)
    pose = Sensitivity(around.curvature[:6, :6], around.scores[:, :6], around.motions[:6, :6])
    if not is_determined(pose):
        return []
    step = around.influences().sum(axis=0)
    covariance, _ = sandwich(around, observations.num_frames)
    chi2 = float(step[6:] @ np.linalg.solve(covariance[6:, 6:], step[6:]))
    moved = step.copy()
    moved[:6] -= pose.influences().sum(axis=0)
    moved_px = float(np.sqrt(moved @ around.motions @ moved))
    if chi2 <= MAX_INTRINSICS_CHI2 or moved_px <= MAX_INTRINSICS_PX:
        return []
    z = step[6:] / np.sqrt(np.diag(covariance)[6:])
    named = [
        f"{name} by {abs(each):.1f}" for name, each in zip(INTRINSICS, z, strict=True) if abs(each) > 2.0
    ]
    which = f" ({', '.join(named)} standard errors)" if named else ""
    return [
        f"the intrinsics look wrong{which}: freed, they would move the points by {moved_px:.0f} pixels, chi-square "
        f"{chi2:.0f} of 5, needed at most {MAX_INTRINSICS_CHI2:.0f}"
    ]
