"""Sweeps deskewed by the speed that they themselves show along the view of the camera.

The mutual information at the best pose is compared at several speeds. Near its maximum it is a parabola, and so is the
share of each square of the images: the slopes of the shares at the maximum, which add up to nothing, are the scatter
that makes the standard error (the sandwich of `uncertainty.covariance`, for one variable). They are centred scene by
scene, because scenes at different speeds differ by more than noise.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.config import PolishConfig
from semcal_cli.drive.camera import Camera, intrinsic_value, with_intrinsics
from semcal_cli.estimation.adjust.intrinsics_estimate import ascend_with
from semcal_cli.estimation.adjust.joint_fit import SpeedErrors, Variables, adjust_observations
from semcal_cli.estimation.refine.higher_maxima import ClimbConfig, climb
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.estimation.stage import StageResult
from semcal_cli.estimation.uncertainty.information import information_by_squares
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import adjoint, local_coordinates, pose_at
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.skew import Skew
from semcal_cli.result.sections import MeasuredSpeed

STEP_M_S = 5.0
"""Difference of the speeds that are compared: half a metre a turn, at ten turns per second."""
NUM_STEPS = 2
"""Number of such steps to either side that are always tried where maxima are many. On a street of KITTI-360, passed at
10 m/s, searches at 5 m/s may end lower than those at a standstill."""
AT_A_SPEED = ClimbConfig(max_searches=2)
"""Searches for the highest maximum at one speed."""
LAST_M_S = 40.0
"""Speed at which the search ends without a maximum."""
MIN_SIGMAS = 3.0
"""Standard errors from a standstill, from which a speed deskews sweeps."""
MIN_SCENES = 4
"""Smallest number of scenes that show a speed: in one scene, errors of the pose may look like one."""


InverseCurvature: TypeAlias = npt.NDArray[np.float64] | None
"""(6, 6) of a polish near by, which saves time; None if there is none."""


@dataclass(frozen=True, kw_only=True)
class Deskewed(StageResult):
    """Pose after deskewing; the pose before it if sweeps were left unchanged."""

    observations: Observations
    """Points where the LiDAR would have seen them at the moment of the image, and the images."""
    speed: MeasuredSpeed | None
    """Speed that the sweeps show; None if they show none."""
    errors: SpeedErrors | None = None
    """Errors of the pose by those of the speed; None without a speed."""
    for_intrinsics: Callable[[Camera], tuple[Observations, Pose]] | None = None
    """Function that returns points and images, and the best pose (4, 4) with these, metres, by which the intrinsics of
    a camera are tested. They are deskewed by the speed that the sweeps show whatever the principal point is, because
    with a wrong one they seem to have another. None where sweeps were left unchanged, or deskewed by that speed."""

    @property
    def covariance(self) -> Matrix | None:
        """(6, 6) covariance of the pose; None without a speed."""
        return None if self.errors is None else self.errors.of_pose


class _Best(NamedTuple):
    """The best pose on sweeps deskewed by one speed."""

    observations: Observations
    """The deskewed sweeps and the images, with the camera that goes with the pose."""
    T_camera_lidar: Pose
    inverse_curvature: InverseCurvature = None
    center_change_px: float = 0.0
    """Change of a coordinate of the principal point that was climbed together with the pose, pixels."""


class _Ascent(NamedTuple):
    """How the best pose on deskewed sweeps is looked for from another one (4, 4)."""

    find: Callable[[Observations, Pose, InverseCurvature], _Best]
    is_search: bool = False
    """Whether it draws other poses, so that it may end higher when it is repeated."""


class _Fit(NamedTuple):
    """The best pose at a speed."""

    speed_m_s: float
    T_camera_lidar: Pose
    share_by_square: Mapping[tuple[int, ...], float]
    """Share of each square of the scenes, by scene, row and column, in the mutual information, nats."""
    inverse_curvature: InverseCurvature
    center_change_px: float

    @property
    def information(self) -> float:
        """Mutual information, nats."""
        return sum(self.share_by_square.values())


class _Fits(NamedTuple):
    """Fits where the search began, and at three speeds around that of the largest information."""

    first: _Fit
    before: _Fit
    middle: _Fit
    after: _Fit


def deskew(
    observations: Observations,
    skew: Skew,
    T_camera_lidar: Pose,
    rng: np.random.Generator | None = None,
    *,
    with_center: bool = False,
) -> Deskewed:
    """Estimate the speed of the rig along the view, and deskew the sweeps if it moves.

    Args:
        observations: Points and images, as the drive gives them.
        skew: How a speed skews them.
        T_camera_lidar: (4, 4) pose that is a few pixels off at most, metres.
        rng: Source of searches for the highest maximum at each speed, where there are others beside that pose: the
            highest at a wrong speed may be another one than at the right speed. None where polishes follow the pose.
        with_center: Whether the speed is found together with `skew.center`, because it is to be estimated; without
            `rng`.
    """
    ascent = POLISH if rng is None else _make_search(observations, T_camera_lidar, rng)
    start = _Best(observations, T_camera_lidar)
    if with_center:
        ascent = _polish_with(skew.center)
        start = _with_focal_and_center(observations, T_camera_lidar, skew.center)
    fits = _fit_speeds(start.observations, skew, start.T_camera_lidar, ascent)
    if fits is not None and rng is not None:
        T_camera_lidar = fits.first.T_camera_lidar
    speed = None if fits is None else _find_maximum(fits)
    as_they_are = Deskewed(
        T_camera_lidar=T_camera_lidar,
        agreement=core.agreement(observations.core, T_camera_lidar),
        note="the images do not tell the speed, so sweeps stay as they are",
        observations=observations,
        speed=None,
    )
    if fits is None or speed is None:
        return as_they_are
    figures = f"{speed.along_view_m_s:.1f} +- {speed.sigma_m_s:.1f} m/s along the view"
    if with_center:
        figures += f", found together with {skew.center}"
    as_they_are = replace(as_they_are, speed=speed, errors=_errors(fits, speed, skew))
    if not speed.is_used:
        note = f"the images show no speed, {figures}, and none across it; sweeps stay as they are"
        return replace(as_they_are, note=note)
    seen = skew.deskewed(observations, speed.used_m_s)
    if with_center:
        # The fits moved the pose together with the principal point, which the polish takes as given.
        T = T_camera_lidar
    elif rng is None:
        # The polish holds out data, which took part in the fits: it starts where the speed alone moves the pose.
        (change,) = local_coordinates([fits.middle.T_camera_lidar], fits.first.T_camera_lidar)
        T = pose_at(T_camera_lidar, change)
    else:
        # All data choose the maximum, as in the search before.
        T = ascent.find(seen, fits.middle.T_camera_lidar, None).T_camera_lidar
    return replace(
        as_they_are,
        T_camera_lidar=T,
        agreement=core.agreement(seen.core, T),
        note=f"deskewed by the speed that the images show, {figures}",
        observations=seen,
        for_intrinsics=None if with_center else partial(_for_intrinsics, observations, skew, fits.middle),
    )


def remaining_speed(observations: Observations, skew: Skew, T_camera_lidar: Pose) -> MeasuredSpeed | None:
    """Estimate the speed that sweeps still show after they were deskewed, whatever the principal point is.

    Args:
        observations: Deskewed points, and the images.
        skew: How another speed would skew them.
        T_camera_lidar: (4, 4) pose that is a few pixels off at most, metres.

    Returns:
        The speed; None if they show none.
    """
    fits = _fit_speeds(observations, skew, T_camera_lidar, _polish_with(skew.center))
    return None if fits is None else _find_maximum(fits)


def _for_intrinsics(
    observations: Observations, skew: Skew, near: _Fit, camera: Camera
) -> tuple[Observations, Pose]:
    """Deskew by the speed that is found together with the principal point; without one, take sweeps as they are."""
    observations, T = replace(observations, camera=camera), near.T_camera_lidar
    fits = _fit_speeds(observations, skew, T, _polish_with(skew.center), near.speed_m_s)
    speed = None if fits is None else _find_maximum(fits)
    seen = observations if speed is None else skew.deskewed(observations, speed.along_view_m_s)
    return seen, newton(seen, T, PolishConfig()).T_camera_lidar


def _polish(observations: Observations, T_start: Pose, inverse_curvature: InverseCurvature) -> _Best:
    polished = newton(observations, T_start, PolishConfig(), inverse_curvature)
    return _Best(observations, polished.T_camera_lidar, polished.inverse_curvature)


POLISH = _Ascent(_polish)


def _polish_with(center: str) -> _Ascent:
    """Make a polish of the pose together with a coordinate of the principal point."""

    def polish(observations: Observations, T_start: Pose, _: InverseCurvature) -> _Best:
        maximum = ascend_with(observations, T_start, (center,), levels=(1,))
        changes = np.array(maximum.changes)
        adjusted = adjust_observations(observations, Variables((center,), with_delay=False), changes)
        return _Best(adjusted, maximum.T_camera_lidar, center_change_px=float(changes[0]))

    return _Ascent(polish)


def _with_focal_and_center(observations: Observations, T_start: Pose, center: str) -> _Best:
    """Replace cx and fx, or cy and fy, by what sweeps as they are ask for; the aspect is that of the drive.

    On KITTI's sets, fx is then within 1.5 pixels, and the speed from there the same within 0.3 m/s, whether K is right,
    cx is 20 pixels off or both focal lengths 1 %. With that 1 %, the sweeps of KITTI object would show -4.7 m/s instead
    of 4.4. With fy and cy free, they show 3.8 +- 1.7, and those of a jam -3.5 +- 0.8 instead of -2.0: fy ends up to 2 %
    too small.
    """
    camera, focal = observations.camera, center.replace("c", "f")
    names = (focal, center)
    maximum = ascend_with(observations, T_start, names)
    changes = np.array(maximum.changes)
    adjusted = adjust_observations(observations, Variables(names, with_delay=False), changes)
    scale = intrinsic_value(adjusted.camera, focal) / intrinsic_value(camera, focal)
    both = {name: scale * intrinsic_value(camera, name) for name in ("fx", "fy")}
    return _Best(replace(adjusted, camera=with_intrinsics(adjusted.camera, both)), maximum.T_camera_lidar)


def _make_search(observations: Observations, T_camera_lidar: Pose, rng: np.random.Generator) -> _Ascent:
    """Make a search for the highest maximum around a pose that stays near the given one (4, 4)."""
    starts = observations.starts

    def is_allowed(T: Pose) -> bool:
        away = compare_poses(T, T_camera_lidar)
        return starts is None or away.is_within(starts.farthest_deg, starts.farthest_m)

    def search(seen: Observations, T_start: Pose, _: InverseCurvature) -> _Best:
        return _Best(seen, climb(seen, T_start, rng, AT_A_SPEED, is_allowed))

    return _Ascent(search, is_search=True)


def _fit_speeds(
    observations: Observations,
    skew: Skew,
    T_camera_lidar: Pose,
    ascent: _Ascent,
    first_m_s: float = 0.0,
) -> _Fits | None:
    """Find the best pose at one speed after another, to that of the largest information and one beyond.

    Returns None if there are too few scenes, or the information still rises at the last speed.
    """
    observations = observations.with_scenes
    if len(set(observations.scenes)) < MIN_SCENES:
        return None
    at_speed = skew.at_speeds(observations)

    def fit(speed_m_s: float, T_start: Pose, inverse_curvature: InverseCurvature) -> _Fit:
        best = ascent.find(at_speed(speed_m_s), T_start, inverse_curvature)
        parts = information_by_squares(best.observations, best.T_camera_lidar)
        shares = parts.sums / max(parts.weights.sum(), 1.0)
        share_by_square = defaultdict[tuple[int, ...], float](float)
        # Frames of one scene, and cues, share squares.
        for square, share in zip(parts.by_scene.tolist(), shares.tolist(), strict=True):
            share_by_square[tuple(square)] += share
        return _Fit(
            speed_m_s, best.T_camera_lidar, share_by_square, best.inverse_curvature, best.center_change_px
        )

    def next_to(near: _Fit, step: int) -> _Fit:
        return fit(near.speed_m_s + step * STEP_M_S, near.T_camera_lidar, near.inverse_curvature)

    def highest() -> int:
        return max(fits, key=lambda step: fits[step].information)

    fits, checked = {0: fit(first_m_s, T_camera_lidar, None)}, set[int]()
    for step in range(1, NUM_STEPS + 1) if ascent.is_search else ():
        for sign in (-1, 1):
            fits[sign * step] = next_to(fits[sign * (step - 1)], sign)
    while (best := highest()) not in checked:
        if abs(fits[best].speed_m_s) >= LAST_M_S:
            return None
        for step in (best - 1, best + 1):
            if step not in fits or ascent.is_search:
                # A search from the best pose, with other poses beside it, may end higher than one before.
                again = next_to(fits[best], step - best)
                fits[step] = max(fits.get(step, again), again, key=lambda fit: fit.information)
        checked.add(best)
    return _Fits(fits[0], fits[best - 1], fits[best], fits[best + 1])


def _find_maximum(fits: _Fits) -> MeasuredSpeed | None:
    """Find the maximum of the parabola through three fits, and its standard error; None if there is none."""
    _, *around = fits
    squares = sorted(set().union(*(fit.share_by_square for fit in around)))
    before, middle, after = (
        np.array([fit.share_by_square.get(square, 0.0) for square in squares]) for fit in around
    )
    slopes, bends = (after - before) / (2.0 * STEP_M_S), (before - 2.0 * middle + after) / STEP_M_S**2
    bend = -float(bends.sum())
    if not bend > 0.0:
        return None
    away_m_s = float(slopes.sum()) / bend
    scenes = np.array(squares)[:, 0]
    counts, slopes = np.bincount(scenes), slopes + bends * away_m_s
    means = np.bincount(scenes, slopes) / np.maximum(counts, 1)
    correction = np.sqrt(counts / np.maximum(counts - 1, 1))
    sigma_m_s = float(np.linalg.norm(correction[scenes] * (slopes - means[scenes]))) / bend
    along_view_m_s = fits.middle.speed_m_s + away_m_s
    return MeasuredSpeed(
        along_view_m_s=along_view_m_s,
        sigma_m_s=sigma_m_s,
        is_used=abs(along_view_m_s) >= MIN_SIGMAS * sigma_m_s,
    )


def _errors(fits: _Fits, speed: MeasuredSpeed, skew: Skew) -> SpeedErrors:
    (twist,) = local_coordinates([fits.after.T_camera_lidar], fits.before.T_camera_lidar)
    change = np.append(twist, fits.after.center_change_px - fits.before.center_change_px)
    change_per_m_s = change / (fits.after.speed_m_s - fits.before.speed_m_s)
    along_view = adjoint(fits.middle.T_camera_lidar)[:, :3] @ skew.view
    # A speed that is not used is an error of its whole size.
    error_m_s = math.hypot(speed.sigma_m_s, speed.along_view_m_s - speed.used_m_s)
    error_by_moment = np.append(along_view * (speed.used_m_s * skew.moment_sigma_s), 0.0)
    errors = np.column_stack([change_per_m_s * error_m_s, error_by_moment])
    return SpeedErrors(np.asarray(errors @ errors.T), skew.center)
