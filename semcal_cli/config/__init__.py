"""Every default of a calibration, once.

A stage takes its settings as one of these classes, and the Rust core reads the attributes of the same objects. The
settings that change an answer are in the result under `settings.options`. Nothing heavy is imported, for a fast --help.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

from semcal_cli.config.cues import AUTO as AUTO, LABELS as LABELS, CueName as CueName, check_cues
from semcal_cli.config.setting import MAX_SEED as MAX_SEED, check_settings, setting
from semcal_cli.errors import InputError, check_torch

Estimator: TypeAlias = Literal["exact", "mine"]
"""How mutual information is estimated: by the histogram of classes, or by a network's lower bound."""
Device: TypeAlias = Literal["cpu", "cuda"]
"""Device that runs the network of MINE."""
Zoom: TypeAlias = Literal["exact", "paper"]
"""How a label image is resampled onto the LiDAR's angular grid: through K and the lens, or as in the paper."""

MAX_FRAMES = 70
"""Maximum number of frames used of a longer drive. More frames hardly improve an answer, because the errors of
the labels' borders then dominate."""
MAX_PIXELS = 100_000_000
"""Maximum number of pixels of an image."""
MAX_POINTS = 10_000_000
"""Maximum number of points in a sweep, and of rows in a file of their labels or features. A file has at most 64 bytes
per point."""
MAX_BASELINE_M = 3.0
"""Maximum distance between camera and LiDAR. It holds poses near the rig where labels hardly constrain the
translation."""
EDGE_BAND_PX = 1
"""Pixels closer than this to another class count a tenth: pairs that only show that a border is near would blur the
table of pointwise mutual information. On six drives of ten frames, the median errors without a band and with this one
are 0.012 and 0.010 degrees with clean labels, 0.011 and 0.009 with objects dilated by two pixels, 0.021 and 0.011 with
objects eroded by two, and 0.051 and 0.038 with network-like labels. Wider bands gain less."""
MIN_OVERLAP = 0.03
"""Minimum fraction of the image that visible points cover. Less overlap constrains a pose too little."""
FAR_DEG = 3.0
"""Size of the coarsest blocks with which the refinement converges from 20 degrees and half a metre."""


@dataclass(frozen=True)
class PnpConfig:
    """Settings of the robust PnP estimator."""

    max_error_deg: float = 1.0
    """Pairs whose angular error is below this are inliers."""
    min_inliers: int = 12
    """Minimum number of inliers of a pose."""
    confidence: float = 0.999
    """Confidence at which RANSAC stops drawing samples."""
    max_iterations: int = 1000
    """Maximum number of samples that RANSAC draws."""


@dataclass(frozen=True)
class AlignmentConfig:
    """How hypotheses ascend the mutual information over SE(3), on label images in blocks."""

    blocks_across: tuple[int, ...] = (120, 60, 120, 240)
    """Each level has the largest power-of-two block, in pixels, of which at least this many fit across the image."""
    num_kept: tuple[int, ...] = (8, 6, 6, 6)
    """Number of hypotheses that each level keeps, the best ones."""
    blocks_across_given: tuple[int, ...] = (16, 30, 60, 120, 240)
    """The same for a given pose that may be 20 degrees off."""
    blocks_across_near: tuple[int, ...] = (60, 120, 240)
    """The same for a given pose that is off by a few degrees. Intensity constrains a pose only locally, and coarse
    levels may lead away from it."""
    steps: int = 40
    """Steps of Adam at each level."""
    batch_size: int = 1024
    """Points in a mini-batch."""
    step_size: float = 0.25
    """Length of the first steps, in blocks. It decreases along a cosine."""
    final_step: float = 0.05
    """Length of the last steps, relative to the first."""
    max_points: int = 20_000
    """Number of points in the images that is enough, over all frames."""
    same_deg: float = 2.0
    """Hypotheses that end within this rotation of one another have found the same pose."""


