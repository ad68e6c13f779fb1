"""The result file of a fleet: YAML or JSON with the same content."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt

from semcal_cli.fleet.fleet import ComparedDrive, Fleet, Offset, Part
from semcal_cli.geometry.poses import inverse, quaternion_xyzw
from semcal_cli.result.provenance import versions


def describe_fleet(fleet: Fleet, read: Mapping[str, str], reference: str | None = None) -> dict[str, Any]:
    """Make the document of a fleet.

    Args:
        fleet: Combined result of the drives.
        read: SHA-256 of each file that was read, by its name.
        reference: SHA-256 of the file of the transform that the rig should have.
    """
    T = fleet.T_camera_lidar
    return {
        "semcal_fleet": 1,
        "status": fleet.verdict,
        "reasons": list(fleet.reasons),
        "notes": list(fleet.notes),
        "T_camera_lidar": T.tolist(),
        "T_lidar_camera": inverse(T).tolist(),
        "translation_m": T[:3, 3].tolist(),
        "quaternion_xyzw": quaternion_xyzw(T).tolist(),
        "uncertainty": {"covariance": fleet.covariance.tolist(), **_widths(fleet.parts[-1].half_widths)},
        "scatter": {
            "camera_center_m": fleet.scatter[:3].tolist(),
            "rotation_deg": fleet.scatter[3:].tolist(),
        },
        "checks": [asdict(check) for check in fleet.checks],
        "parts": [_part(part) for part in fleet.parts],
        "drift": None if fleet.drift is None else _describe_offset(fleet.drift),
        "order": fleet.order,
        "drives": [
            *map(_drive, fleet.drives),
            *({"drive": m.drive, "status": "left_out", "reason": m.left_out} for m in fleet.left_out),
        ],
        "limits": {
            "rotation_deg": fleet.limits.rotation_deg,
            "translation_m": fleet.limits.translation_m,
        },
        "input": {"reference": reference, "sha256": dict(read)},
        "versions": {name: versions()[name] for name in ("semcal", "numpy")},
    }


def _part(part: Part) -> dict[str, Any]:
    return {
        "first": part.first,
        "last": part.last,
        "num_drives": part.num_drives,
        "T_camera_lidar": part.T_camera_lidar.tolist(),
        **_widths(part.half_widths),
        "change": None if part.change is None else _describe_offset(part.change),
        "change_from_first": None if part.change_in_all is None else _describe_offset(part.change_in_all),
    }


def _drive(compared: ComparedDrive) -> dict[str, Any]:
    return {
        "drive": compared.member.drive,
        "status": "disagrees" if compared.disagrees else "agrees",
        "verdict": compared.verdict,
        "stamp": compared.member.stamp,
        "time": compared.time,
        "part": compared.part,
        **_describe_offset(compared.offset),
    }


def _describe_offset(offset: Offset) -> dict[str, Any]:
    return {
        "camera_center_m": offset.center_m.tolist(),
        "rotation_deg": offset.rotation_deg.tolist(),
        **_widths(offset.half_widths),
    }


def _widths(half_widths: npt.NDArray[np.float64]) -> dict[str, Any]:
    return {
        "half_width_95_camera_center_m": half_widths[:3].tolist(),
        "half_width_95_rotation_deg": half_widths[3:].tolist(),
    }
