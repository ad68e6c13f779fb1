"""What Jiang, Osteen and Saripalli print in their tables (arXiv 2104.12023), for comparison with our own table.

Only their references are here. The poses of their other rows (SOIC, PMI, their own method) are not: no copy of the
tables was at hand, and no value is guessed. Every row that is added here is printed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import apply_motion, rotation_matrix

PAPER = "arXiv 2104.12023"
REFERENCE = "reference, published"
SAME_REFERENCE_DEG = 1.0
"""Largest rotation between a data set's published reference and a drive's own. KITTI-360's rectification is 0.45."""
SAME_REFERENCE_CM = 10.0
"""Largest distance between their camera centres."""


@dataclass(frozen=True)
class PublishedRow:
    """A pose as printed, with two decimals."""

    method: str
    """Name of the row."""
    rotation_vector_deg: tuple[float, float, float]
    """Rotation vector of T_camera_lidar, in the paper's columns "roll, pitch, yaw"."""
    translation_m: tuple[float, float, float]
    """Translation of T_camera_lidar."""
    source: str
    """Where the values come from, and what they apply to."""

    @property
    def T_camera_lidar(self) -> Pose:
        """The pose (4, 4)."""
        rotation = rotation_matrix(np.radians(self.rotation_vector_deg))
        return apply_motion(np.eye(4), rotation, np.array(self.translation_m))


PUBLISHED: dict[str, tuple[PublishedRow, ...]] = {
    "RELLIS-3D": (
        PublishedRow(
            REFERENCE,
            (70.80, 67.78, -68.06),
            (-0.04, -0.17, -0.13),
            f"that of RELLIS-3D as printed in {PAPER}, with two decimals",
        ),
    ),
    "KITTI-360": (
        PublishedRow(
            REFERENCE,
            (73.72, -71.37, 64.56),
            (0.26, -0.11, -0.83),
            f"that of KITTI-360 for raw images, with two decimals: rotation as printed in {PAPER}, translation from "
            "calib_cam_to_velo.txt; for rectified images, R_rect_00 turns it",
        ),
    ),
}
"""Rows by data set; the first one is the reference."""


def published_rows(T_reference: Pose) -> tuple[PublishedRow, ...]:
    """Find the rows of a drive's data set by its reference (4, 4); empty for other drives."""
    for rows in PUBLISHED.values():
        error = compare_poses(T_reference, rows[0].T_camera_lidar)
        if error.rotation_deg <= SAME_REFERENCE_DEG and error.camera_center_cm <= SAME_REFERENCE_CM:
            return rows
    return ()
