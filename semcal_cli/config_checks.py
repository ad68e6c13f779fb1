"""Checks of settings that a program gives; the command line checks its own options."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import get_args

from semcal_cli.config import MAX_SEED, CalibrationConfig, Cue, Device, Estimator, Limits, Zoom
from semcal_cli.errors import InputError
from semcal_cli.extras import check_torch
from semcal_cli.files.messages import one_of

LEAST_SIGMA, MOST_SIGMA = 1e-11, 1e3
"""Standard deviations of what is known before; squares of others overflow."""


def check_config(config: CalibrationConfig) -> None:
    """Check the settings of a calibration.

    Raises:
        InputError: a setting is out of its range, or MINE is asked for without torch.
    """
    refinement = config.refinement
    if not isinstance(config.cues, tuple) or not config.cues or len(set(config.cues)) < len(config.cues):
        raise InputError(f"cues: found {config.cues!r}, needed a tuple of different cues")
    if "auto" in config.cues and len(config.cues) > 1:
        raise InputError(f"cues: found {config.cues!r}, needed auto alone")
    for cue in config.cues:
        _check_choice("cues", cue, get_args(Cue))
    _check_choice("estimator", refinement.estimator, get_args(Estimator))
    if refinement.estimator == "mine":
        check_torch("estimator 'mine'")
    _check_choice("device", refinement.device, get_args(Device))
    _check_choice("zoom", config.initialization.zoom, get_args(Zoom))
    _check_range("seed", config.seed, 0, MAX_SEED)
    _check_range("max_frames", config.max_frames, 1)
    _check_range("num_seeds", config.num_seeds, 1)
    _check_range("max_baseline_m", refinement.max_baseline_m, 0.0)
    _check_range("edge_band_px", refinement.edge_band_px, 0)
    jointly = refinement.jointly
    for name in ("focal_sigma", "center_sigma_px", "lens_sigma", "tangential_sigma", "delay_sigma_s"):
        if (sigma := getattr(jointly, name)) is not None:
            may_be_exact = name in ("focal_sigma", "center_sigma_px") and not jointly.intrinsics
            _check_range(name, sigma, 0.0 if may_be_exact else LEAST_SIGMA, MOST_SIGMA)


def check_limits(limits: Limits) -> None:
    """Check how far a transform may be off.

    Raises:
        InputError: a limit is no number from 0 on.
    """
    _check_range("rotation_deg", limits.rotation_deg, 0.0)
    _check_range("translation_m", limits.translation_m, 0.0)
    if limits.delay_s is not None:
        _check_range("delay_s", limits.delay_s, 0.0)


def _check_choice(name: str, value: object, known: Collection[str]) -> None:
    if value not in known:
        raise InputError(f"{name}: found {value!r}, needed {one_of(str(value), known)}")


def _check_range(name: str, value: float, least: float, most: float = math.inf) -> None:
    if not (isinstance(value, int | float) and math.isfinite(value) and least <= value <= most):
        up_to = "on" if most == math.inf else f"to {most}"
        raise InputError(f"{name}: found {value!r}, needed a number from {least:g} {up_to}")
