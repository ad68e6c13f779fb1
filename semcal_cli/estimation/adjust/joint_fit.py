"""The joint fit of pose, intrinsics and time offset, and its covariance.

All are brought to the maximum of the exact mutual information together (`rust/alignment/joint.rs`), from what the drive
says. Prior standard deviations hold a variable that the labels do not constrain; it is then left out, and reported as
not determined.

The covariance is that of the labels' measurement (`uncertainty.sensitivity`) over all variables together;
priors are further independent measurements, and all frames share errors of label borders. Undetermined intrinsics stay
in it with their prior errors, which add to those of the pose.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from semcal_cli import core
from semcal_cli.config import (
    CENTER_SIGMA_PX,
    FOCAL_SIGMA,
    AdjustmentConfig,
    AscentConfig,
    PolishConfig,
    SensitivityConfig,
)
from semcal_cli.drive.camera import Camera, core_name, intrinsic_value, with_intrinsics
from semcal_cli.estimation.uncertainty.sensitivity import (
    BLOCKS_PX,
    MANY,
    determined_sensitivity,
    measure,
    sensitivity,
)
from semcal_cli.geometry.arrays import Matrix, Numbers, Pose
from semcal_cli.observations.motion import delayed, twists_per_s
from semcal_cli.observations.observations import Observations

BLOCKS_ACROSS = 80
"""Least number of the coarsest blocks across an image, where intrinsics are estimated."""
BLOCKS_ACROSS_WITH_DELAY = 20
"""The same where the time offset is estimated, which moves points farther."""
FINE_LEVELS = 2
"""Number of the level, with blocks of four pixels, from which on the estimate is climbed twice."""
MIN_EVIDENCE = 3e3
"""Nats of a likelihood that a nat of mutual information is worth while the estimate is far off. With right variables it
is some thousand for each frame."""
MAX_SIGMA_SHARE = 0.5
"""Largest standard error of a determined intrinsic, relative to its prior standard deviation."""
MAX_DELAY_SIGMA_S = 0.01
"""Largest standard error of a determined time offset, in seconds."""
CHANCE = 1e-3
"""Probability, by chance, of an estimate that differs as much from what the drive says, below which it is kept."""
BORDERS_PX = 0.03
"""Displacement of points by labels' borders that all frames share, in pixels, root mean square: it bends what a lens
sees as wrong intrinsics do. On twelve development drives of 20 frames, three lenses, intervals contain the truth in 83
and 92 % of the variables of a fisheye and of a 100-degree lens without it, in 92 and 96 % with it, and in all of a
90-degree lens either way."""
MIN_WEIGHT = 1e-12
"""Smallest information along a direction, relative to that of a variable alone. Less is rounding."""
DELAY = "delay"
"""Name of the time offset among the variables."""


class Variables(NamedTuple):
    """Variables after the pose."""

    intrinsics: tuple[str, ...]
    with_delay: bool

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all variables, in their order."""
        return (*self.intrinsics, DELAY) if self.with_delay else self.intrinsics

    def without(self, names: Sequence[str]) -> Variables:
        """Leave out some variables."""
        left = tuple(name for name in self.intrinsics if name not in names)
        return Variables(left, self.with_delay and DELAY not in names)

    def of_core(self, camera: Camera) -> list[str]:
        """Name the intrinsics as the core does."""
        return [core_name(camera, name) for name in self.intrinsics]

    def twists(self, observations: Observations) -> list[Sequence[float]] | None:
        """List the twist of each frame if the time offset is a variable."""
        return twists_per_s(observations) if self.with_delay else None

    def sigmas(self, camera: Camera, config: AdjustmentConfig) -> Numbers:
        """Return the prior standard deviations of the variables, for the drive's camera."""

        def sigma(name: str) -> float:
            # An estimate replaces what a drive states: `camera` is the drive's.
            stated = getattr(camera.intrinsics_sigma, name, 0.0)
            if name in ("fx", "fy"):
                if config.focal_sigma is None and stated > 0.0:
                    return float(stated)
                return (config.focal_sigma or FOCAL_SIGMA) * intrinsic_value(camera, name)
            if name in ("cx", "cy"):
                return float(config.center_sigma_px or stated or CENTER_SIGMA_PX)
            return config.tangential_sigma if name[0] in "pst" else config.lens_sigma

        sigmas = [sigma(name) for name in self.intrinsics]
        return np.array([*sigmas, *([config.delay_sigma_s] if self.with_delay else [])])


