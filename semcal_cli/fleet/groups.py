"""Drives by the poses that they agree on, for drives that may be of different rigs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from semcal_cli.config import Limits
from semcal_cli.fleet.fleet_drives import FleetDrive
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.pipeline.verdict import judge
from semcal_cli.result.uncertainty import normal_half_widths


def groups_that_agree(drives: Sequence[FleetDrive], limits: Limits) -> list[list[FleetDrive]]:
    """Group drives of one camera whose poses agree, the largest group first.

    A drive joins the first group whose most certain drive it agrees with. The time grows with the number of drives
    times that of groups.

    Args:
        drives: Drives that can be used, each with its pose and covariance.
        limits: Differences that are allowed: an offset that is beyond them with a certainty of 95 % is clear.
    """
    groups: list[list[FleetDrive]] = []
    for drive in sorted(drives, key=_spread):
        group = next((group for group in groups if _agree(group[0], drive, limits)), None)
        if group is None:
            groups.append([drive])
        else:
            group.append(drive)
    return sorted(groups, key=len, reverse=True)


def _spread(drive: FleetDrive) -> float:
    """Return how uncertain the pose of a drive is, to compare drives by."""
    assert drive.covariance is not None
    return float(np.trace(drive.covariance))


def _agree(a: FleetDrive, b: FleetDrive, limits: Limits) -> bool:
    """Whether two drives have the same camera, and poses that are not clearly different."""
    assert a.T_camera_lidar is not None
    assert b.T_camera_lidar is not None
    assert a.covariance is not None
    assert b.covariance is not None
    if a.camera != b.camera:
        return False
    error = compare_poses(a.T_camera_lidar, b.T_camera_lidar)
    half_widths = normal_half_widths(a.covariance + b.covariance).tolist()
    checks = judge(error.camera_center_xyz_m, error.rotation_xyz_deg, half_widths, limits)
    return all(check.verdict != "fail" for check in checks)
