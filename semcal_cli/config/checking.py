"""Checks of settings that a program gives, by their limits; the command line checks its own options."""

from __future__ import annotations

from dataclasses import is_dataclass
from typing import Any, get_args, get_origin

from semcal_cli.config import CalibrationConfig, CueName, JointlyConfig
from semcal_cli.config.refinement import SIGMA
from semcal_cli.config.setting import NEEDED, is_of, settings_of, types_of
from semcal_cli.errors import InputError, check_torch, one_of


def check_config(config: CalibrationConfig) -> None:
    """Check the settings of a calibration.

    Raises:
        InputError: a setting is of another type or out of its range, or MINE is asked for without torch.
    """
    if not isinstance(config, CalibrationConfig):
        raise InputError(f"config: found {config!r}, needed a CalibrationConfig")
    names = {*map(str, config.cues)} if isinstance(config.cues, tuple) else set[str]()
    if not names or len(names) < len(config.cues):
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
        InputError: one is of another type, none of its words, or no number within its limits.
    """
    of_config: type = type(config)
    settings = settings_of(of_config)
    for name, (kind, is_optional) in types_of(of_config).items():
        plain, value = get_origin(kind) or kind, getattr(config, name)
        needed = NEEDED.get(plain) or plain.__name__
        if plain is tuple:
            needed += f" of {getattr(get_args(kind)[0], '__name__', 'words')}"
        if value is None and is_optional:
            continue
        if name in settings:
            about = settings[name]
            is_allowed = about.allows(value)
            needed = one_of(str(value), about.choices) if about.choices else about.needed()
        else:
            is_allowed = is_of(kind, value)
        if not is_allowed:
            found = type(value).__name__ if is_dataclass(value) else repr(value)
            raise InputError(f"{name}: found {found}, needed {needed}")
        if is_dataclass(value):
            check_settings(value)


def _check_sigmas(jointly: JointlyConfig) -> None:
    """Check that no intrinsics are estimated that are stated to be exact."""
    for name in ("focal_sigma", "center_sigma_px"):
        sigma = getattr(jointly, name)
        if jointly.intrinsics and sigma is not None and sigma < SIGMA["least"]:
            raise InputError(
                f"{name}: found {sigma!r}, needed a number from {SIGMA['least']:g} to {SIGMA['most']}"
            )
