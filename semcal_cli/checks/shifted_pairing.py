"""Whether clouds agree better with the images a frame or two earlier or later than with their own."""

from __future__ import annotations

from semcal_cli.errors import counted
from semcal_cli.estimation.uncertainty.information import information_by_squares, paired_gain
from semcal_cli.findings.check import Check, Limit, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.findings.symptoms import OF_A_WRONG_POSE
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.observations import Observations

SHIFTED_PAIRING = Check(
    topic="shifted-pairing",
    explains=OF_A_WRONG_POSE | {"far-start"},
    advice="check which side lacks files that the other has, and pair sweeps and images by their stamps",
    entry=Entry(
        title="Images of the next frames fit better",
        section=PageSection.FILES,
        quotes=(
            (
                "images 1 frame later fit these sweeps 10.5 standard errors better than their own (limit 6): check "
                "which side lacks files that the other has, and pair sweeps and images by their stamps"
            ),
        ),
        meaning="All sweeps fit the images of other moments, the same number of frames away, better than their own.",
        cause="Files were paired by number although one side lacks some, or the clocks of the sensors differ.",
        remedy="Look at the stamps and at one overlay. `semcal import` pairs by time.",
        figure=(
            "Standard errors by which images one or two frames earlier or later fit better. The check needs segments, "
            "edges or intensity, and four frames that show other scenes than these."
        ),
    ),
    settings={
        "": Limit(
            at_most=6.0,
            unit="standard errors",
            source=(
                "thirteen frames of a traffic jam of KITTI, paired one or two frames off, are 9.4 to 10.6 better; "
                "eight drives of KITTI and KITTI-360 are -21.6 to -2.3 at their published poses, and at most 4.3 at "
                "poses 1 to 20 degrees away"
            ),
        )
    },
)
SHIFTS = (1, -1, 2, -2)
"""Numbers of frames by which images are taken later, where they were paired by number and a few are missing."""
MIN_FRAMES = 4
"""Smallest number of frames whose images are exchanged."""


def check_shifted_pairing(observations: Observations, T_camera_lidar: Pose) -> list[Measured]:
    """Check that images a frame or two away do not fit better; at a steady speed, the pose hides a wrong pairing."""
    if not observations.is_multimodal:
        return []
    images, scenes = observations.images, observations.scenes
    gains = {}
    for shift in SHIFTS:
        later = {frame: frame + shift for frame in range(len(scenes)) if 0 <= frame + shift < len(scenes)}
        # Images of one scene belong to all of its sweeps.
        frames = [frame for frame, other in later.items() if scenes[frame] != scenes[other]]
        if len(frames) >= MIN_FRAMES:
            own = observations.of_frames(frames)
            exchanged = own.with_images([images[later[frame]] for frame in frames])
            by_squares = [information_by_squares(seen, T_camera_lidar) for seen in (own, exchanged)]
            gains[shift] = paired_gain(*by_squares).significance
    if not gains:
        return []
    shift = max(gains, key=lambda shift: gains[shift])
    sentence = (
        f"images {counted(abs(shift), 'frame')} {'later' if shift > 0 else 'earlier'} fit these sweeps "
        f"{gains[shift]:.1f} standard errors better than their own (limit {SHIFTED_PAIRING.limit():g})"
    )
    return [SHIFTED_PAIRING.measured(gains[shift], sentence)]
