"""Settings of synthetic drives. Nothing heavy is imported here, so that `semcal synth --help` shows them at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar, Literal, TypeAlias

from semcal_cli.config.directions import ReadoutDirection
from semcal_cli.config.setting import MAX_SEED, setting

Pattern: TypeAlias = Literal["spinning", "rosette"]
SynthLens: TypeAlias = Literal["standard", "narrow", "wide", "fisheye", "omnidirectional", "equirectangular"]
SynthOntology: TypeAlias = Literal["shared", "disjoint"]
RigMotion: TypeAlias = Literal["none", "steady", "mixed"]

SYNTH_MIN_BASELINE_M = 0.1
"""Minimum distance of a randomly mounted camera from the LiDAR; without parallax a drive tests too little."""
SYNTH_MAX_BASELINE_M = 1.5
"""Maximum distance between camera and LiDAR; the synthetic street leaves this much room around the LiDAR."""
SYNTH_MAX_DELAY_MS = 200.0
"""Maximum time offset, earlier or later."""
SYNTH_MAX_READOUT_MS = 100.0
"""Longest readout of a rolling shutter; with the largest time offset, it ends 0.3 s after the middle of the sweep."""


drive, lidar, camera, mounting, labels, moving = (
    partial(setting, section=title) for title in ("Drive", "LiDAR", "Camera", "Mounting", "Labels", "Motion")
)
"""Make a setting in a section of the help."""
ELEVATION = {"minimum": -90.0, "maximum": 90.0}
ANGLE = {"minimum": -180.0, "maximum": 180.0}
SHARE = {"minimum": 0.0, "below": 1.0}


@dataclass(frozen=True)
class SynthConfig:
    """Settings that determine a synthetic drive to the last byte. Mounting angles that are None are drawn at random."""

    num_frames: int = drive(
        20, "Number of frames, each in another street.", minimum=1, maximum=999_999, option="--frames"
    )
    seed: int = 0
    """Seed of every random choice."""
    pattern: Pattern = lidar(
        "spinning",
        "Scan pattern: the grid of a spinning LiDAR, or an all-round rosette, which is not a grid.",
    )
    channels: int = lidar(64, "Number of beams, evenly spaced in elevation.", minimum=1, maximum=512)
    columns: int = lidar(
        800, "Firings per turn. A rosette has channels x columns rays per frame.", minimum=1, maximum=65_536
    )
    fov_up_deg: float = lidar(10.0, "Elevation of the highest ray.", **ELEVATION)
    fov_down_deg: float = lidar(-30.0, "Elevation of the lowest ray.", **ELEVATION)
    range_noise_m: float = lidar(0.02, "Standard deviation of a range.", minimum=0.0)
    dropout: float = lidar(0.05, "Fraction of the returns that are lost.", **SHARE)
    max_range_m: float = lidar(120.0, "Maximum range of a return.", minimum=0.0)
    lidar_tilt_deg: float = lidar(
        0.0, "Downward tilt of the LiDAR's x axis, and of the camera with it.", **ELEVATION
    )
    width: int = camera(1280, "Columns of the image.", minimum=16, maximum=8192)
    height: int = camera(720, "Rows of the image.", minimum=16, maximum=8192)
    lens: SynthLens = camera(
        "standard",
        "standard: 90 degrees without distortion; narrow: 35 degrees, plumb_bob; wide: 100 degrees, "
        "rational_polynomial; fisheye: 200 degrees; omnidirectional: 190 degrees, xi 1.2; equirectangular: 360.",
    )
    hfov_deg: float | None = camera(
        None, "Horizontal field of view; by default that of the lens.", minimum=5.0, maximum=360.0
    )
    camera_azimuth_deg: float | None = mounting(
        None,
        "Azimuth of the camera: 0 along the LiDAR's x axis, positive to the left; by default random.",
        **ANGLE,
    )
    camera_pitch_deg: float | None = mounting(
        None, "Upward pitch of the camera; by default random, within 8 degrees of level.", **ELEVATION
    )
    camera_roll_deg: float | None = mounting(
        None, "Roll of the camera to its right; by default random, within 4 degrees of upright.", **ANGLE
    )
    baseline_m: float | None = mounting(
        None,
        "Distance between the two sensors; by default random, at least 0.1.",
        minimum=0.0,
        below=SYNTH_MAX_BASELINE_M,
    )
    rig_seed: int | None = mounting(
        None,
        "Seed of whatever these options leave open in the mounting. Drives with the same value share a rig.",
        minimum=0,
        maximum=MAX_SEED,
    )
    max_baseline_m: float = mounting(
        1.0, "Maximum random distance between the two sensors.", minimum=0.2, maximum=SYNTH_MAX_BASELINE_M
    )
    label_noise: float = labels(0.0, "Fraction of wrong labels, on both sides.", **SHARE)
    ontology: SynthOntology = labels(
        "shared", "Label points and images with the same named ids, or with ids that have nothing in common."
    )
    motion: RigMotion = moving(
        "none",
        "steady: straight on at 12 m/s in every frame; mixed: each frame has its own speed up to 20 m/s and its own "
        "turn rate up to 0.4 rad/s. Each point and each image line is measured from where the rig is at its time.",
    )
    delay_ms: float = moving(
        0.0,
        "Time offset: take the images this much later than image_stamp says; negative: earlier. drive.yaml does not "
        "state it.",
        minimum=-SYNTH_MAX_DELAY_MS,
        maximum=SYNTH_MAX_DELAY_MS,
    )
    readout_ms: float = moving(
        0.0,
        "Time that a rolling shutter takes from the first line of an image to the last; 0: a global shutter.",
        minimum=0.0,
        maximum=SYNTH_MAX_READOUT_MS,
    )
    readout_direction: ReadoutDirection = moving(
        "down", "Direction in which a rolling shutter reads the lines; down begins with the top row."
    )
    sweep_s: ClassVar[float] = 0.1
    """Duration of a sweep, seconds."""
