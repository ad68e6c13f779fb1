"""Settings of the refinement, of the polish and of what is estimated beside the pose."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from semcal_cli.config.constants import EDGE_BAND_PX, MAX_BASELINE_M, Device, Estimator
from semcal_cli.config.setting import setting


@dataclass(frozen=True)
class PyramidConfig:
    """Which levels of the label pyramid are ascended, and when a pose counts as settled (Alg. 1)."""

    coarsest_block_deg: float = 0.45
    """The pyramid starts at the largest power-of-two block below this angle. The initial calibration ends there."""
    min_blocks: int = 16
    """The pyramid starts no coarser than at a block of which this many fit along either side of the picture."""
    hidden_below_block_deg: float = 0.45
    """Points that the camera cannot see are dropped at levels finer than this. While the pose is coarse, it is not
    known well enough which are hidden."""
    min_points: int = 100
    """A level needs at least this many labelled points on labelled pixels."""
    max_final_drift: float = setting(
        0.5,
        "Largest drift of the pose over the last steps that counts as settled.",
        above=0.0,
        option="--mine-settled-px",
        metavar="PX",
    )
    """In blocks: that of the mean over the last quarter of the finest level from the mean over the quarter before."""


@dataclass(frozen=True)
class ExactConfig:
    """How the exact mutual information is ascended: Adam over mini-batches, in motions of the points by one block."""

    steps: int = 60
    """Steps of Adam at each level."""
    batch_size: int = 4096
    """Points in a mini-batch."""
    step_size: float = 0.2
    """Length of the first steps, in blocks. Steps fall along a cosine."""
    final_step: float = 0.05
    """Share of the first steps' length that the last ones have."""
    max_points: int = 200_000
    """Points, over all frames and directions, that are looked at."""
    max_baseline_m: float = MAX_BASELINE_M
    """Largest distance between camera and LiDAR."""
    edge_band_px: int = EDGE_BAND_PX
    """Pixels less than this from one of another class count a tenth."""


@dataclass(frozen=True)
class StartsConfig:
    """From how many poses around a given one information is ascended that has many tops, and how far away."""

    coarsest_block_deg: float
    """Size of the coarsest blocks."""
    min_blocks: int
    """The pyramid starts no coarser than at a block of which this many fit along either side of the picture."""
    num_starts: tuple[int, ...]
    """Number of poses from which the first levels are ascended; the last number holds from then on."""
    spread_deg: tuple[float, float]
    spread_m: tuple[float, float]
    """Distances of the nearest and of the farthest of the other starts from the given pose."""
    farthest_deg: float
    farthest_m: float = 1.0
    """Poses farther from the given one are dropped: coarse blocks have tops there that beat the right one."""
    num_rounds: int = 2
    """Ascents at each level while starts lead to different tops; the points are chosen anew for each."""
    first_frames: int | None = None
    """Number of frames by which the first level is ascended, which only has to tell where tops are; None takes all."""
    coarse: ExactConfig | None = None
    """Steps and points of all levels but the finest, which only have to tell tops apart; None takes those of the
    finest."""


@dataclass(frozen=True)
class PolishConfig:
    """How Newton's method finishes a pose, and when held-out data reject that."""

    max_rounds: int = 8
    """Largest number of times that visible points are chosen."""
    max_steps: int = 8
    """Newton steps for each choice of points."""
    tolerance_px: float = 0.01
    """Rounds end when one moved the points by less than this, root mean square."""
    settled_px: float = 0.1
    """A pose has settled if the last round moved the points, or wanted to and gained nothing, by no more than this."""
    max_baseline_m: float = MAX_BASELINE_M
    """Largest distance between camera and LiDAR."""
    edge_band_px: int = EDGE_BAND_PX
    """Pixels less than this from one of another class count a tenth."""
    min_frames: int = 6
    """With fewer frames than this, regions of the pictures are held out instead of frames."""
    regions_across: int = 9
    """Number of regions across a picture, where regions are held out."""
    max_loss: float = 3.0
    """A polish is rejected if held-out data get worse by more than this many standard errors. On 36 good calibrations
    of development drives the loss was up to 2.6, with K wrong by 10 % up to 3.8."""
    max_loss_of_tops: float = 5.0
    """The same for a pose that is the best of several tops of all data: what is held out has had its part in it, and
    loses by any other. By segments it was 0 to 3.2 standard errors, 1.9 in the mean, on 11 good synthetic drives."""