class Fit(NamedTuple):
    """The maximum of the mutual information over those variables that it determines."""

    variables: Variables
    T_camera_lidar: Pose
    changes: Numbers
    """(m,) difference of the variables from the drive's values."""
    observations: Observations
    """Observations as the estimate sees them."""
    uncertain: Variables
    """Variables of the covariance, including those that are not determined."""
    covariance: Matrix | None
    """(6 + n, 6 + n) covariance of the pose's twist and of these; None where a direction is open."""
    degrees_of_freedom: Numbers
    moved_px: float

    @property
    def places(self) -> list[int]:
        """Rows of the variables in the covariance."""
        return [6 + self.uncertain.names.index(name) for name in self.variables.names]

    @property
    def sigmas(self) -> Numbers:
        """(m,) standard errors of the variables; infinite if unknown."""
        if self.covariance is None:
            return np.full(len(self.changes), math.inf)
        return np.asarray(np.sqrt(np.diag(self.covariance)[self.places]))

    @property
    def half_widths(self) -> Numbers:
        """(m,) half widths of 95 % intervals."""
        freedoms = self.degrees_of_freedom[self.places]
        return np.asarray(self.sigmas * [core.student_quantile(0.975, freedom) for freedom in freedoms])

    @property
    def is_beyond_chance(self) -> bool:
        """Whether the variables differ from the drive's values by more than chance (Wald's test)."""
        if self.covariance is None or not self.places:
            return False
        covariance, count = self.covariance[np.ix_(self.places, self.places)], len(self.changes)
        distance = float(self.changes @ np.linalg.solve(covariance, self.changes))
        # What classes share is in the covariance. By the few degrees of freedom of classes nothing is beyond chance.
        return distance > count * core.fisher_limit(CHANCE, count, MANY)


class SpeedErrors(NamedTuple):
    """Errors of a pose by those of the speed that deskewed its sweeps, and of the moment of the images."""

    covariance: Matrix
    """(7, 7) covariance of the pose, and of a coordinate of the principal point. It is zero for the latter unless the
    speed was found together with it."""
    center: str
    """That coordinate, cx or cy: if it is wrong, it looks like a speed."""

    @property
    def of_pose(self) -> Matrix:
        """(6, 6) covariance of the pose."""
        return self.covariance[:6, :6]


