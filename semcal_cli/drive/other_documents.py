"""Documents of semcal's that stand where a drive belongs: a rig, or a calibration of arguments the wrong way round."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from semcal_cli.errors import InputError, MisplacedError

RIG = "semcal_rig"
"""Version key of a rig of several cameras; see `semcal_cli.rig`."""
CALIBRATIONS = {"semcal_calibration", "semcal_transform", "semcal_fleet", "semcal_rig_calibration"}
"""Version keys of files with a transform."""
OF_RIG = (
    "found a rig, which only `semcal calibrate`, `inspect`, `report` and `overlay` take, needed the drive of one of "
    "its cameras"
)


def check_is_drive(document: Mapping[str, Any], path: Path) -> None:
    """Check that a document is no other one of semcal's; whether it is a drive is checked by its validation.

    Raises:
        MisplacedError: it holds a transform.
        InputError: it is a rig.
    """
    if RIG in document:
        raise InputError(f"{path}: {OF_RIG}")
    if CALIBRATIONS & document.keys():
        raise MisplacedError(f"{path}: found a calibration where the drive belongs")
