"""What frames say of the intrinsics of a drive: a joint ascent over pose and intrinsics from a polished pose.

`adjust.joint` replaces the intrinsics on request. This estimate only tests them, in a tenth of the time: it climbs two
levels, holds nothing out, and takes its errors from the geometry of the points.

An error of the intrinsics that the pose cannot imitate moves points in the image. `M = mean(J^T J)`, over the Jacobians
`J` of the points' pixels by pose and intrinsics, tells how far: if points are misaligned by a pixel, root mean square,
the intrinsics may be off by the roots of the diagonal of `M^-1`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from semcal_cli import core
from semcal_cli.config import AscentConfig, PolishConfig
from semcal_cli.drive.camera import (
    K_ENTRIES,
    Camera,
    core_name,
    intrinsic_names,
    intrinsic_value,
    with_all_coefficients,
)
from semcal_cli.estimation.adjust.joint_fit import MIN_EVIDENCE, Variables, adjust_observations
from semcal_cli.estimation.uncertainty.intrinsics import around_intrinsics
from semcal_cli.estimation.uncertainty.sensitivity import Sensitivity
from semcal_cli.geometry.arrays import Matrix, Numbers, Pose
from semcal_cli.observations.observations import Observations

LEVELS = (4, 2)
"""Sides of the blocks of the ascent, pixels. On KITTI object, with K that is 20 pixels or 3 % off, cx and fx end within
a pixel of where they end with the right K, and fy and cy within 5. A level of 8 pixels before them changes cy by up to
3 pixels, cx and fx by less than 1, and one of single pixels takes up to twice the time."""
FOCAL_SIGMA, CENTER_SIGMA, LENS_SIGMA = 0.05, 0.03, 0.1
"""Standard deviations of the priors that hold what the frames do not determine: relative, as a share of the image's
longer side, and of the first radial coefficient. Errors of a camera whose images are used are smaller."""
SHARED_PX, SCENE_PX = 0.35, 1.5
"""Misalignment of the points, root mean square, that all scenes share, and that each scene has of its own where edges
are compared. On three KITTI sets and their halves with the right K, estimates are off by at most 2.5 times what they
give (`tests/benchmarks/intrinsics.py`); on a third of one, five scenes, cx is off by 3.4 times."""
SHARE_ACROSS = 0.27
"""The same for the coordinate of the principal point across the scan lines, mostly cy, relative to the others: edges
along it, which are sharp, distinguish cy from a pitch by columns. On the same drives it is off by 1 to 4 pixels, where
the misalignment of the points would allow 11 to 15."""
DOUBTFUL = 3.0
"""Standard errors, the limit of `intrinsics`, beyond which something has to be off with the given focal length across
the scan lines as well. Edges determine that least: with the right K, KITTI's sets ask for 0.5 to 2.7 % less of it. With
sixteen rings, and on KITTI-360, cy then seems 7 to 10 pixels off; with the given one, it is 1 to 5."""
MIN_SCENES = 4
"""Least number of scenes where edges are compared, the number that a trusted pose by edges needs."""
NEAR_PX = 1.6
"""A step of Newton's method stands for the ascent if it changes no intrinsic by more than this misalignment of points
does, root mean square. A longer one is no measure: from focal lengths 3 % too short it went five times too far."""


@dataclass(frozen=True)
class IntrinsicsEstimate:
    """Intrinsics that the frames ask for, and how far these may be off."""

    given: Mapping[str, float]
    """Values that the drive states, by name."""
    changes: Numbers
    """(n,) estimates minus given values."""
    sigmas: Numbers
    """(n,) standard errors; infinite where the frames determine nothing."""
    compensation: Matrix
    """(6, n) twist of the pose, metres and radians, that best hides a unit of each intrinsic."""
    is_settled: bool = True
    """Whether the ascent ended at a maximum."""

    @property
    def deviations(self) -> Numbers:
        """(n,) sizes of the changes in standard errors."""
        return np.asarray(np.abs(self.changes) / self.sigmas)


def estimate_intrinsics(
    observations: Observations, T_camera_lidar: Pose, around: Sensitivity | None
) -> IntrinsicsEstimate | None:
    """Estimate the intrinsics together with the pose, from near the maximum.

    By labels, one step of Newton's method shows whether the maximum is near. Edges are too rough for that.

    Args:
        observations: Observations of one cue.
        T_camera_lidar: (4, 4) polished pose, metres.
        around: Result of `around_intrinsics` there.

    Returns:
        The estimate; None if the frames determine none. Where the ascent ends lower than it began, the given values
        explain the frames better than all others that it met, and stay.
    """
    names = _names(observations.camera)
    is_rough = observations.is_multimodal
    if around is None or not names or (is_rough and len(set(observations.scenes)) < MIN_SCENES):
        return None
    given = {name: intrinsic_value(observations.camera, name) for name in names}
    around = around.of_first(6 + len(names))
    if not around.is_distinct:
        return None
    # Of the principal point: cy, unless the camera is on its side.
    across = "cy" if observations.along(T_camera_lidar) == "rows" else "cx"
    if not is_rough and around.is_maximum:
        step = around.scores.sum(axis=0) @ around.influence
        if np.all(np.abs(step[6:]) < NEAR_PX * _pixels_of(around, names, across)):
            return _estimate(given, step[6:], around, observations, across)
    seen = replace(observations, camera=with_all_coefficients(observations.camera, names))
    ascent = ascend_with(seen, T_camera_lidar, names)
    changes = np.array(ascent.changes)
    adjusted = adjust_observations(seen, Variables(names, with_delay=False), changes)
    is_higher = adjusted.information(ascent.T_camera_lidar) > seen.information(T_camera_lidar)
    if is_higher and not is_rough:
        at_end = around_intrinsics(adjusted, ascent.T_camera_lidar)
        around = around if at_end is None else at_end.of_first(6 + len(names))
    estimate = _estimate(given, changes if is_higher else np.zeros(len(names)), around, observations, across)
    if is_rough and (estimate.deviations > DOUBTFUL).any():
        steadier = _with_given_focal(estimate, seen, T_camera_lidar, across)
        estimate = estimate if (steadier.deviations > DOUBTFUL).any() else steadier
    return replace(estimate, is_settled=ascent.moved_px <= PolishConfig.settled_px)


def _with_given_focal(
    estimate: IntrinsicsEstimate, observations: Observations, T_camera_lidar: Pose, across: str
) -> IntrinsicsEstimate:
    """Estimate the intrinsics again, with the given focal length across the scan lines, whose change stays."""
    names, held = [*estimate.given], across.replace("c", "f")
    free = [index for index, name in enumerate(names) if name != held]
    changes = estimate.changes.copy()
    changes[free] = ascend_with(observations, T_camera_lidar, tuple(names[index] for index in free)).changes
    return replace(estimate, changes=changes)


def _names(camera: Camera) -> tuple[str, ...]:
    """Name the intrinsics that are tested: those of K, and the first radial coefficient where the lens has one."""
    if camera.is_exact:
        return ()
    # The denominator of a rational lens, k4 to k6, bends what k1 does; the sensitivity is that of k1 alone.
    has_k1 = "k1" in intrinsic_names(camera.model) and not any(camera.distortion[5:])
    return (*K_ENTRIES, "k1") if has_k1 else tuple(K_ENTRIES)


def ascend_with(
    observations: Observations, T_camera_lidar: Pose, names: tuple[str, ...], levels: tuple[int, ...] = LEVELS
) -> core.JointMaximum:
    """Climb from a pose (4, 4) and the given intrinsics to the maximum of both, on blocks of pixels."""
    camera = observations.camera
    sigmas = dict.fromkeys(("cx", "cy"), CENTER_SIGMA * max(camera.size))
    sigmas |= {name: FOCAL_SIGMA * intrinsic_value(camera, name) for name in ("fx", "fy")}
    settings = AscentConfig(
        factors=levels,
        changes=(0.0,) * len(names),
        sigmas=tuple(sigmas.get(name, LENS_SIGMA) for name in names),
        evidence=MIN_EVIDENCE,
    )
    variables = [core_name(camera, name) for name in names]
    return core.maximise(observations.core, T_camera_lidar, settings, variables, None)


def _estimate(
    given: Mapping[str, float],
    changes: Numbers,
    around: Sensitivity,
    observations: Observations,
    across: str,
) -> IntrinsicsEstimate:
    """Add standard errors, from the geometry of the points, and by labels from the scatter of the scores."""
    pose, free = slice(0, 6), slice(6, None)
    motions = around.motions
    compensation = -np.linalg.solve(motions[pose, pose], motions[pose, free])
    by_px = _pixels_of(around, tuple(given), across)
    if observations.is_multimodal:
        chance = SCENE_PX * by_px / np.sqrt(len(set(observations.scenes)))
    elif around.is_maximum:
        chance = np.sqrt(np.diag(around.scatter(around.influence).covariance)[free])
    else:
        chance = np.full(len(given), np.inf)
    return IntrinsicsEstimate(given, changes, np.hypot(SHARED_PX * by_px, chance), np.asarray(compensation))


def _pixels_of(around: Sensitivity, names: tuple[str, ...], across: str) -> Numbers:
    """Compute how far each intrinsic (n,) may be off if points are misaligned by a pixel, root mean square."""
    by_px = np.sqrt(np.diag(np.linalg.inv(around.motions))[6:])
    by_px[names.index(across)] *= SHARE_ACROSS
    return np.asarray(by_px)