@dataclass(frozen=True)
class SensitivityConfig:
    """Settings of the curvature and the scores of the mutual information at a pose."""

    factor: int = 1
    """Side of a block of the label images, in pixels."""
    edge_band_px: int = EDGE_BAND_PX
    """Width of the edge band in the settings of the polish."""
    max_points: int = 2**62
    """Largest number of points, over all frames."""
    regions_across: int = 9
    """Number of squares side by side in an image, each with a score of its own."""


@dataclass(frozen=True)
class JointConfig:
    """How pose, intrinsics and the offset of the clock are brought to the top of the mutual information together."""

    factors: tuple[int, ...]
    """Sides of the blocks of the levels, coarsest first, pixels."""
    changes: tuple[float, ...]
    """Changes of the variables after the pose at the start."""
    sigmas: tuple[float, ...]
    """Standard deviations of these variables, by what was known before."""
    evidence: float
    """Nats of a likelihood that a nat of mutual information is worth."""
    edge_band_px: int = EDGE_BAND_PX
    """Pixels less than this from one of another class count a tenth."""
    max_coarse_points: int = 200_000
    """Points, over all frames and directions, that are looked at on blocks of more than two pixels."""
    max_rounds: int = 8
    """Largest number of times that visible points are chosen at each level."""
    max_steps: int = 6
    """Newton steps for each choice of points."""
    tolerance: float = 0.02
    """A level ends when a round moved the points by less than this share of a block."""
    max_baseline_m: float = MAX_BASELINE_M
    """Largest distance between camera and LiDAR."""


FOCAL_SIGMA = 0.02
"""Standard deviation of focal lengths, as a share of them, that nothing else is stated of."""
CENTER_SIGMA_PX = 10.0
"""The same of the principal point, in pixels."""


SIGMA: dict[str, Any] = {"least": 1e-11, "most": 1e3}
"""Limits of standard deviations of what is known before; squares of others overflow or vanish."""


@dataclass(frozen=True)
class JointlyConfig:
    """What is estimated beside the pose, and what is known of it before."""

    intrinsics: tuple[str, ...] = ()
    """Names of the intrinsics, as fx, cy or k1."""
    focal_sigma: float | None = setting(None, least=0.0, most=1e3)
    """Standard deviation of focal lengths, as a share of them, whether they are estimated or not; 0 says that they are
    exact. None is what the drive states, else `FOCAL_SIGMA` if they are estimated, and `DEFAULT_FOCAL_SIGMA` if not."""
    center_sigma_px: float | None = setting(None, least=0.0, most=1e3)
    """The same of the principal point, pixels; None is what the drive states, else `CENTER_SIGMA_PX` or
    `DEFAULT_CENTER_SIGMA_PX`."""
    lens_sigma: float = setting(0.1, **SIGMA)
    """Standard deviation of the numbers of the lens, such as k1, xi or w."""
    tangential_sigma: float = setting(0.005, **SIGMA)
    """The same of p1, p2, s1 to s4, tau_x and tau_y, which tell how well a lens is centred."""
    with_delay: bool = False
    """Whether the offset of the camera's clock is estimated."""
    delay_sigma_s: float = setting(0.1, "Standard deviation of this offset, in seconds.", **SIGMA)

    @property
    def is_asked(self) -> bool:
        """Whether anything is estimated beside the pose."""
        return bool(self.intrinsics) or self.with_delay


@dataclass(frozen=True)
class RefinementConfig:
    """Which estimator refines a pose, and whether the result is polished."""

    estimator: Estimator = setting(
        "exact",
        "Objective: the labels' exact mutual information, or the paper's MINE, a network's lower bound on it (needs "
        "PyTorch: the extra mine).",
    )
    device: Device = setting("cpu", "Device of the network of MINE.")
    is_polished: bool = True
    """Whether Newton's method finishes the pose."""
    max_baseline_m: float = setting(
        MAX_BASELINE_M, "Largest distance between camera and LiDAR.", above=0.0, metavar="M"
    )
    edge_band_px: int = setting(
        EDGE_BAND_PX,
        "Pixels nearer than this to another class count a tenth; use more for labels with ragged borders.",
        least=0,
        most=100,
        option="--edge-band",
        metavar="PX",
    )
    jointly: JointlyConfig = field(default_factory=JointlyConfig)
    """What is estimated beside the pose."""

    @property
    def polish(self) -> PolishConfig:
        """Settings of the polish, with those that all stages share."""
        return PolishConfig(max_baseline_m=self.max_baseline_m, edge_band_px=self.edge_band_px)
