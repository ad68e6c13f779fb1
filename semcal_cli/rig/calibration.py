"""Calibration of a rig: the calibrations of its cameras and the transform between each pair of cameras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from semcal_cli.drive.document import Drive
from semcal_cli.geometry.poses import inverse, quaternion_xyzw
from semcal_cli.result.calibration import Calibration, Status
from semcal_cli.result.provenance import versions
from semcal_cli.result.uncertainty import Uncertainty
from semcal_cli.rig.document import Rig
from semcal_cli.rig.pairs import Pair, Reference, make_pair

WORST_FIRST: tuple[Status, ...] = ("not_trusted", "not_assessed", "trusted")


@dataclass(frozen=True)
class RigCalibration:
    """Calibrations of the cameras of a rig, and of its pairs of cameras."""

    cameras: Mapping[str, Calibration]
    """Calibration of each camera that has one."""
    failures: Mapping[str, str]
    """Error of each camera that has no calibration."""
    pairs: tuple[Pair, ...]
    """Transforms between two cameras each."""
    num_sweeps: int
    """Number of different clouds that were read."""

    @property
    def status(self) -> str:
        """The worst status of all cameras: `failed`, or that of a calibration."""
        if self.failures:
            return "failed"
        return min((each.status for each in self.cameras.values()), key=WORST_FIRST.index)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Findings and errors of all cameras, each after the camera's name."""
        return (
            *(f"{name}: {reason}" for name, reason in self.failures.items()),
            *(f"{name}: {reason}" for name, each in self.cameras.items() for reason in each.reasons),
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences that the user should read and that change no verdict."""
        notes = []
        for pair in self.pairs:
            if pair.reference is not None and pair.error is not None and pair.is_explained is False:
                off = f"{pair.error.camera_center_cm:.2f} cm and {pair.error.rotation_deg:.3f} deg"
                notes.append(
                    f"T_{pair.a}_{pair.b} is {off} from {pair.reference.source}, more than chance explains"
                )
        return tuple(notes)


def combine(
    rig: Rig,
    drives: Mapping[str, Drive],
    cameras: Mapping[str, Calibration],
    failures: Mapping[str, str],
    num_sweeps: int,
) -> RigCalibration:
    """Combine the calibrations of a rig's cameras, and compare each pair with the references of the rig or the drives.

    Args:
        rig: The rig.
        drives: Drive of each camera.
        cameras: Calibration of each camera that has one.
        failures: Error of each camera that has no calibration.
        num_sweeps: Number of different clouds that were read.
    """
    pairs = tuple(
        make_pair(a, cameras[a], b, cameras[b], _reference(rig, drives, a, b))
        for a, b in combinations(cameras, 2)
    )
    return RigCalibration(cameras, failures, pairs, num_sweeps)


def _reference(rig: Rig, drives: Mapping[str, Drive], a: str, b: str) -> Reference | None:
    if (stated := rig.reference(a, b)) is not None:
        return Reference(stated, rig.path.name)
    T_a, T_b = drives[a].T_camera_lidar, drives[b].T_camera_lidar
    if T_a is None or T_b is None:
        return None
    return Reference(np.array(T_a) @ inverse(np.array(T_b)), "T_camera_lidar of both drives")


def describe_rig(
    found: RigCalibration, files: Mapping[str, str], source: str, hashes: Mapping[str, str]
) -> dict[str, Any]:
    """Make the document of a rig's calibration.

    Args:
        found: Calibrations of the rig.
        files: File of each camera's calibration, relative to this document.
        source: The rig.yaml, relative to this document.
        hashes: SHA-256 of the rig.yaml and of the drive.yaml of each camera.
    """
    cameras: dict[str, Any] = {
        name: {"status": "failed", "reasons": [reason]} for name, reason in found.failures.items()
    }
    for name, calibration in found.cameras.items():
        cameras[name] = {
            "status": calibration.status,
            "reasons": list(calibration.reasons),
            "calibration": files[name],
            "T_camera_lidar": calibration.T_camera_lidar,
        }
    return {
        "semcal_rig_calibration": 1,
        "status": found.status,
        "reasons": list(found.reasons),
        "notes": list(found.notes),
        "cameras": cameras,
        "pairs": [_describe_pair(pair) for pair in found.pairs],
        "num_sweeps": found.num_sweeps,
        "input": {"rig": source, "sha256": dict(hashes)},
        "versions": versions(),
    }


def _describe_pair(pair: Pair) -> dict[str, Any]:
    return {
        "a": pair.a,
        "b": pair.b,
        "T_a_b": pair.T_a_b.tolist(),
        "translation_m": pair.T_a_b[:3, 3].tolist(),
        "quaternion_xyzw": quaternion_xyzw(pair.T_a_b).tolist(),
        "uncertainty": None if pair.uncertainty is None else _describe_uncertainty(pair.uncertainty),
        "reference": _describe_reference(pair),
    }


def _describe_uncertainty(found: Uncertainty) -> dict[str, Any]:
    """Describe an uncertainty as a calibration does; the camera's position is that of camera a in the frame of b."""
    return found.model_dump(exclude={"weak_directions", "label_bleed", "intrinsics_cost"})


def _describe_reference(pair: Pair) -> dict[str, Any] | None:
    if pair.reference is None or pair.error is None:
        return None
    return {
        "source": pair.reference.source,
        "T_a_b": pair.reference.T_a_b.tolist(),
        **{name: list(v) if isinstance(v, tuple) else v for name, v in vars(pair.error).items()},
        "is_explained": pair.is_explained,
    }
