"""Whether frames disagree about the camera, by the score that each has at the pose of all.

Where the scores show that there is not one pose, `moved_camera` looks for a few poses that fit the parts of the drive.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semcal_cli import core
from semcal_cli.drive.camera import core_camera
from semcal_cli.errors import format_against_limit
from semcal_cli.estimation.uncertainty.frame_scores import score_frames
from semcal_cli.estimation.uncertainty.information import compared_by
from semcal_cli.estimation.uncertainty.quantiles import hotelling_quantile
from semcal_cli.findings.check import Check
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.frame_naming import frame_list, frame_name
from semcal_cli.observations.observations import Observations

FRAMES_DISAGREE = Check(
    topic="frames-disagree",
    advice="check the times of sweeps and images, the motion and any labels, or remove these frames",
    entry=Entry(
        title="Frames disagree",
        section=PageSection.FILES,
        quotes=(
            (
                "frames disagree about the camera, they scatter 1.62 times as widely as chance "
                "explains (limit 1.20): check the times of sweeps and images, the motion and any labels, or "
                "remove these frames"
            ),
        ),
        meaning=(
            "Each frame pulls the pose in its own direction, farther than chance explains, and "
            "even two or three poses do not fit them all."
        ),
        cause=(
            "The clocks drift, motion is not compensated, the camera is loose, or some frames have "
            "wrong labels."
        ),
        remedy=(
            "The report shows where each frame alone puts the camera. Check the times first, then `motion:`."
        ),
        figure=(
            "Scatter of the frames' scores (Cochran's Q), relative to the limit of chance. The check "
            "needs two frames."
        ),
    ),
)
FINE_DEG, FINE_PX = 0.3, (2, 4)
"""Fine blocks for comparing frames, which sense small offsets: their angle, limited to these sides in pixels."""
COARSE_DEG = 1.0
"""Coarse blocks, which sense offsets of several degrees."""


@dataclass(frozen=True)
class Suspicion:
    """Evidence in the scores of frames against a single pose."""

    place: int | None
    """Number of frames before the likeliest change; None if no change explains the scores better than chance."""
    apart: float
    """Distance of the scores before and after the likeliest change, in standard errors."""
    allowed_apart: float
    """Largest allowed `apart`."""
    scatter: float
    """Cochran's Q over its degrees of freedom."""
    allowed: float
    """Largest allowed `scatter`."""
    outliers: tuple[int, ...]
    """Frames whose own score is farther from zero than chance explains."""

    @property
    def is_grave(self) -> bool:
        """Whether anything speaks against a single pose."""
        return self.place is not None or bool(self.outliers) or not self.scatter <= self.allowed


def compare_frames(observations: Observations, T_camera_lidar: Pose) -> Suspicion | None:
    """Compare the frames with one pose; None if they have no scores."""
    count = observations.num_frames
    if count < 2:
        return None
    px_per_deg = math.radians(core_camera(observations.camera).pixels_per_radian)
    fine = int(np.clip(round(FINE_DEG * px_per_deg), *FINE_PX))
    blocks_px = fine, max(round(COARSE_DEG * px_per_deg), fine + 1)
    by_blocks = [score_frames(observations, T_camera_lidar, block_px) for block_px in blocks_px]
    scored = [scores for scores in by_blocks if scores is not None]
    if not scored:
        return None
    num_squares = min(scores.num_squares for scores in scored)
    chance = FRAMES_DISAGREE.limit("chance")
    alpha = chance / (len(blocks_px) * count)
    # Two frames, one on either side of a change, have this many squares.
    limit = hotelling_quantile(alpha, 2.0 * num_squares / count)
    splits = max((scores.splits() for scores in scored), key=np.max)
    outliers = tuple(np.flatnonzero(np.any([scores.outliers(alpha) for scores in scored], axis=0)).tolist())
    # Limit of Q over its degrees of freedom, which chance alone exceeds in this fraction of cases.
    by_chance = core.fisher_limit(chance, 6 * (count - 1), num_squares - count)
    return Suspicion(
        place=int(np.argmax(splits)) + 1 if splits.max() > limit else None,
        apart=math.sqrt(max(splits.max(), 0.0)),
        allowed_apart=math.sqrt(limit),
        scatter=max(scores.heterogeneity for scores in scored) / (6.0 * (count - 1)),
        allowed=FRAMES_DISAGREE.limit(compared_by(observations)) * by_chance,
        outliers=outliers,
    )


def describe_disagreement(suspicion: Suspicion, names: Sequence[str]) -> str:
    """Describe how far frames disagree that a few poses do not explain."""
    reasons = []
    if suspicion.scatter > suspicion.allowed:
        ratio, most = format_against_limit(math.sqrt(suspicion.scatter), math.sqrt(suspicion.allowed), 2)
        reasons.append(f"they scatter {ratio} times as widely as chance explains (limit {most})")
    if suspicion.place is not None:
        apart, most = format_against_limit(suspicion.apart, suspicion.allowed_apart, 1)
        reasons.append(
            f"those from {frame_name(names, suspicion.place)} on are {apart} standard errors from those "
            f"before (limit {most})"
        )
    if suspicion.outliers:
        reasons.append(f"above all {frame_list(names, suspicion.outliers)}")
    return f"frames disagree about the camera, {', '.join(reasons)}"
