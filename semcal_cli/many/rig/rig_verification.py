"""Verification of a rig: the verdicts on its cameras, and whether one displacement of a LiDAR explains them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from semcal_cli.config import Limits
from semcal_cli.errors import counted
from semcal_cli.findings.symptoms import LOOKS_LIKE
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import PoseError, compare_poses, inverse
from semcal_cli.many.rig.rig_document import FIRST_LIDAR
from semcal_cli.pipeline.verdict import Verdict, together
from semcal_cli.pipeline.verification import Verification
from semcal_cli.readable import figure

MIN_CAMERAS = 2
"""Smallest number of cameras that tell a displaced LiDAR from a displaced camera."""


class LidarDisplacement(NamedTuple):
    """A displacement of a LiDAR that explains what is wrong with the transforms of all its cameras."""

    lidar: str
    """Name of the LiDAR; empty if the rig has only one."""
    T_stated_found: Pose
    """(4, 4) pose of the LiDAR in the frame that the transforms state for it, metres."""

    @property
    def sentence(self) -> str:
        """What the displacement is, and what to do."""
        away = compare_poses(self.T_stated_found, np.eye(4))
        by = f"{figure(100.0 * away.camera_center_m)} cm and {figure(away.rotation_deg)} degrees"
        lidar = f"the LiDAR {self.lidar}".rstrip()
        return f"one displacement of {lidar}, by {by}, explains all its cameras: look at its mount first"


@dataclass(frozen=True)
class RigVerification:
    """Verdicts on the transforms of a rig's cameras."""

    stated: Mapping[str, Pose]
    """(4, 4) transform of each camera with each LiDAR that was to be verified, by the names of the results."""
    cameras: Mapping[str, Verification]
    """Verdict on each that could be verified."""
    failures: Mapping[str, str]
    """Error of each that could not."""
    lidars: Mapping[str, str]
    """LiDAR of each, by the names of the results."""
    limits: Limits

    @property
    def verdict(self) -> Verdict:
        """Verdict on all cameras together; one that could not be verified fails."""
        verdicts = [verification.verdict for verification in self.cameras.values()]
        return together([*verdicts, "fail" if self.failures else "pass"])

    @property
    def failure(self) -> str:
        """How many cameras could not be verified, and why the first one could not."""
        name, reason = next(iter(self.failures.items()))
        return f"{counted(len(self.failures), 'camera')} could not be verified; {name}: {reason}"

    @property
    def reasons(self) -> tuple[str, ...]:
        """Displacements of LiDARs, then the reasons of all cameras, each after the name of its camera."""
        of_cameras = self.cameras.items()
        return (
            *(displacement.sentence for displacement in self.displacements),
            *(f"{name}: {reason}" for name, camera in of_cameras for reason in camera.reasons),
        )

    @property
    def topics(self) -> tuple[str, ...]:
        """Topic of each of the reasons: its entry in docs/troubleshooting.md."""
        of_cameras = (topic for camera in self.cameras.values() for topic in camera.topics)
        return (*(LOOKS_LIKE for _ in self.displacements), *of_cameras)

    @property
    def deciding(self) -> list[str]:
        """Names of the cameras that decide the verdict, first those that could not be verified."""
        of_cameras = self.cameras.items()
        return [*self.failures, *(name for name, camera in of_cameras if camera.verdict == self.verdict)]

    @property
    def displacements(self) -> list[LidarDisplacement]:
        """Displacements of LiDARs that explain why all of their cameras fail, at most one a LiDAR."""
        displacements, lidars = [], dict.fromkeys(self.lidars.values())
        for lidar in lidars:
            cameras = [name for name in self.lidars if self.lidars[name] == lidar]
            are_off = all(name in self.cameras and self.cameras[name].verdict == "fail" for name in cameras)
            if not are_off or len(cameras) < MIN_CAMERAS:
                continue
            # Each camera proposes the displacement that explains it; the best one leaves the least to the others.
            proposed = [inverse(self.stated[name]) @ self.cameras[name].T_camera_lidar for name in cameras]
            left, index = min((self._left_by(T, cameras), index) for index, T in enumerate(proposed))
            if left <= 1.0:
                displacements.append(LidarDisplacement(lidar if len(lidars) > 1 else "", proposed[index]))
        return displacements

    def _left_by(self, T_stated_found: Pose, cameras: list[str]) -> float:
        """Return what a displacement of the LiDAR (4, 4) leaves of the cameras' offsets, as a part of the limits."""

        def part(error: PoseError) -> float:
            limits = self.limits
            return max(error.rotation_deg / limits.rotation_deg, error.camera_center_m / limits.translation_m)

        return max(
            part(compare_poses(self.stated[name] @ T_stated_found, self.cameras[name].T_camera_lidar))
            for name in cameras
        )

    @property
    def document(self) -> dict[str, Any]:
        """The verification as JSON."""
        failed = {name: {"verdict": "failed", "reasons": [reason]} for name, reason in self.failures.items()}
        return {
            "verdict": self.verdict,
            "cameras": {name: camera.document for name, camera in self.cameras.items()} | failed,
            "displaced_lidars": [
                {"lidar": lidar or FIRST_LIDAR, "T_stated_found": T.tolist()}
                for lidar, T in self.displacements
            ],
        }
