"""Settings of a synthetic drive; they have a module of their own, so that `semcal --help` imports nothing heavy."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

Pattern: TypeAlias = Literal["spinning", "rosette"]
Lens: TypeAlias = Literal["standard", "narrow", "wide", "fisheye", "omnidirectional", "equirectangular"]
Ontology: TypeAlias = Literal["shared", "disjoint"]

MIN_BASELINE_M = 0.1
"""Smallest distance of a randomly mounted camera from the LiDAR; without parallax a drive tests too little."""
MAX_BASELINE_M = 1.5
"""Largest distance between camera and LiDAR; the synthetic street leaves this much room around the LiDAR."""


@dataclass(frozen=True)
class SynthConfig:
    """Settings that determine a synthetic drive to the last byte. Mounting angles that are None are drawn at random."""

    num_frames: int = 20
    """Number of frames."""
    seed: int = 0
    """Seed of every random choice."""

    pattern: Pattern = "spinning"
    """Scan pattern of the LiDAR."""
    channels: int = 64
    """Number of beams."""
    columns: int = 800
    """Number of firings a turn. A rosette has channels * columns rays a frame."""
    fov_up_deg: float = 10.0
    """Elevation of the highest beam."""
    fov_down_deg: float = -30.0
    """Elevation of the lowest beam, negative below the horizon."""
    range_noise_m: float = 0.02
    """Standard deviation of the ranges."""
    dropout: float = 0.05
    """Share of the returns that are lost."""
    max_range_m: float = 120.0
    """Largest range of a return."""
    lidar_tilt_deg: float = 0.0
    """Angle of the LiDAR's x axis below the horizon. The camera is mounted on the LiDAR and tilts with it."""

    width: int = 1280
    """Columns of the image."""
    height: int = 720
    """Rows of the image."""
    lens: Lens = "standard"
    """Lens of the camera."""
    hfov_deg: float | None = None
    """Angle between the left and the right edge of the image; that of the lens if None."""

    rig_seed: int | None = None
    """Seed of the random mounting, which drives of one rig share; the seed of the drive if None."""
    camera_azimuth_deg: float | None = None
    """Viewing direction of the camera in the LiDAR's x-y plane, 0 along x, positive to the left; random if None."""
    camera_pitch_deg: float | None = None
    """Angle of the camera's viewing direction above the LiDAR's x-y plane; random if None."""
    camera_roll_deg: float | None = None
    """Angle by which the camera leans to its right; random if None."""
    baseline_m: float | None = None
    """Distance between the centres of camera and LiDAR; random if None."""
    max_baseline_m: float = 1.0
    """Largest random distance between camera and LiDAR."""

    label_noise: float = 0.0
    """Share of the labels of points and of pixels that are replaced by those of another class."""
    ontology: Ontology = "shared"
    """Whether points and images are labelled with the same ids, or with ids that have nothing in common."""
