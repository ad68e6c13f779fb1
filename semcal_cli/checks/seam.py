"""Whether sweeps whose points have no times begin at a seam, where they may be smeared."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from semcal_cli.drive.document import Drive
from semcal_cli.files.array_forms import SweepCloud
from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.finding import Finding
from semcal_cli.geometry.arrays import Points

SEAM = Check(
    topic="seam",
    advice="if nothing has deskewed the sweeps, give lidar.spin, by which `motion` deskews them",
    entry=Entry(
        title="Sweeps begin at a seam, and their points have no times",
        section=PageSection.INSPECTION,
        quotes=(
            (
                "the points have no times, but are in the order of one turn, clockwise from 90 degrees: if nothing "
                "has deskewed the sweeps, give lidar.spin, by which `motion` deskews them"
            ),
        ),
        meaning=(
            "The first and the last points of a sweep look the same way, but a whole turn lies between them. A rig "
            "that moves meanwhile smears the sweep."
        ),
        cause="The file lists the points as they were measured, and the recorder left out their times.",
        remedy=(
            "State `lidar: {spin: {rate_hz: 10, clockwise: true, seam_deg: 90}}` with the rate of the LiDAR and the "
            "seam that the sentence names, and [`motion:`](drive.md#a-lidar-that-moves-while-it-turns). If the sweeps "
            "are deskewed, `motion: {point_times: deskewed}` says so."
        ),
    ),
)
NUM_PARTS = 180
"""Number of parts into which the points of a sweep are divided to see whether they are in the order of one turn."""
MIN_COHERENCE = 0.9
"""Smallest length of the mean of the directions in a part: parts of one turn span some 2 degrees, those of a file that
lists ring by ring span a third of a turn or more."""
MIN_SHARE_ONWARD = 0.95
"""Smallest share of the parts that follow the one before in the direction of the turn."""
TURN_DEG = 300.0, 400.0
"""Range of the whole turn."""


def check_seam(drive: Drive, clouds: Sequence[SweepCloud]) -> tuple[Finding, ...]:
    """Check that sweeps of a rig that may move, whose points are in the order of one turn, have times or a spin."""
    motion = drive.motion
    if motion is None:
        may_be_smeared = drive.first_stamp is not None
    else:
        may_be_smeared = motion.point_times != "deskewed" and motion.speed_m_s != 0.0
    if not may_be_smeared or any(drive.point_times(cloud) is not None for cloud in clouds):
        return ()
    seams = [seam_of(drive.rays(cloud.points)) for cloud in clouds]
    if not seams or seams[0] is None or None in seams:
        return ()
    is_clockwise, seam_deg = seams[0]
    side = "clockwise" if is_clockwise else "counter-clockwise"
    order = f"in the order of one turn, {side} from {round(seam_deg) % 360} degrees"
    return (SEAM.finding(f"the points have no times, but are {order}"),)


def seam_of(points: Points) -> tuple[bool, float] | None:
    """Find where a sweep begins if its points are in the order of one turn, as many recorders write them.

    Args:
        points: (N, 3) metres, from where the rays start.

    Returns:
        Whether the LiDAR turns clockwise as seen from above, and the azimuth of the first points in degrees; None if
        the points are in another order.
    """
    azimuths = np.arctan2(points[:, 1], points[:, 0], dtype=np.float64)
    if len(azimuths) < NUM_PARTS:
        return None
    parts = np.array([np.mean(part) for part in np.array_split(np.exp(1j * azimuths), NUM_PARTS)])
    steps = np.angle(parts[1:] / parts[:-1])
    turn_deg = float(np.degrees(np.abs(steps.sum())))
    is_clockwise = bool(steps.sum() < 0.0)
    share_onward = np.mean((steps < 0.0) == is_clockwise)
    is_coherent = np.median(np.abs(parts)) >= MIN_COHERENCE and share_onward >= MIN_SHARE_ONWARD
    if not is_coherent or not TURN_DEG[0] <= turn_deg <= TURN_DEG[1]:
        return None
    return is_clockwise, float(np.degrees(np.angle(parts[0]) - 0.5 * np.median(steps)))
