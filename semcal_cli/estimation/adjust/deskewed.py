"""Sweeps deskewed by the speed that they themselves show along the view of the camera.

The mutual information at the best pose is compared at several speeds. Near its maximum it is a parabola, and so is the
share of each square of the images: the slopes of the shares at the maximum, which add up to nothing, are the scatter
that makes the standard error (the sandwich of `uncertainty.covariance`, for one variable). They are centred frame by
frame, because frames at different speeds differ by more than noise.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.config import PolishConfig
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.estimation.stage import StageResult
from semcal_cli.estimation.uncertainty.information import information_by_squares
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.geometry.twists import adjoint, local_coordinates
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.skew import Skew

STEP_M_S = 5.0
"""Difference of the speeds that are compared: half a metre a turn, at ten turns per second."""
MAX_SPEED_M_S = 40.0
"""Fastest speed that is looked for."""
MAX_SIGMA_M_S = 2.0
"""Largest standard error of a speed that is used: it moves the camera by 0.7 cm on KITTI object, where 6.4 m/s move it
by 2.1 cm (`tests/benchmarks/closure.py`)."""
MIN_SIGMAS = 3.0
"""Standard errors from a standstill, from which a speed deskews sweeps."""
MIN_SCENES = 4
"""Smallest number of scenes that show a speed: in one scene, errors of the pose may look like one."""


class Speed(NamedTuple):
    """Speed of the rig along the view of the camera, as its sweeps show it."""

    along_view_m_s: float
    """Mean over the frames; negative backwards."""
    sigma_m_s: float
    """Standard error."""

    @property
    def is_moving(self) -> bool:
        """Whether the rig is seen to move."""
        return abs(self.along_view_m_s) >= MIN_SIGMAS * self.sigma_m_s

    @property
    def used_m_s(self) -> float:
        """Speed by which sweeps are deskewed: 0 where the rig is not seen to move."""
        return self.along_view_m_s if self.is_moving else 0.0

    @property
    def error_m_s(self) -> float:
        """Root mean square error of the speed that is used."""
        return math.hypot(self.sigma_m_s, self.along_view_m_s - self.used_m_s)


@dataclass(frozen=True, kw_only=True)
class Deskewed(StageResult):
    """Pose with deskewed sweeps; the pose before where sweeps stay as they are."""

    observations: Observations
    """Points where the LiDAR would have seen them at the moment of the image, and the images."""
    speed: Speed | None
    """Speed that the sweeps show; None if they show none."""
    covariance: Matrix | None
    """(6, 6) covariance of the pose by errors of the speed and of the moment of the images; None without a speed."""


class _Fit(NamedTuple):
    """The best pose at a speed."""

    speed_m_s: float
    T_camera_lidar: Pose
    of_squares: dict[tuple[int, ...], float]
    """Share of each square, by its frame, row and column, in the mutual information, nats."""
    inverse_curvature: npt.NDArray[np.float64] | None

    @property
    def information(self) -> float:
        """Mutual information, nats."""
        return sum(self.of_squares.values())


def deskew(
    observations: Observations, skew: Skew, T_camera_lidar: Pose, moment_sigma_s: float = 0.0
) -> Deskewed:
    """Estimate the speed of the rig along the view, and deskew the sweeps if it moves.

    Args:
        observations: Points and images, as the drive gives them.
        skew: How a speed skews them.
        T_camera_lidar: (4, 4) pose that is a few pixels off at most, metres.
        moment_sigma_s: Standard deviation of the moment of the images, seconds.
    """
    fits = _fits(observations, skew, T_camera_lidar)
    speed = None if fits is None else _speed(fits)
    if fits is None or speed is None:
        agreement = core.agreement(observations.core, T_camera_lidar)
        return Deskewed(
            T_camera_lidar=T_camera_lidar,
            agreement=agreement,
            note="the images do not tell the speed, so sweeps stay as they are",
            observations=observations,
            speed=None,
            covariance=None,
        )
    seen = skew.removed(observations, speed.used_m_s)
    T = fits[1].T_camera_lidar if speed.is_moving else T_camera_lidar
    told = f"{speed.along_view_m_s:.1f} +- {speed.sigma_m_s:.1f} m/s along the view"
    return Deskewed(
        T_camera_lidar=T,
        agreement=core.agreement(seen.core, T),
        note=f"deskewed by the speed that the images show, {told}"
        if speed.is_moving
        else f"the images show no speed, {told}, so sweeps stay as they are",
        observations=seen,
        speed=speed,
        covariance=_covariance(fits, speed, skew, moment_sigma_s),
    )


def _fits(observations: Observations, skew: Skew, T_camera_lidar: Pose) -> list[_Fit] | None:
    """Polish the pose at speeds around that of the largest information, and return the three around it.

    Returns None if there are too few scenes, or the information still rises at the fastest speed.
    """
    observations = observations.with_scenes
    if len(set(observations.scenes)) < MIN_SCENES:
        return None

    def fit(speed_m_s: float, T_start: Pose, inverse_curvature: npt.NDArray[np.float64] | None) -> _Fit:
        seen = skew.removed(observations, speed_m_s)
        polished = newton(seen, T_start, PolishConfig(), inverse_curvature)
        parts = information_by_squares(seen, polished.T_camera_lidar)
        of_squares = defaultdict[tuple[int, ...], float](float)
        shares = parts.sums / max(parts.weights.sum(), 1.0)
        for square, share in zip(parts.squares.tolist(), shares.tolist(), strict=True):
            of_squares[tuple(square)] += share  # Several cues see one square.
        return _Fit(speed_m_s, polished.T_camera_lidar, of_squares, polished.inverse_curvature)

    def beside(near: _Fit, step_m_s: float) -> _Fit:
        return fit(near.speed_m_s + step_m_s, near.T_camera_lidar, near.inverse_curvature)

    middle = fit(0.0, T_camera_lidar, None)
    before, after = beside(middle, -STEP_M_S), beside(middle, STEP_M_S)
    while max(before.information, after.information) > middle.information:
        if before.information > after.information:
            before, middle, after = beside(before, -STEP_M_S), before, middle
        else:
            before, middle, after = middle, after, beside(after, STEP_M_S)
        if abs(middle.speed_m_s) >= MAX_SPEED_M_S:
            return None
    return [before, middle, after]


def _speed(fits: list[_Fit]) -> Speed | None:
    """Find the maximum of the parabola through three fits; None if its standard error is too large."""
    squares = sorted(set().union(*(fit.of_squares for fit in fits)))
    before, middle, after = (
        np.array([fit.of_squares.get(square, 0.0) for square in squares]) for fit in fits
    )
    slopes, bends = (after - before) / (2.0 * STEP_M_S), (before - 2.0 * middle + after) / STEP_M_S**2
    bend = -float(bends.sum())
    away_m_s = float(slopes.sum()) / bend if bend > 0.0 else math.inf
    scatter = slopes + bends * away_m_s
    frames = np.array(squares)[:, 0]
    counts = np.bincount(frames)
    centred = scatter - (np.bincount(frames, scatter) / np.maximum(counts, 1))[frames]
    sigma_m_s = float(np.linalg.norm(centred)) / bend if bend > 0.0 else math.inf
    return Speed(fits[1].speed_m_s + away_m_s, sigma_m_s) if sigma_m_s <= MAX_SIGMA_M_S else None


def _covariance(fits: list[_Fit], speed: Speed, skew: Skew, moment_sigma_s: float) -> Matrix:
    """Compute the covariance (6, 6) of the pose by errors of the speed and of the moment of the images."""
    before, middle, after = (fit.T_camera_lidar for fit in fits)
    (by_speed,) = local_coordinates([after], before) / (2.0 * STEP_M_S)
    along_view = adjoint(middle)[:, :3] @ skew.view
    twists = np.column_stack([by_speed * speed.error_m_s, along_view * (speed.used_m_s * moment_sigma_s)])
    return np.asarray(twists @ twists.T)