@dataclass(frozen=True)
class InitializationConfig:
    """Settings of the search for the mounting (Alg. 2)."""

    zoom: Zoom = setting(
        "exact",
        "Mapping of label images to the LiDAR's angular grid: through K and the lens, or as in the paper.",
    )
    coarse_cell_deg: float = 3.0
    """Cell size of the exhaustive search. It is smaller for narrow lenses."""
    fine_cell_deg: float = 1.5
    """Block size of the label images in Powell's refinement. It is smaller for narrow lenses."""
    max_roll_deg: float = 15.0
    """In-plane rotations from minus this to plus this are searched; 180 searches all."""
    roll_step_deg: float = 5.0
    search_deg: float | None = setting(
        None,
        "With --init or --init-rpy-xyz: search all rotations within this angle of the given pose.",
        above=0.0,
        maximum=180.0,
        metavar="DEG",
    )
    around_given_deg: float = 5.0
    """Where ascents from a given pose end apart, the search covers this angle around it."""
    meeting_deg: float = 0.5
    """Ascents from a given pose end apart if their rotations differ by more than this."""
    min_cells_of_most: float = 0.1
    """Minimum number of overlapping cells of a placement, relative to the placement that overlaps most."""
    num_hypotheses: int = 24
    """Maximum number of hypotheses that the registration returns."""
    separation_deg: float = 15.0
    """Minimum rotation between two hypotheses of the registration."""
    num_correspondences: int = 2000
    """Number of point-pixel pairs that PnP uses for each placement."""
    pnp: PnpConfig = field(default_factory=PnpConfig)
    """Settings of PnP."""
    alignment: AlignmentConfig = field(default_factory=AlignmentConfig)
    """Settings of the ascent over SE(3)."""
    min_overlap: float = MIN_OVERLAP
    """Minimum fraction of the image that visible points cover."""
    max_frames: int = 10
    """Maximum number of frames used, evenly spaced. More do not make the mounting clearer; the refinement uses all."""
    runner_up_deg: float = 7.5
    """The runner-up is the best hypothesis at least this far from the winner. Nearer ones are the same answer."""


@dataclass(frozen=True)
class PyramidConfig:
    """Which levels of the label pyramid are used, and when a pose counts as settled (Alg. 1)."""

    coarsest_block_deg: float = 0.45
    """The pyramid starts at the largest power-of-two block below this angle. The initial calibration ends there."""
    min_blocks: int = 16
    """The coarsest block fits at least this many times along either side of the image."""
    hidden_below_block_deg: float = 0.45
    """Points that the camera cannot see are dropped at levels finer than this. A coarse pose does not determine well
    enough which points are hidden."""
    min_points: int = 100
    """Minimum number of labelled points on labelled pixels at a level."""
    max_final_drift: float = setting(
        0.5,
        "Maximum drift of the pose over the last steps that counts as settled.",
        above=0.0,
        option="--mine-settled-px",
        metavar="PX",
    )
    """Drift of the mean over the last quarter of the finest level from the mean over the quarter before, in blocks."""


@dataclass(frozen=True)
class ExactConfig:
    """How Adam maximises the exact mutual information over mini-batches. Its variables move the points by one block."""

    steps: int = 60
    """Steps of Adam at each level."""
    batch_size: int = 4096
    """Points in a mini-batch."""
    step_size: float = 0.2
    """Length of the first steps, in blocks. It decreases along a cosine."""
    final_step: float = 0.05
    """Length of the last steps, relative to the first."""
    max_points: int = 40_000
    """Number of points in the images that is enough, over all frames."""


@dataclass(frozen=True)
class ContrastConfig:
    """How starts are chosen, and coarse levels ascended, by contrast.

    Pixels are levels in ascending order. Contrast is their mean under points of some classes, less that under points of
    class 0, which belong on lower levels.
    """

    class_weights: dict[str, float]
    """Weight of the points of each class, by its name; others do not count."""
    num_draws: int
    """Number of poses drawn around the given one, of which the best become starts."""
    max_points: int
    """Number of points in the images that is enough to compare drawn poses, over all frames."""
    distance_weight: float
    """Levels of contrast that a pose at the distance of the farthest draws loses, and four times as many at twice that
    distance."""


