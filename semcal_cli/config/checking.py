"""Checks of settings that a program gives, by their limits; the command line checks its own options."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any, get_args

from semcal_cli.config import CalibrationConfig, CueName, JointlyConfig
from semcal_cli.config.setting import settings_of
from semcal_cli.errors import InputError
from semcal_cli.extras import check_torch
from semcal_cli.messages import one_of

LEAST_SIGMA = 1e-11
"""Smallest standard deviation of intrinsics that are estimated: squares of smaller ones vanish."""


def check_config(config: CalibrationConfig) -> None:
    """Check the settings of a calibration.

    Raises:
        InputError: a setting is out of its range, or MINE is asked for without torch.
    """
    if not isinstance(config.cues, tuple) or not config.cues or len(set(config.cues)) < len(config.cues):
        raise InputError(f"cues: found {config.cues!r}, needed a tuple of different cues")
    if "auto" in config.cues and len(config.cues) > 1:
        raise InputError(f"cues: found {config.cues!r}, needed auto alone")
    for cue in config.cues:
        if cue not in get_args(CueName):
            raise InputError(f"cues: found {cue!r}, needed {one_of(str(cue), get_args(CueName))}")
    check_settings(config)
    if config.refinement.estimator == "mine":
        check_torch("estimator 'mine'")
    _check_sigmas(config.refinement.jointly)


def check_settings(config: Any) -> None:
    """Check the settings of a configuration, and of those within it.

    Raises:
        InputError: one is none of its words, or no number within its limits.
    """
    kind: type = type(config)
    for name, found in settings_of(kind).items():
        value = getattr(config, name)
        is_open = value is None and found.default is None
        if not is_open and not found.allows(value):
            needed = one_of(str(value), found.choices) if found.choices else found.needed()
            raise InputError(f"{name}: found {value!r}, needed {needed}")
    for each in fields(config):
        if is_dataclass(value := getattr(config, each.name)):
            check_settings(value)


def _check_sigmas(jointly: JointlyConfig) -> None:
    """Check that no intrinsics are estimated that are stated to be exact."""
    for name in ("focal_sigma", "center_sigma_px"):
        sigma = getattr(jointly, name)
        if jointly.intrinsics and sigma is not None and sigma < LEAST_SIGMA:
            raise InputError(f"{name}: found {sigma!r}, needed a number from {LEAST_SIGMA:g} to 1000.0")
