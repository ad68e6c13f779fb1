"""One estimate of all sensors of a rig, from all that is measured and stated of the transforms between them.

Each calibration measures T_camera_lidar with the covariance of a twist on its left, a registration of sweeps measures
T_lidar_lidar, and a constraint states T_a_b: all are ties (`ties`), of which a Kalman filter makes one estimate
(`rig_estimate`). Each tie but a calibration with the first LiDAR is compared with what all others say: its squared
innovation, in units of its covariance, is chi-square's if all are right. The one that is farthest beyond chance is left
out, and the others are compared again.

A tie between two sensors that others reach already closes a loop: the transforms around it should lead back to where
it began. By how much they fail, beside the standard error of that, is the loop's closure.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import model_validator

from semcal_cli import core
from semcal_cli.config.file_limits import MAX_CAMERAS
from semcal_cli.errors import listed, mismatch
from semcal_cli.files.validation import Figure, StrictModel, Width, length
from semcal_cli.geometry.arrays import Matrix
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.many.rig.rig_document import FIRST_LIDAR, MAX_CONSTRAINTS, MAX_LIDARS, Constraint
from semcal_cli.many.rig.rig_estimate import NUM_AXES, Closure, RigEstimate
from semcal_cli.many.rig.rig_uncertainty import (
    ROUND_OFF,
    AdjustedSensor,
    adjusted_sensor,
    joint_covariance,
    rows,
)
from semcal_cli.many.rig.ties import Tie, TieKind, in_reach, loop_of, relying_on, unconfirmed
from semcal_cli.observations.observations import Observations
from semcal_cli.readable import figure, lengths
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.sections import Quality, Stage

STAGE = "adjusted"
"""Name of the stage in the calibration of a camera."""
POSE_FORMS = {
    "semcal_calibration",
    "rows_camera_lidar",
    "rows_lidar_camera",
    "translation_m",
    "quaternion_xyzw",
}
"""Fields that `CalibrationDocument.from_pose` derives from a pose."""
MAX_SENSORS = 2 * MAX_CAMERAS + MAX_LIDARS
MAX_TIES = MAX_CONSTRAINTS + MAX_CAMERAS + MAX_LIDARS
"""Largest number of sensors, and of ties that are compared."""
MAX_ROWS = NUM_AXES * MAX_SENSORS
"""Largest number of rows of the covariance of all sensors."""
MAX_VARIANCE = 1e20
"""Largest variance, square metres or radians, whose matrix is looked at."""


class ComparedConstraint(StrictModel):
    """A tie beside what all others say: a constraint, or a measurement of a further LiDAR."""

    to: str
    """Sensor to whose frame the tie leads."""
    source: str
    """Sensor from whose frame it leads."""
    rotation_deg: Width
    """Angle between the two, in degrees."""
    distance_m: Width
    """Distance between the positions of the first sensor in the frame of the second, in metres."""
    chi_square: Width
    """Squared difference of all six axes in units of its covariance."""
    largest: Width
    """Largest value that chance explains."""
    kind: TieKind = "constraint"
    """What the tie is: a constraint, the calibration of a camera with a further LiDAR, or the registration of sweeps.
    Absent for a constraint."""

    @classmethod
    def of(cls, tie: Tie, closure: Closure) -> ComparedConstraint:
        """Describe how a tie differs from all others."""
        return cls(
            to=tie.to,
            source=tie.source,
            rotation_deg=closure.rotation_deg,
            distance_m=closure.distance_m,
            chi_square=closure.chi_square,
            largest=closure.largest,
            kind=tie.kind,
        )

    @property
    def is_kept(self) -> bool:
        """Whether the tie took part."""
        return self.chi_square <= self.largest

    @property
    def name(self) -> str:
        """Name of the tie in messages."""
        between = "with" if self.kind == "calibration" else "and"
        return f"the {self.kind} of {self.to} {between} {self.source}"

    @property
    def sentence(self) -> str:
        """Describe the difference."""
        difference = f"{figure(self.rotation_deg)} degrees and {lengths([self.distance_m])}"
        return f"{self.name} is {difference} from what the other measurements say"

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


class LoopClosure(StrictModel):
    """By how much the transforms around a loop of sensors fail to lead back to where it began."""

    sensors: Annotated[tuple[str, ...], length(2, MAX_SENSORS + 1)]
    """Sensors around the loop, each with a tie to the next, and the last with one to the first."""
    rotation_deg: Width
    """Rotation that is left, in degrees."""
    distance_m: Width
    """Distance that is left, in metres."""
    expected_rotation_deg: Width
    """Standard error of the rotation, over three axes, in degrees."""
    expected_distance_m: Width
    """Standard error of the position, over three axes, in metres."""
    chi_square: Width
    """Squared closure of all six axes in units of its covariance."""
    largest: Width
    """Largest value that chance explains."""

    @property
    def is_explained(self) -> bool:
        """Whether chance explains the closure."""
        return self.chi_square <= self.largest

    @property
    def closure(self) -> str:
        """The closure in words."""
        return f"{figure(self.rotation_deg)} degrees and {lengths([self.distance_m])}"

    @property
    def expected(self) -> str:
        """Its expected size in words."""
        return f"{figure(self.expected_rotation_deg)} degrees and {lengths([self.expected_distance_m])}"

    @property
    def sentence(self) -> str:
        """Describe the closure beside its expected size."""
        beyond = "" if self.is_explained else ", more than chance explains"
        return f"{' - '.join(self.sensors)} closes within {self.closure}, expected {self.expected}{beyond}"


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
            raise mismatch(f"cameras {listed(self.cameras)}", "each camera once")
        for constraint in self.constraints:
            if not {constraint.to, constraint.source} <= {FIRST_LIDAR, *self.cameras}:
                found = f"a constraint of {constraint.to!r} and {constraint.source!r}"
                raise mismatch(found, f"those of {listed(self.cameras)}")
        count = NUM_AXES * len(self.cameras)
        if len(self.covariance) != count or any(len(row) != count for row in self.covariance):
            raise mismatch("a covariance of another size", f"{count} rows and columns, six for each camera")
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
        rows = [NUM_AXES * self.cameras.index(name) + np.arange(NUM_AXES) for name in (to, source)]
        places = np.concatenate(rows)
        return np.asarray(np.array(self.covariance)[np.ix_(places, places)])

    @property
    def contradictions(self) -> tuple[ComparedConstraint, ...]:
        """Ties that the others contradict."""
        return tuple(constraint for constraint in self.constraints if not constraint.is_kept)

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


def adjust(
    cameras: Mapping[str, CalibrationDocument],
    constraints: Sequence[Constraint],
    measured: Sequence[Tie] = (),
    lidars: Iterable[str] = (),
) -> tuple[Adjustment, dict[str, AdjustedSensor]]:
    """Adjust the poses of a rig's sensors to all ties between them.

    Cameras that are not trusted, or whose data determine no pose, take no part.

    Args:
        cameras: Calibration with the first LiDAR of each camera that has one.
        constraints: Known transforms between sensors.
        measured: What is measured of further LiDARs.
        lidars: The further LiDARs, which constraints alone may place, too.

    Returns:
        What the sensors say together, and the pose and uncertainty of each that took part.
    """
    alone = [Tie.of_calibration(name, FIRST_LIDAR, calibration) for name, calibration in cameras.items()]
    direct = [tie for tie in alone if tie is not None]
    sensors = {FIRST_LIDAR, *lidars, *(end for tie in (*direct, *measured) for end in tie.ends)}
    stated = {Tie.of_constraint(each): each for each in constraints if each.sensors <= sensors}
    reached = [tie for tie, _ in in_reach([*direct, *measured, *stated])]
    others = [tie for tie in (*measured, *stated) if tie in reached]
    used = [stated[tie] for tie in others if tie in stated]
    shared = sharing_intrinsics([*direct, *others])
    kept, closures = _without_contradictions(direct, others, shared)
    estimate = RigEstimate.fit([*direct, *kept], shared)
    doubted = relying_on([tie for tie in others if tie not in kept], [*direct, *others])
    single = unconfirmed([*direct, *kept])
    together = Adjustment(
        cameras=tuple(estimate.poses),
        covariance=rows(joint_covariance(estimate)),
        constraints=tuple(ComparedConstraint.of(tie, closures[tie]) for tie in others if tie in closures),
        skipped=tuple((each.to, each.source) for each in constraints if each not in used),
        loops=loop_closures([*direct, *others]),
        doubted=tuple(name for name in estimate.poses if measured and name in doubted),
        unconfirmed=tuple(name for name in estimate.poses if name in single and name not in cameras),
    )
    return together, {name: adjusted_sensor(name, estimate) for name in estimate.poses}


def sharing_intrinsics(ties: Sequence[Tie]) -> list[str]:
    """List the cameras that have several calibrations, which share the errors of intrinsics."""
    counts = Counter(tie.to for tie in ties if tie.kind == "calibration")
    return [camera for camera, count in counts.items() if count > 1]


def _without_contradictions(
    direct: Sequence[Tie], others: Sequence[Tie], shared: Sequence[str]
) -> tuple[list[Tie], dict[Tie, Closure]]:
    """Leave out the tie that is farthest beyond chance from all others, again and again until there is none.

    Args:
        direct: Calibrations with the first LiDAR, which stay.
        others: The other ties.
        shared: Cameras whose calibrations share the errors of intrinsics.

    Returns:
        The ties that are kept, and how each one differs from the others, if these reach both of its sensors.
    """
    kept, left_out = list(others), dict[Tie, Closure]()
    while True:
        closures = dict[Tie, Closure]()
        for tie in kept:
            estimate = RigEstimate.fit([*direct, *(other for other in kept if other is not tie)], shared)
            if estimate.has(*tie.ends):
                closures[tie] = estimate.compare(tie)
        farthest = max(closures, key=lambda tie: closures[tie].times_the_limit, default=None)
        if farthest is None or closures[farthest].is_explained:
            return kept, left_out | closures
        left_out[farthest] = closures[farthest]
        kept.remove(farthest)


def loop_closures(ties: Sequence[Tie]) -> tuple[LoopClosure, ...]:
    """Compute the closure of each loop: that of each tie between two sensors which those before it reach."""
    ordered = in_reach(list(ties))
    first = RigEstimate.fit([tie for tie, new in ordered if new is not None], sharing_intrinsics(ties))
    tree = {new: next(end for end in tie.ends if end != new) for tie, new in ordered if new is not None}
    return tuple(
        LoopClosure(sensors=loop_of(tie, tree), **first.compare(tie)._asdict())
        for tie, new in ordered
        if new is None
    )


def adjusted_calibration(
    calibration: CalibrationDocument, observations: Observations, sensor: AdjustedSensor, by: str
) -> CalibrationDocument:
    """Return a calibration with the pose (4, 4) and the uncertainty of an adjustment.

    Args:
        calibration: Calibration of the camera alone.
        observations: Observations that it was made from, as the pose sees them.
        sensor: Its adjusted pose and uncertainty.
        by: What moved it, for the note.
    """
    T, uncertainty = sensor
    agreement, away = core.agreement(observations.core, T), compare_poses(T, calibration.pose)
    quality = Quality.of(
        agreement,
        turn_loss=observations.turn_loss(T),
        num_frames=calibration.quality.num_frames,
        runner_up_margin=calibration.quality.runner_up_margin,
    )
    stage = Stage(T_camera_lidar=T.tolist(), mutual_information_nats=agreement.mutual_information)
    note = (
        f"{by} of the rig moved the camera by {lengths([away.camera_center_m])} and "
        f"{figure(away.rotation_deg)} degrees"
    )
    changes = {
        "uncertainty": uncertainty.with_pixels(calibration.used_camera),
        "quality": quality,
        "stages": calibration.stages | {STAGE: stage},
        "notes": (*calibration.notes, note),
    }
    kept = {name: value for name, value in calibration if name not in POSE_FORMS}
    return CalibrationDocument.from_pose(T, **kept | changes)
