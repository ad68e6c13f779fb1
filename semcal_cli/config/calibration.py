"""Settings of a whole calibration, and the limits that a verified transform keeps."""

from __future__ import annotations

from dataclasses import dataclass, field

from semcal_cli.config.constants import AUTO, MAX_FRAMES, CueName
from semcal_cli.config.initialization import InitializationConfig
from semcal_cli.config.refinement import RefinementConfig
from semcal_cli.config.setting import MAX_SEED, setting


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
