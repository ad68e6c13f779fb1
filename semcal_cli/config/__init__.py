"""Every default of a calibration, once.

A stage takes its settings as one of these classes, and the Rust core reads the attributes of the same objects. The
settings that change an answer are recorded in the result under `settings.options`. Nothing heavy is imported here, so
that `semcal --help` can show them at once.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, TypeAlias, get_args

from semcal_cli.config.setting import MAX_SEED as MAX_SEED
from semcal_cli.config.setting import check_settings, setting
from semcal_cli.errors import InputError, check_torch, one_of

CueName: TypeAlias = Literal["labels", "segments", "edges", "intensity", "features", "auto"]
"""What points and pixels are compared by; auto takes the best of what the files of a drive allow."""
Estimator: TypeAlias = Literal["exact", "mine"]
"""How mutual information is estimated: by the histogram of classes, or by a network's lower bound."""
Device: TypeAlias = Literal["cpu", "cuda"]
"""Where the network of MINE computes."""
Zoom: TypeAlias = Literal["exact", "paper"]
"""How a label image is brought to the LiDAR's angular grid: through K and the lens, or as the paper does."""

LABELS: tuple[CueName, ...] = ("labels",)
AUTO: tuple[CueName, ...] = ("auto",)
MAX_FRAMES = 70
"""Frames of a longer drive that are used. More of them make an answer hardly better: its error is then that of the
labels' borders."""
MAX_PIXELS = 100_000_000
"""Most pixels of a picture."""
MAX_POINTS = 10_000_000
"""Points of the largest sweep that is read, and rows of a file of their labels or features. A file has at most 64
bytes a point."""
MAX_BASELINE_M = 3.0
"""Largest distance between camera and LiDAR. Where labels hardly tell the translation, poses would leave the rig."""
EDGE_BAND_PX = 1
"""Pixels less than this from one of another class count a tenth: pairs that mean nothing but a border near by would
blur the table of pointwise mutual information. On six drives of ten frames, without a band and with this one, median
errors are 0.012 and 0.010 degrees with clean labels, 0.011 and 0.009 with things dilated by two pixels, 0.021 and 0.011
with things eroded by as much, 0.051 and 0.038 with network-like labels; wider bands gain less."""
MIN_OVERLAP = 0.03
"""Least share of the picture that visible points cover. A pose with less says little."""
FAR_DEG = 3.0
"""The refinement converges from 20 degrees and half a metre if its coarsest blocks have this size."""


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


@dataclass(frozen=True)
class CalibrationConfig:
    """What a user sets of a calibration. Settings of the other classes keep their defaults."""

    seed: int = setting(
        0, "Seed of every random choice: the same seed gives the same bytes.", least=0, most=MAX_SEED
    )
    cues: tuple[CueName, ...] = AUTO
    """What points and pixels are compared by."""
    max_frames: int = setting(
        MAX_FRAMES, "Use at most N frames of a longer drive, those whose label images differ most.", least=1
    )
    initialization: InitializationConfig = field(default_factory=InitializationConfig)
    """Settings of the initial calibration."""
    refinement: RefinementConfig = field(default_factory=RefinementConfig)
    """Settings of the refinement."""
    num_seeds: int = setting(1, least=1)
    """With more than one, the seeds that follow are tried as well, to see where they lead."""
    is_raw: bool = False
    """Whether labels and intensities are taken as they are: isolated pixels of label images are not mended, and
    intensities and grey values are numbers instead of levels."""


@dataclass(frozen=True)
class Limits:
    """How far a transform may be off."""

    rotation_deg: float = setting(0.3, "About each axis of the camera, and in all.", least=0.0)
    translation_m: float = setting(0.05, "Along each axis of the camera, and in all.", least=0.0)
    delay_s: float | None = setting(None, least=0.0)
    """Of the camera's clock, seconds, which is then estimated together with the pose; None leaves it unchecked."""


def check_config(config: CalibrationConfig) -> None:
    """Check the settings that a program gives of a calibration; the command line checks its own options.

    Raises:
        InputError: a setting is of another type or out of its range, or MINE is asked for without torch.
    """
    if not isinstance(config, CalibrationConfig):
        raise InputError(f"config: found {config!r}, needed a CalibrationConfig")
    cues = config.cues
    if not isinstance(cues, tuple) or not cues or len({*map(str, cues)}) < len(cues):
        raise InputError(f"cues: found {cues!r}, needed a tuple of different cues")
    if "auto" in cues and len(cues) > 1:
        raise InputError(f"cues: found {cues!r}, needed auto alone")
    for cue in cues:
        if cue not in get_args(CueName):
            raise InputError(f"cues: found {cue!r}, needed {one_of(str(cue), get_args(CueName))}")
    check_settings(config)
    if config.refinement.estimator == "mine":
        check_torch("estimator 'mine'")
    jointly = config.refinement.jointly
    for name in ("focal_sigma", "center_sigma_px") if jointly.intrinsics else ():
        # Intrinsics that are stated to be exact cannot be estimated.
        if (sigma := getattr(jointly, name)) is not None and sigma < SIGMA["least"]:
            needed = f"a number from {SIGMA['least']:g} to {SIGMA['most']}"
            raise InputError(f"{name}: found {sigma!r}, needed {needed}")
