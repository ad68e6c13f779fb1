"""semcal's own files: p_camera = T_camera_lidar * p_lidar, as stored."""

from pathlib import Path
from typing import Any

import numpy as np

from semcal_cli.calibration import Calibration
from semcal_cli.drive import Drive
from semcal_cli.errors import InputError
from semcal_cli.poses import Pose
from semcal_cli.validation import validate

KNOWN_AS = "a semcal calibration (semcal_calibration); a drive (semcal_drive)"


def recognises(document: dict[Any, Any]) -> bool:
    """Whether the document is a calibration or a drive."""
    return "semcal_calibration" in document or "semcal_drive" in document


def read(document: dict[Any, Any], path: Path) -> Pose:
    """Read the transform of a calibration, or the reference of a drive.

    Raises:
        InputError: the file is wrong, or the drive has no reference.
    """
    if "semcal_calibration" in document:
        return validate(Calibration, document, path).pose
    drive = validate(Drive, document, path)
    if drive.T_camera_lidar is None:
        raise InputError(f"{path}: T_camera_lidar: found nothing, needed the drive's reference transform")
    return np.array(drive.T_camera_lidar)
