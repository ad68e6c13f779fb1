"""What the document of a rig says of its adjustment: the covariance of all sensors, compared ties, and loops."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import model_validator

from semcal_cli.config.file_limits import MAX_CAMERAS
from semcal_cli.errors import listed, mismatch
from semcal_cli.files.validation import Figure, StrictModel, length
from semcal_cli.geometry.arrays import Matrix
from semcal_cli.many.rig.rig_document import FIRST_LIDAR, MAX_CONSTRAINTS, MAX_LIDARS
from semcal_cli.many.rig.rig_estimate import NUM_AXES, Closure, Difference
from semcal_cli.many.rig.rig_uncertainty import (
    ROUND_OFF,
)
from semcal_cli.many.rig.ties import Tie, TieKind
from semcal_cli.readable import figure, lengths

MAX_SENSORS = 2 * MAX_CAMERAS + MAX_LIDARS
MAX_TIES = MAX_CONSTRAINTS + MAX_CAMERAS + MAX_LIDARS
"""Largest number of sensors, and of ties that are compared."""
MAX_ROWS = NUM_AXES * MAX_SENSORS
"""Largest number of rows of the covariance of all sensors."""
MAX_VARIANCE = 1e20
"""Largest variance, square metres or radians, whose matrix is looked at."""


class ComparedConstraint(Difference):
    """A tie beside what all others say: a constraint, or a measurement of a further LiDAR."""

    to: str
    """Sensor to whose frame the tie leads."""
    source: str
    """Sensor from whose frame it leads."""
    kind: TieKind = "constraint"
    """What the tie is: a constraint, the calibration of a camera with a further LiDAR, or the registration of sweeps.
    Absent for a constraint."""

    @classmethod
    def of(cls, tie: Tie, closure: Closure) -> ComparedConstraint:
        """Describe how a tie differs from all others."""
        difference = closure.model_dump(include={*Difference.model_fields})
        return cls(to=tie.to, source=tie.source, kind=tie.kind, **difference)

    @property
    def name(self) -> str:
        """Name of the tie in messages."""
        between = "with" if self.kind == "calibration" else "and"
        return f"the {self.kind} of {self.to} {between} {self.source}"

    @property
    def sentence(self) -> str:
        """Describe the difference."""
        return f"{self.name} is {self.size} from what the other measurements say"

    @property
    def reason(self) -> str:
        """Describe a difference that chance does not explain, and what to do."""
        advice = {
            "constraint": f"check its direction and figures, the calibrations that place {self.to} and {self.source}, "
            "and the other constraints",
            "calibration": f"check the drives of {self.to} with {self.source} and with the first LiDAR, and the others "
            "of its loops",
            "registration": f"check that the sweeps of {self.to} and {self.source} are of the same moments, and the "
            "calibrations of the cameras that see both",
        }
        return (
            f"{self.sentence}, more than chance explains (chi-square {self.chi_square:.3g}, limit {self.largest:.3g}), "
            f"and was left out: {advice[self.kind]}"
        )


class LoopClosure(Closure):
    """By how much the transforms around a loop of sensors fail to lead back to where it began."""

    sensors: Annotated[tuple[str, ...], length(2, MAX_SENSORS + 1)]
    """Sensors around the loop, each with a tie to the next, and the last with one to the first."""

    @property
    def expected(self) -> str:
        """Its expected size in words."""
        return f"{figure(self.expected_rotation_deg)} degrees and {lengths([self.expected_distance_m])}"

    @property
    def sentence(self) -> str:
        """Describe the closure beside its expected size."""
        beyond = "" if self.is_explained else ", more than chance explains"
        return f"{' - '.join(self.sensors)} closes within {self.size}, expected {self.expected}{beyond}"


class Adjustment(StrictModel):
    """What all sensors of a rig and the ties between them say together."""

    cameras: Annotated[tuple[str, ...], length(0, MAX_SENSORS)]
    """Sensors that took part: cameras and further LiDARs that are not untrusted and have an uncertainty."""
    covariance: Annotated[tuple[Annotated[tuple[Figure, ...], length(0, MAX_ROWS)], ...], length(0, MAX_ROWS)]
    """Covariance of their twists in this order, six each, in metres and radians, each in the frame of its sensor. The
    errors of calibrations are taken as independent, but for those of the intrinsics of one camera."""
    constraints: Annotated[tuple[ComparedConstraint, ...], length(0, MAX_TIES)]
    """All constraints between them, and the measurements of further LiDARs that others can be compared with."""
    skipped: Annotated[tuple[Annotated[tuple[str, ...], length(2, 2)], ...], length(0, MAX_CONSTRAINTS)] = ()
    """Sensors of each constraint that was not used, since one of the two took no part."""
    loops: Annotated[tuple[LoopClosure, ...], length(0, MAX_TIES)] = ()
    """Closure of each loop of ties, also of those that were left out. Absent for a rig of one LiDAR."""
    doubted: Annotated[tuple[str, ...], length(0, MAX_SENSORS)] = ()
    """Sensors whose place relies on a loop with a tie that the others contradict: any tie of the loop may be the wrong
    one. Absent for a rig of one LiDAR."""
    unconfirmed: Annotated[tuple[str, ...], length(0, MAX_SENSORS)] = ()
    """Sensors without a calibration with the first LiDAR that a single tie separates from it, so that no loop confirms
    their place. Absent for a rig of one LiDAR."""

    @model_validator(mode="after")
    def _check(self) -> Adjustment:
        if len({*self.cameras}) < len(self.cameras):
            raise mismatch(f"cameras {listed(self.cameras)}", "each sensor once")
        for constraint in self.constraints:
            if not {constraint.to, constraint.source} <= {FIRST_LIDAR, *self.cameras}:
                found = f"the tie of {constraint.to!r} and {constraint.source!r}"
                raise mismatch(found, f"those of {listed(self.cameras)}")
        count = NUM_AXES * len(self.cameras)
        if len(self.covariance) != count or any(len(row) != count for row in self.covariance):
            raise mismatch("a covariance of another size", f"{count} rows and columns, six for each sensor")
        covariance = np.array(self.covariance).reshape(count, count)
        tolerance = ROUND_OFF * np.abs(covariance).max(initial=0.0)
        is_symmetric = (np.abs(covariance - covariance.T) <= tolerance).all()
        is_bounded = tolerance <= ROUND_OFF * MAX_VARIANCE
        if not (is_symmetric and is_bounded and (np.diag(covariance) > 0.0).all()):
            raise mismatch("another matrix as covariance", "a symmetric one with a positive diagonal")
        if count and np.linalg.eigvalsh(covariance).min() < -tolerance:
            raise mismatch("a covariance with a negative eigenvalue", "a positive semidefinite matrix")
        return self

    def covariance_of(self, to: str, source: str) -> Matrix | None:
        """Return the covariance (12, 12) of the twists of two sensors; None if one did not take part."""
        if not {to, source} <= {*self.cameras}:
            return None
        places = np.concatenate(
            [NUM_AXES * self.cameras.index(name) + np.arange(NUM_AXES) for name in (to, source)]
        )
        return np.asarray(np.array(self.covariance)[np.ix_(places, places)])

    @property
    def contradictions(self) -> tuple[ComparedConstraint, ...]:
        """Ties that the others contradict."""
        return tuple(constraint for constraint in self.constraints if not constraint.is_explained)

    def contradictions_of(self, sensor: str) -> tuple[ComparedConstraint, ...]:
        """Return the contradicted ties of a sensor, or all of them if its place relies on one of their loops."""
        of_sensor = tuple(each for each in self.contradictions if sensor in (each.to, each.source))
        return of_sensor or (self.contradictions if sensor in self.doubted else ())

    def describe(self, *, with_loops: bool) -> dict[str, Any]:
        """Make the entry in the document of a rig, with its loops or without."""
        document = self.model_dump(exclude=set() if with_loops else {"loops", "doubted", "unconfirmed"})
        for constraint in document["constraints"]:
            if constraint["kind"] == "constraint":
                del constraint["kind"]
        return document
