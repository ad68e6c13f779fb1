"""Verification of a rig: the verdicts on its transforms, and whether one sensor that has moved explains them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from semcal_cli import core
from semcal_cli.errors import counted
from semcal_cli.estimation.uncertainty.quantiles import joint_quantile, overall_width
from semcal_cli.findings.symptoms import MOVED_SENSOR
from semcal_cli.geometry.arrays import Matrix, Pose, Vector
from semcal_cli.geometry.poses import inverse, rotation_vector_deg
from semcal_cli.geometry.twists import adjoint, local_coordinates, pose_at
from semcal_cli.many.rig.rig_document import LidarView
from semcal_cli.pipeline.verdict import Verdict, together
from semcal_cli.pipeline.verification import Verification
from semcal_cli.readable import figure

RigVerdict: TypeAlias = Verdict | Literal["failed"]
"""Verdict on a rig, or on a case; `failed` if an error leaves it without one."""
SensorKind: TypeAlias = Literal["camera", "lidar", "only_lidar"]
CHANCE = 0.05
"""Probability that displacements of one sensor differ as much by chance, below which they are not of one."""


class MovedSensor(NamedTuple):
    """A sensor whose displacement explains why exactly its own transforms fail."""

    name: str
    kind: SensorKind
    T_stated_found: Pose
    """(4, 4) p_stated = T_stated_found * p_found, between where the transforms place the sensor and where it is."""
    covariance: Matrix
    """(6, 6) of a twist on the left of this transform, metres and radians."""
    degrees_of_freedom: float
    """Smallest number of degrees of freedom of what it was combined of."""

    @property
    def sentence(self) -> str:
        """What has moved by how much, and what to do."""
        quantile = core.student_quantile(0.975, self.degrees_of_freedom)
        half_widths = quantile * np.sqrt(np.diag(self.covariance))
        turned_deg, widths_deg = rotation_vector_deg(self.T_stated_found), np.degrees(half_widths[3:])
        moved = _with_interval(100.0 * self.T_stated_found[:3, 3], 100.0 * half_widths[:3])
        by = f"{moved} cm and {_with_interval(turned_deg, widths_deg)} degrees"
        if self.kind == "camera":
            return f"{self.name} is off with each of its LiDARs as if it had moved by {by}: look at its mount"
        if self.kind == "lidar":
            return (
                f"the cameras of {self.name} are off as if this LiDAR had moved by {by}: look at its mount, and at the "
                "frame of its points"
            )
        return (
            f"all cameras are off as if the LiDAR had moved by {by}: look at its mount, at what carries all cameras, "
            "and at the frame of the points"
        )


@dataclass(frozen=True)
class RigVerification:
    """Verdicts on the transforms of a rig, one for each camera with each LiDAR, by the names of their results."""

    views: Mapping[str, LidarView]
    """Camera and LiDAR of each transform."""
    stated: Mapping[str, Pose]
    """(4, 4) each transform that was to be verified, metres."""
    verifications: Mapping[str, Verification]
    """Verdict on each that could be verified."""
    failures: Mapping[str, str]
    """Error of each that could not."""

    @property
    def verdict(self) -> RigVerdict:
        """Verdict on all transforms together; `failed` if one could not be verified."""
        if self.failures:
            return "failed"
        return together(verification.verdict for verification in self.verifications.values())

    @property
    def deciding(self) -> str:
        """Names of the transforms that decide the verdict, or the number of all."""
        names = [*self.failures] or [
            name for name, verification in self.verifications.items() if verification.verdict == self.verdict
        ]
        all_cameras = self._counted(len(self.views))
        return all_cameras if len(names) == len(self.views) else f"{', '.join(names)}, of {all_cameras}"

    @property
    def failure(self) -> str:
        """How many transforms could not be verified, and why the first one could not."""
        name, reason = next(iter(self.failures.items()))
        return f"{len(self.failures)} of {self._counted(len(self.views))} could not be verified; {name}: {reason}"

    def _counted(self, count: int) -> str:
        num_lidars = len({view.lidar for view in self.views.values()})
        return counted(count, "camera") if num_lidars == 1 else f"{count} transforms of {num_lidars} LiDARs"

    @property
    def reasons(self) -> tuple[str, ...]:
        """The sensor that has moved, then the reasons of each transform after its name."""
        return (
            *(moved.sentence for moved in self.moved_sensors),
            *(
                f"{name}: {reason}"
                for name, verification in self.verifications.items()
                for reason in verification.reasons
            ),
        )

    @property
    def topics(self) -> tuple[str, ...]:
        """Topic of each of the reasons: its entry in docs/troubleshooting.md."""
        transform_topics = (topic for found in self.verifications.values() for topic in found.topics)
        return (*(MOVED_SENSOR for _ in self.moved_sensors), *transform_topics)

    @cached_property
    def moved_sensors(self) -> tuple[MovedSensor, ...]:
        """The one sensor whose displacement explains all transforms that fail, if there is one.

        Several of its transforms, all of them, fail, all others pass, and the displacements that they show differ by no
        more than chance. With one LiDAR, its displacement and that of all cameras together look alike.
        """
        off = {name for name, verification in self.verifications.items() if verification.is_off}
        holding = {name for name, found in self.verifications.items() if found.of_transform == "pass"}
        if off | holding != self.views.keys():
            return ()
        lidars = {view.lidar for view in self.views.values()}
        sensors = [
            *((camera, True) for camera in dict.fromkeys(view.camera for view in self.views.values())),
            *((lidar, False) for lidar in sorted(lidars)),
        ]
        for sensor, is_camera in sensors:
            own = [name for name, view in self.views.items() if sensor == view[0 if is_camera else 1]]
            if len(own) < 2 or off != {*own}:
                continue
            if (displacement := self._displacement(own, of_camera=is_camera)) is not None:
                kind: SensorKind = "camera" if is_camera else "lidar" if len(lidars) > 1 else "only_lidar"
                return (MovedSensor(sensor, kind, *displacement),)
        return ()

    def _displacement(self, names: list[str], *, of_camera: bool) -> tuple[Pose, Matrix, float] | None:
        """Combine what transforms say of the displacement of their common sensor, weighted by their covariances.

        Returns:
            T_stated_found (4, 4) of the sensor, its covariance (6, 6) and degrees of freedom; None if they differ by
            more than chance.
        """
        shown, information, freedom = [], [], np.inf
        for name in names:
            T_stated, verification = self.stated[name], self.verifications[name]
            T_found, covariance = verification.T_camera_lidar, np.array(verification.covariance)
            T = T_stated @ inverse(T_found) if of_camera else inverse(T_stated) @ T_found
            # xi on the left of T_found is -Ad(T) xi on that of T_stated T_found^-1, and Ad(T_stated^-1) xi on that of
            # T_stated^-1 T_found.
            gain = adjoint(T if of_camera else inverse(T_stated))
            shown.append(T)
            information.append(np.linalg.inv(gain @ covariance @ gain.T))
            freedom = min(freedom, verification.degrees_of_freedom or np.inf)
        twists, covariance = local_coordinates(shown, shown[0]), np.linalg.inv(np.sum(information, axis=0))
        mean = covariance @ np.einsum("nij,nj->i", information, twists)
        chi_square = float(np.einsum("ni,nij,nj->", twists - mean, information, twists - mean))
        if chi_square > joint_quantile(CHANCE, freedom, len(names) - 1):
            return None
        return pose_at(shown[0], mean), covariance, freedom

    @property
    def document(self) -> dict[str, Any]:
        """The verification as JSON."""
        failed = {name: {"verdict": "failed", "reasons": [reason]} for name, reason in self.failures.items()}
        return {
            "verdict": self.verdict,
            "reasons": list(self.reasons),
            "topics": list(self.topics),
            "transforms": {name: found.document for name, found in self.verifications.items()} | failed,
            "moved_sensors": [
                {
                    "sensor": moved.name,
                    "kind": moved.kind,
                    "T_stated_found": moved.T_stated_found.tolist(),
                    "covariance": moved.covariance.tolist(),
                    "degrees_of_freedom": moved.degrees_of_freedom,
                }
                for moved in self.moved_sensors
            ],
        }


def _with_interval(offset: Vector, half_widths: Vector) -> str:
    """Write the length of an offset (3,), with as many digits as its interval has."""
    half_width = figure(overall_width(offset, half_widths))
    return f"{np.linalg.norm(offset):.{len(half_width.partition('.')[2])}f} +- {half_width}"