@dataclass(frozen=True)
class StartsConfig:
    """How many poses around a given one the ascents start from, and how far away, for objectives with many maxima."""

    coarsest_block_deg: float
    """Size of the coarsest blocks."""
    min_blocks: int
    """The coarsest block fits at least this many times along either side of the image."""
    num_starts: tuple[int, ...]
    """Number of starts at each of the first levels; the last number holds for all that follow."""
    spread_deg: tuple[float, float]
    spread_m: tuple[float, float]
    """Distances of the nearest and of the farthest of the other starts from the given pose."""
    farthest_deg: float
    farthest_m: float = 1.0
    """Poses farther from the given one are dropped: on coarse blocks, false maxima there beat the right one."""
    num_rounds: int = 2
    """Ascents at each level while starts lead to different maxima; each chooses its points anew."""
    first_frames: int | None = None
    """Number of frames of the first level, which only has to locate the maxima; None uses all."""
    coarse: ExactConfig | None = None
    """Steps and points of all levels but the finest, which only have to separate the maxima; None uses those of the
    finest."""
    contrast: ContrastConfig | None = None
    """How starts are chosen and coarse levels ascended by contrast; None if information leads there."""
    searches_beside: bool = False
    """Whether higher maxima are looked for around the best one."""


@dataclass(frozen=True)
class PolishConfig:
    """How Newton's method ends the refinement, and when held-out data reject its pose."""

    max_rounds: int = 8
    """Maximum number of times that the visible points are chosen."""
    max_steps: int = 8
    """Newton steps for each choice of points."""
    tolerance_px: float = 0.01
    """Rounds end when one moves the points by less than this, root mean square."""
    settled_px: float = 0.1
    """A pose has settled if the last round moved the points by no more than this, or tried to and gained nothing."""
    min_frames: int = 6
    """With fewer frames than this, regions of the images are held out instead of frames."""
    regions_across: int = 9
    """Number of regions across an image, where regions are held out."""
    max_loss: float = 3.0
    """A polish is rejected if held-out data get worse by more than this many standard errors. The loss is up to 2.6 on
    36 good calibrations of development drives, and up to 3.8 with K wrong by 10 %."""
    max_loss_of_tops: float = 5.0
    """The same for a pose that is the best of several maxima of all data. Held-out data took part in that choice, and
    lose by any other. With segments the loss is 0 to 3.2 standard errors, 1.9 on average, on 11 good synthetic
    drives."""


@dataclass(frozen=True)
class SensitivityConfig:
    """Settings for the curvature and the scores of the mutual information at a pose."""

    factor: int = 1
    """Side of a block of the label images, in pixels."""
    max_points: int = 2**62
    """Number of points in the images that is enough, over all frames."""
    regions_across: int = 9
    """Number of squares across an image, each with its own score."""


@dataclass(frozen=True)
class AscentConfig:
    """How the mutual information is maximised over pose, intrinsics and time offset together."""

    factors: tuple[int, ...]
    """Sides of the blocks of the levels, coarsest first, pixels."""
    changes: tuple[float, ...]
    """Initial changes of the variables other than the pose."""
    sigmas: tuple[float, ...]
    """Standard deviations of the priors of these variables."""
    evidence: float
    """Nats of log-likelihood per nat of mutual information."""
    max_coarse_points: int = 40_000
    """Number of points in the images that is enough on blocks of more than two pixels, over all frames."""
    max_rounds: int = 8
    """Maximum number of times that the visible points are chosen at each level."""
    max_steps: int = 6
    """Newton steps for each choice of points."""
    tolerance: float = 0.02
    """A level ends when a round moves the points by less than this fraction of a block."""


FOCAL_SIGMA = 0.02
"""Default relative standard deviation of the focal lengths."""
CENTER_SIGMA_PX = 10.0
"""Default standard deviation of the principal point, pixels."""
SIGMA: dict[str, Any] = {"minimum": 1e-11, "maximum": 1e3}
"""Limits of the standard deviations of priors; the squares of others overflow or vanish."""


@dataclass(frozen=True)
class AdjustmentConfig:
    """What is estimated with the pose, and its priors."""

    intrinsics: tuple[str, ...] = ()
    """Names of the intrinsics, such as fx, cy or k1."""
    focal_sigma: float | None = setting(None, minimum=0.0, maximum=1e3)
    """Relative standard deviation of the focal lengths; 0 means that they are exact. None uses what the drive states,
    or else `FOCAL_SIGMA` if they are estimated and `DEFAULT_FOCAL_SIGMA` if not."""
    center_sigma_px: float | None = setting(None, minimum=0.0, maximum=1e3)
    """Standard deviation of the principal point, pixels; None uses what the drive states, or else `CENTER_SIGMA_PX` or
    `DEFAULT_CENTER_SIGMA_PX`."""
    lens_sigma: float = setting(0.1, **SIGMA)
    """Standard deviation of the lens parameters, such as k1, xi or w."""
    tangential_sigma: float = setting(0.005, **SIGMA)
    """Standard deviation of p1, p2, s1 to s4, tau_x and tau_y, which describe how well a lens is centred."""
    with_delay: bool = False
    """Whether the time offset is estimated."""
    delay_sigma_s: float = setting(0.1, "Standard deviation of the time offset, in seconds.", **SIGMA)

    @property
    def is_empty(self) -> bool:
        """Whether nothing besides the pose is estimated."""
        return not (self.intrinsics or self.with_delay)


