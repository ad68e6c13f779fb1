"""Ties: what is measured or stated of the transform between two sensors of a rig.

A tie states T_to_source with the covariance of a twist on its left, in the frame of `to`. The calibration of a camera
with a LiDAR, the registration of the sweeps of two LiDARs, and a stated constraint are the same but for what is known
of their errors.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.many.rig.matched_images import MatchedImages
from semcal_cli.many.rig.rig_document import FIRST_LIDAR, Constraint
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.uncertainty import Uncertainty

TieKind: TypeAlias = Literal["calibration", "registration", "constraint"]


@dataclass(frozen=True, eq=False)
class Tie:
    """Measured or stated transform between two sensors of a rig."""

    kind: TieKind
    to: str
    """Sensor to whose frame the transform leads."""
    source: str
    """Sensor from whose frame it leads."""
    pose: Pose
    """T_to_source (4, 4), p_to = T_to_source p_source, metres."""
    covariance: Matrix
    """(6, 6) covariance of a twist on its left, square metres and radians."""
    uncertainty: Uncertainty | None = None
    """What is known of the errors of a measurement; None for a constraint, whose covariance is stated."""
    shares_errors: bool = False
    """Whether its errors are shared with other such ties to an unknown degree, as by all cues but labels."""

    @classmethod
    def of_calibration(
        cls, camera: str, lidar: str, calibration: CalibrationDocument, *, even_doubted: bool = False
    ) -> Tie | None:
        """Make the tie of a camera and a LiDAR; None if the calibration is not trusted, or has no uncertainty."""
        uncertainty = calibration.uncertainty if even_doubted else calibration.believed_uncertainty
        if uncertainty is None:
            return None
        shares = "cues" in calibration.settings.options
        covariance = np.array(uncertainty.covariance)
        return cls("calibration", camera, lidar, calibration.pose, covariance, uncertainty, shares)

    @classmethod
    def of_constraint(cls, constraint: Constraint) -> Tie:
        """Make the tie of a constraint."""
        covariance = np.diag(constraint.variances)
        return cls("constraint", constraint.to, constraint.source, constraint.pose, covariance)

    @classmethod
    def of_images(cls, shown: MatchedImages) -> Tie:
        """Make the tie of what images show of two cameras."""
        return cls("constraint", shown.to, shown.source, shown.pose, np.array(shown.covariance))

    @property
    def ends(self) -> tuple[str, str]:
        """Both sensors."""
        return self.to, self.source


def in_reach(ties: list[Tie]) -> list[tuple[Tie, str | None]]:
    """Order ties so that each has a sensor that the first LiDAR or the ties before it reach.

    Ties that nothing reaches are left out.

    Returns:
        The ties, each with the sensor that it is the first to reach; None if others reach both of its sensors.
    """
    reached, waiting = {FIRST_LIDAR}, list(ties)
    ordered: list[tuple[Tie, str | None]] = []
    while (tie := next((tie for tie in waiting if not reached.isdisjoint(tie.ends)), None)) is not None:
        waiting.remove(tie)
        new = next((end for end in tie.ends if end not in reached), None)
        ordered.append((tie, new))
        reached.update(tie.ends)
    return ordered


def reached_by(ties: Sequence[Tie]) -> set[str]:
    """Return the sensors that ties reach from the first LiDAR, with the first LiDAR."""
    return {FIRST_LIDAR, *(new for _, new in in_reach([*ties]) if new is not None)}


def unconfirmed(ties: Sequence[Tie]) -> set[str]:
    """Return the sensors that a single tie separates from the first LiDAR, so that no loop confirms their place."""
    all_of_them = reached_by(ties)
    without_one = (reached_by([other for other in ties if other is not tie]) for tie in ties)
    return all_of_them - all_of_them.intersection(*without_one)


def relying_on(wrong: Collection[Tie], ties: Sequence[Tie]) -> set[str]:
    """Return the sensors whose place relies on a loop of a wrong tie: any tie of the loop may be the wrong one.

    Args:
        wrong: Ties that others contradict.
        ties: All ties, with these.
    """
    of_loops = {other for tie in wrong for other in on_loops_of(tie, ties)}
    return reached_by(ties) - reached_by([tie for tie in ties if tie not in of_loops])


def on_loops_of(tie: Tie, ties: Sequence[Tie]) -> set[Tie]:
    """Return all ties on a common loop with one of them, and that one: no single sensor separates them from it."""
    sensors = {end for each in ties for end in each.ends}
    return {*ties}.intersection(*(_connected(tie, ties, sensor) for sensor in sensors))


def _connected(tie: Tie, ties: Sequence[Tie], separator: str) -> set[Tie]:
    """Return the ties that one of them leads to, through any sensor but one."""
    connected, reached = {tie}, {*tie.ends} - {separator}
    while found := {each for each in ties if each not in connected and not reached.isdisjoint(each.ends)}:
        connected |= found
        reached |= {end for each in found for end in each.ends} - {separator}
    return connected


def loop_of(tie: Tie, tree: dict[str, str]) -> tuple[str, ...]:
    """List the sensors around the loop that a tie closes, from the first LiDAR on if it is one of them.

    Args:
        tie: A tie between two sensors of the tree.
        tree: For each sensor but the first LiDAR, the next one on its way there.
    """
    ways = [[end] for end in tie.ends]
    for way in ways:
        while way[-1] in tree:
            way.append(tree[way[-1]])
    one, other = ways
    shared = next(sensor for sensor in one if sensor in other)
    there, back = one[: one.index(shared) + 1], other[: other.index(shared)]
    around = [*there, *reversed(back)]
    start = around.index(FIRST_LIDAR) if FIRST_LIDAR in around else 0
    return (*around[start:], *around[:start])
