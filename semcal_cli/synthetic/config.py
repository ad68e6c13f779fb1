"""What a synthetic drive is like; apart from the work itself, so that `semcal --help` answers at once."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

Pattern: TypeAlias = Literal["spinning", "rosette"]
Lens: TypeAlias = Literal["standard", "narrow", "wide", "fisheye", "omnidirectional", "equirectangular"]
Ontology: TypeAlias = Literal["shared", "disjoint"]

MIN_BASELINE_M = 0.1
"""A camera mounted at random is no nearer to the LiDAR: without parallax a drive tests too little."""
MAX_BASELINE_M = 1.5
"""The synthetic street keeps this much room around the LiDAR."""


@dataclass(frozen=True)
class SynthConfig:
    """A synthetic drive, to the last byte. What the mounting leaves open is drawn from the seed."""

    num_frames: int = 20
    """Number of frames, each of another street."""
    seed: int = 0
    """Seed of everything that is drawn: the same seed gives the same bytes."""

    pattern: Pattern = "spinning"
    """Pattern in which the LiDAR scans."""
    channels: int = 64
    """Number of beams, evenly spaced in elevation."""
    columns: int = 800
    """Firings a turn; a rosette has channels * columns rays a frame."""
    fov_up_deg: float = 10.0
    """Elevation of the highest ray."""
    fov_down_deg: float = -30.0
    """Elevation of the lowest ray."""
    range_noise_m: float = 0.02
    """Standard deviation along the ray."""
    dropout: float = 0.05
    """Share of the returns that are lost."""
    max_range_m: float = 120.0
    """Largest range that returns."""
    lidar_tilt_deg: float = 0.0
    """How far the LiDAR's x axis dips below the horizon; the camera, mounted to it, dips as well."""

    width: int = 1280
    """Columns of the picture."""
    height: int = 720
    """Rows of the picture."""
    lens: Lens = "standard"
    """Kind of lens, which sets model, distortion and field of view."""
    hfov_deg: float | None = None
    """Angle between the left and the right edge of the picture; the lens's own if not given."""

    rig_seed: int | None = None
    """What the mounting leaves open is drawn from it: drives of one rig share it. The drive's own seed if None."""
    camera_azimuth_deg: float | None = None
    """Where the camera looks in the LiDAR's x-y plane: 0 along x, positive to the left."""
    camera_pitch_deg: float | None = None
    """How far the camera looks above the LiDAR's x-y plane."""
    camera_roll_deg: float | None = None
    """How far the camera leans to its right."""
    baseline_m: float | None = None
    """Distance between the two sensors' centres."""
    max_baseline_m: float = 1.0
    """The largest distance that is drawn."""

    label_noise: float = 0.0
    """Share of the labels, on both sides, that are replaced by those of another class."""
    ontology: Ontology = "shared"
    """Whether points and pictures are labelled with the same ids, or with ids that have nothing in common."""
