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

from semcal_cli.many.rig.adjustment_document import Adjustment, ComparedConstraint, LoopClosure
from semcal_cli.many.rig.rig_document import FIRST_LIDAR, Constraint
from semcal_cli.many.rig.rig_estimate import Closure, RigEstimate
from semcal_cli.many.rig.rig_uncertainty import (
    AdjustedSensor,
    adjusted_sensor,
    joint_covariance,
    rows,
)
from semcal_cli.many.rig.ties import Tie, in_reach, loop_of, relying_on, unconfirmed
from semcal_cli.result.calibration_document import CalibrationDocument


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
        LoopClosure(sensors=loop_of(tie, tree), **first.compare(tie).model_dump())
        for tie, new in ordered
        if new is None
    )