@dataclass(frozen=True)
class RefinementConfig:
    """Which estimator refines a pose, and whether the result is polished."""

    estimator: Estimator = setting(
        "exact",
        "Objective: the labels' exact mutual information, or the paper's MINE, a network's lower bound on it. MINE "
        "needs PyTorch, which the extra mine installs.",
    )
    device: Device = setting("cpu", "Device that runs the network of MINE.")
    is_polished: bool = True
    """Whether the polish ends the refinement."""
    max_baseline_m: float = setting(
        MAX_BASELINE_M, "Maximum distance between camera and LiDAR.", above=0.0, metavar="M"
    )
    edge_band_px: int = setting(
        EDGE_BAND_PX,
        "Pixels closer than this to another class count one tenth; use more for labels with ragged borders.",
        minimum=0,
        maximum=100,
        option="--edge-band",
        metavar="PX",
    )
    jointly: AdjustmentConfig = field(default_factory=AdjustmentConfig)
    """What is estimated with the pose."""
    polish: PolishConfig = PolishConfig()
    """Settings of the polish."""


@dataclass(frozen=True)
class CalibrationConfig:
    """The settings of a calibration that a user chooses. The other classes keep their defaults."""

    seed: int = setting(0, "Random seed. Equal seeds give identical output.", minimum=0, maximum=MAX_SEED)
    cues: tuple[CueName, ...] = AUTO
    """What points and pixels are compared by."""
    max_frames: int = setting(MAX_FRAMES, "Use at most N frames, chosen for variety.", minimum=1)
    initialization: InitializationConfig = field(default_factory=InitializationConfig)
    """Settings of the initial calibration."""
    refinement: RefinementConfig = field(default_factory=RefinementConfig)
    """Settings of the refinement."""
    num_seeds: int = setting(1, minimum=1)
    """Number of seeds, counted from `seed`. More than one shows whether they lead to the same pose."""
    num_folds: int = setting(1, minimum=1)
    """Number of parts of the drive that are polished alone. More than one shows whether the intervals are right."""
    is_raw: bool = False
    """Whether labels and intensities are used without preprocessing: isolated pixels of label images are not repaired,
    and intensities and grey values are numbers instead of levels."""


@dataclass(frozen=True)
class Limits:
    """How far a transform may be off."""

    rotation_deg: float = setting(0.3, "Limit about each axis of the camera, and in total.", minimum=0.0)
    translation_m: float = setting(0.05, "Limit along each axis of the camera, and in total.", minimum=0.0)
    delay_s: float | None = setting(None, minimum=0.0)
    """Limit of the time offset, seconds, which is then estimated with the pose; None leaves it unchecked."""


def check_config(config: CalibrationConfig) -> None:
    """Check the settings that a program passes for a calibration; the command line checks its own options.

    Raises:
        InputError: a setting has the wrong type or is out of range, or MINE is chosen and torch is not installed.
    """
    if not isinstance(config, CalibrationConfig):
        raise InputError(f"config: found {config!r}, expected a CalibrationConfig")
    check_cues(config.cues)
    check_settings(config)
    if config.refinement.estimator == "mine":
        check_torch("estimator 'mine'")
    jointly = config.refinement.jointly
    for name in ("focal_sigma", "center_sigma_px") if jointly.intrinsics else ():
        # Intrinsics that are stated to be exact cannot be estimated.
        if (sigma := getattr(jointly, name)) is not None and sigma < SIGMA["minimum"]:
            needed = f"a number from {SIGMA['minimum']:g} to {SIGMA['maximum']}"
            raise InputError(f"{name}: found {sigma!r}, expected {needed}")
