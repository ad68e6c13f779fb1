"""Settings of the initial calibration."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from semcal_cli.config.constants import MAX_BASELINE_M, MIN_OVERLAP, Zoom
from semcal_cli.config.setting import setting


@dataclass(frozen=True)
class PnpConfig:
    """How the robust PnP estimator works."""

    max_error_deg: float = 1.0
    """Pairs within this angle of the pose are its inliers."""
    min_inliers: int = 12
    """A pose needs at least this many inliers."""
    confidence: float = 0.999
    """Confidence at which RANSAC stops drawing samples."""
    max_iterations: int = 1000
    """Largest number of samples that RANSAC draws."""


@dataclass(frozen=True)
class AlignmentConfig:
    """How hypotheses ascend the mutual information over SE(3), on label images in blocks."""

    blocks_across: tuple[int, ...] = (120, 60, 120, 240)
    """Each level has the largest power-of-two block, in pixels, of which at least this many fit across the picture."""
    num_kept: tuple[int, ...] = (8, 6, 6, 6)
    """Number of the best hypotheses that go on from each level."""
    blocks_across_given: tuple[int, ...] = (16, 30, 60, 120, 240)
    """Levels for a given pose, which may be 20 degrees off."""
    blocks_across_near: tuple[int, ...] = (60, 120, 240)
    """Levels for a given pose that is off by a few degrees. What intensity tells is local, and coarse levels may lead
    away from it."""
    steps: int = 40
    """Steps of Adam at each level."""
    batch_size: int = 1024
    """Points in a mini-batch."""
    step_size: float = 0.25
    """Length of the first steps, in blocks. Steps fall along a cosine."""
    final_step: float = 0.05
    """Share of the first steps' length that the last ones have."""
    max_baseline_m: float = MAX_BASELINE_M
    """Largest distance between camera and LiDAR."""
    max_points: int = 100_000
    """Points, over all frames and directions, that are looked at."""
    edge_band_px: ClassVar[int] = 0
    """Blocks this coarse have no band along the borders of classes."""
    same_deg: float = 2.0
    """Hypotheses that come together to within this rotation have found the same pose."""


@dataclass(frozen=True)
class InitializationConfig:
    """How the mounting direction is searched for (Alg. 2)."""

    zoom: Zoom = setting(
        "exact",
        "Mapping of label images to the LiDAR's angular grid: through K and the lens, or as in the paper.",
    )
    coarse_cell_deg: float = 3.0
    """Cell of the exhaustive search. It is smaller for narrow lenses."""
    fine_cell_deg: float = 1.5
    """Block of the label images in Powell's refinement. It is smaller for narrow lenses."""
    max_roll_deg: float = 15.0
    """In-plane rotations from minus this to plus this are searched; 180 are all."""
    roll_step_deg: float = 5.0
    search_deg: float | None = setting(
        None,
        "With --init or --init-rpy-xyz: search all rotations within this angle of it.",
        above=0.0,
        most=180.0,
        metavar="DEG",
    )
    around_given_deg: float = 5.0
    """The search is narrowed to this angle of a given pose where ascents from it end apart."""
    meeting_deg: float = 0.5
    """Ascents from a given pose end apart if their rotations differ by more than this."""
    min_cells_of_most: float = 0.1
    """A placement counts only with this share of the best overlapping one's cells."""
    num_hypotheses: int = 24
    """Largest number of hypotheses that the registration gives."""
    separation_deg: float = 15.0
    """Smallest rotation between two hypotheses of the registration."""
    num_correspondences: int = 2000
    """Number of pairs of a point and a pixel that PnP takes of a placement."""
    pnp: PnpConfig = field(default_factory=PnpConfig)
    """Settings of PnP."""
    alignment: AlignmentConfig = field(default_factory=AlignmentConfig)
    """Settings of the ascent over SE(3)."""
    min_overlap: float = MIN_OVERLAP
    """Least share of the picture that visible points have to cover."""
    max_frames: int = 10
    """Frames that are looked at, evenly spaced: more make the mounting no clearer, and the refinement takes all."""
    runner_up_deg: float = 7.5
    """The runner-up is the best hypothesis at least this far from the winner. Nearer ones mean the same answer."""
