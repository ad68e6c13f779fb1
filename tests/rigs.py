"""Copies of rigs, and poses of their cameras, for tests."""

import shutil
from pathlib import Path

import numpy as np
import yaml
from click.testing import Result
from commands import invoke

from semcal_cli.geometry.arrays import Pose
from semcal_cli.result.calibration_document import CalibrationDocument


def exp(xi: np.ndarray) -> np.ndarray:
    """Twists (..., 6), rho and phi, as transforms: the power series of their generators."""
    generator = np.zeros((*xi.shape[:-1], 4, 4))
    generator[..., [2, 0, 1], [1, 2, 0]] = xi[..., 3:]
    generator[..., [1, 2, 0], [2, 0, 1]] = -xi[..., 3:]
    generator[..., :3, 3] = xi[..., :3]
    T = term = np.eye(4)
    for order in range(1, 30):
        term = term @ generator / order
        T = T + term
    return T


def twist(T: np.ndarray) -> np.ndarray:
    """Small transforms as twists, to first order."""
    return np.stack([*np.moveaxis(T[..., :3, 3], -1, 0), T[..., 2, 1], T[..., 0, 2], T[..., 1, 0]], axis=-1)


def run(*arguments: object) -> Result:
    return invoke("calibrate", *arguments)


def with_pose(calibration: CalibrationDocument, T: Pose, covariance: np.ndarray) -> CalibrationDocument:
    """The same for another pose, as sure as that."""
    assert calibration.uncertainty is not None
    of_xi = calibration.uncertainty.model_copy(update={"covariance": covariance.tolist()})
    return calibration.model_copy(update={"rows_camera_lidar": T.tolist(), "uncertainty": of_xi})


def copy_rig(rig: Path, out: Path, names: dict[str, str]) -> Path:
    """Write a rig whose cameras, by name, are copies of cameras of another rig."""
    for name, source in names.items():
        shutil.copytree(rig.parent / source, out / name)
    (out / "rig.yaml").write_text(
        yaml.safe_dump({"semcal_rig": 1, "cameras": {name: name for name in names}})
    )
    return out / "rig.yaml"