@dataclass(frozen=True)
class Problem:
    """What is estimated together with the pose, from which data, and by which settings."""

    observations: Observations
    """Labelled points and label images, as the drive's camera sees them."""
    asked: Variables
    """Variables that are to be estimated."""
    config: AdjustmentConfig
    """What is known of the variables beforehand."""
    polish: PolishConfig
    """Settings of the polish."""
    speed_errors: SpeedErrors | None = None
    """Errors by those of the speed that deskewed the sweeps; None without one."""

    def fit_determined(self, T: Pose) -> Fit:
        """Fit all variables that the data determine; each fit leaves out those that the one before did not determine.

        Args:
            T: (4, 4) pose with the drive's camera, metres.
        """
        variables = self.asked
        while True:
            fit = self._fit(T, variables)
            if fit.variables != variables:
                return fit
            fit = self._on_determined_blocks(fit)
            if fit.covariance is None and len(variables.names) > 1 and variables.with_delay:
                # A clock that moves no point, as where the rig stands, carries no information, and does not affect the
                # others.
                variables = variables.without([DELAY])
                continue
            left_open = self._left_open(fit)
            if not left_open:
                return fit
            # An undetermined clock weakens the others, which the data may determine without it.
            variables = variables.without([DELAY] if DELAY in left_open else left_open)

    def finish(self, T: Pose, variables: Variables, changes: Numbers) -> Fit:
        """Climb the last levels from near the maximum, and compute the covariance there.

        Args:
            T: (4, 4) pose near the maximum, metres.
            variables: Variables that are fitted.
            changes: (m,) their difference from the drive's values, near the maximum.
        """
        # An unbounded time offset would make the pose unboundedly uncertain.
        uncertain = Variables(self.asked.intrinsics, variables.with_delay)
        evidence = self._evidence(adjust_observations(self.observations, variables, changes), T)
        if evidence is None:
            empty = Variables((), with_delay=False)
            return Fit(empty, T, np.zeros(0), self.observations, empty, None, np.ones(6), math.inf)
        maximum = self._climb(T, variables, changes, range(FINE_LEVELS, -1, -1), evidence)
        changes = _changes(maximum, variables)
        adjusted = adjust_observations(self.observations, variables, changes)
        T_max = maximum.T_camera_lidar
        covariance, freedom = self._covariance(adjusted, T_max, uncertain)
        return Fit(variables, T_max, changes, adjusted, uncertain, covariance, freedom, maximum.moved_px)

    def _fit(self, T: Pose, variables: Variables) -> Fit:
        """Find the maximum from the drive's values, from coarse blocks to pixels.

        The weight of the priors is known only there, so the last levels are then climbed again. Coarse blocks may lead
        away, as edges have a narrow basin: a climb that ends lower than it began, or where nothing is determined,
        starts again on the last levels.
        """
        camera = self.observations.camera
        width = min(camera.width, camera.height * 2)
        across = BLOCKS_ACROSS_WITH_DELAY if variables.with_delay else BLOCKS_ACROSS
        coarsest = max(int(math.log2(max(width / across, 1.0))), FINE_LEVELS)
        at_drive, levels = np.zeros(len(variables.names)), range(coarsest, FINE_LEVELS - 1, -1)
        coarse = self._climb(T, variables, at_drive, levels, MIN_EVIDENCE)
        fit = self.finish(coarse.T_camera_lidar, variables, _changes(coarse, variables))
        is_higher = fit.observations.information(fit.T_camera_lidar) >= self.observations.information(T)
        return fit if fit.variables == variables and is_higher else self.finish(T, variables, at_drive)

    def _on_determined_blocks(self, fit: Fit) -> Fit:
        """Take the covariance on the finest blocks of pixels that leave the fewest variables open.

        In full resolution the mutual information is rough along what is hardly determined, and its curvature there
        depends on where in a pixel the points land. On twelve development drives of one frame nothing was determined in
        ten by single pixels alone, and in two by these blocks; 103 of 103 values lay within their intervals.
        """
        fits = [fit]
        for factor in BLOCKS_PX[1:]:
            if not self._left_open(fits[-1]):
                break
            covariance, freedom = self._covariance(
                fit.observations, fit.T_camera_lidar, fit.uncertain, factor
            )
            fits.append(fit._replace(covariance=covariance, degrees_of_freedom=freedom))
        return min(fits, key=lambda candidate: len(self._left_open(candidate)))

    def _left_open(self, fit: Fit) -> list[str]:
        """List the variables that the data do not determine better than the priors."""
        fitted = zip(fit.variables.names, fit.sigmas, self._prior_sigmas(fit.variables), strict=True)
        return [
            name
            for name, sigma, before in fitted
            if not sigma <= (MAX_DELAY_SIGMA_S if name == DELAY else MAX_SIGMA_SHARE * before)
        ]

    def _prior_sigmas(self, variables: Variables) -> Numbers:
        return variables.sigmas(self.observations.camera, self.config)

    def _climb(
        self, T: Pose, variables: Variables, changes: Numbers, levels: range, evidence: float
    ) -> core.JointMaximum:
        """Climb some levels of the pyramid, whose blocks have sides of two to the power of their number."""
        settings = AscentConfig(
            factors=tuple(2**level for level in levels),
            changes=tuple(changes.tolist()),
            sigmas=tuple(self._prior_sigmas(variables).tolist()),
            evidence=evidence,
        )
        names, twists = variables.of_core(self.observations.camera), variables.twists(self.observations)
        return core.maximise(self.observations.core, T, settings, names, twists)

    def _evidence(self, adjusted: Observations, T: Pose) -> float | None:
        """Compute how many nats of a likelihood a nat of mutual information is worth, by the scatter of the scores.

        Returns:
            The number; None if the labels do not determine the pose.
        """
        around = determined_sensitivity(adjusted, T, SensitivityConfig())
        if around is None:
            return None
        # Errors that classes share do not affect the climb; they are part of the final covariance.
        noise, _ = around.noise(around.influence)
        return 6.0 / float(np.trace(noise @ around.curvature))

    def _covariance(
        self, adjusted: Observations, T: Pose, variables: Variables, factor: int = 1
    ) -> tuple[Matrix | None, Numbers]:
        """Compute the covariance of all variables, by the labels and by what was known before, on blocks of pixels."""
        prior_sigmas = self._prior_sigmas(variables)
        nothing = None, np.ones(6 + len(prior_sigmas))
        settings = SensitivityConfig(factor=factor)
        around = sensitivity(
            adjusted, T, settings, variables.of_core(adjusted.camera), variables.twists(adjusted)
        )
        if around is None:
            return nothing
        border_covariance = np.asarray(BORDERS_PX**2 * np.linalg.pinv(around.motions), np.float64)
        labels = measure(around, border_covariance)
        information = labels.information + np.diag(np.concatenate([np.zeros(6), prior_sigmas**-2.0]))
        # Metres, radians and pixels are mixed, so each variable is scaled before directions are compared.
        scale = np.sqrt(np.diag(information))
        if not (scale > 0.0).all():
            return nothing
        weights, directions = np.linalg.eigh(information / np.outer(scale, scale))
        if weights[0] < MIN_WEIGHT:
            return nothing
        basis = directions / scale[:, None]
        covariance = np.asarray(basis / weights @ basis.T)
        freedom = labels.degrees_of_freedom(covariance)
        errors = self.speed_errors
        if errors is None:
            return covariance, freedom
        # On KITTI's sets, 1 m/s changes cx by 0.9 to 1.9 pixels, 0.4 to 1.1 of its standard errors, and the others by
        # up to 0.3 of theirs.
        wider = covariance.copy()
        names = variables.names
        places = [*range(6), *(6 + names.index(name) for name in names if name == errors.center)]
        wider[np.ix_(places, places)] += errors.covariance[: len(places), : len(places)]
        return wider, np.minimum(freedom * (np.diag(wider) / np.diag(covariance)) ** 2, MANY)


def _changes(maximum: core.JointMaximum, variables: Variables) -> Numbers:
    return np.array([*maximum.changes, *([maximum.offset_s] if variables.with_delay else [])])


def adjust_observations(observations: Observations, variables: Variables, changes: Numbers) -> Observations:
    """Return the observations as an estimate sees them: with its camera, and shifted by its time offset."""
    camera = observations.camera
    values = {
        name: intrinsic_value(camera, name) + change
        for name, change in zip(variables.intrinsics, changes.tolist(), strict=False)
    }
    adjusted = replace(observations, camera=with_intrinsics(camera, values)) if values else observations
    return delayed(adjusted, float(changes[-1])) if variables.with_delay else adjusted
