"""What is known of a pose beforehand, put together with what its labels say.

What labels say is a measurement of the pose with the covariance of the sandwich
(`semcal_cli.assessment.uncertainty`), what is known is another, and the two are weighed by their information
(Gauss-Newton). What is known exactly is a constraint. Where labels alone determine no pose, they are looked at anew
from where each round led, and directions in which they do not bend carry none of their information: there, what is
known decides alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.assessment.priors import EXACT, Prior, clamp
from semcal_cli.assessment.uncertainty import (
    Matrix,
    is_determined,
    scatter,
    sensitivity,
)
from semcal_cli.config import EDGE_BAND_PX
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.poses import Pose
from semcal_cli.geometry.twists import apply_twist
from semcal_cli.result.stage import Finding, StageResult
from semcal_cli.result.uncertainty import Uncertainty

Vector6 = npt.NDArray[np.float64]

CONTRADICTION_LEVEL = 1e-4
"""Labels contradict what is known if chance has them so far apart once in so many."""
MAX_SIGMAS = 4.0
"""What is known may be so many of its standard deviations from the pose: the same for one axis."""
MAX_ROUNDS = 20
LONGEST_STEP_PX = 2.0
"""About as far as a curvature holds."""
SETTLED_PX = 0.1
"""Rounds end when one would move the points by less than this, root mean square: as `PolishConfig.settled_px`."""
LEAST_BEND = 1e-6
"""Where information falls by less than this share of the steepest direction's, per pixel, that is rounding."""
LEAST_INFORMATION = 1e-13
"""Directions with less than this share of the best known one's are open: that much is rounding."""
UNSETTLED = Finding("the pose that labels and what is known determine together had not settled")
MANY = 1e6
"""Degrees of freedom of what is known."""


@dataclass(frozen=True, kw_only=True)
class Fused(StageResult):
    """A pose that goes with labels and with what is known. Its findings are contradictions between the two."""

    uncertainty: Uncertainty | None
    """None if labels and what is known do not determine the pose together."""
    is_alone: bool
    """Whether labels determine the pose without what is known."""
    label_gain: Matrix
    """(6, 6) share of a twist said by labels that the pose follows."""
    is_settled: bool


def fuse(
    observations: Observations,
    T_camera_lidar: Pose,
    priors: Sequence[Prior],
    *,
    edge_band_px: int = EDGE_BAND_PX,
) -> Fused:
    """Find the pose that labels and priors determine together.

    Args:
        observations: What the pose was polished on.
        T_camera_lidar: (4, 4) as polished without what is known.
        priors: What is known; at least one direction is left free.
        edge_band_px: Of the polish.
    """
    around = sensitivity(observations, T_camera_lidar, edge_band_px=edge_band_px)
    is_alone = around is not None and is_determined(around)
    contradictions: dict[str, list[str]] = {}
    if around is not None and is_alone:
        labels = _labels(around, observations.num_frames)
        contradictions = {prior.name: _contradiction(labels, prior, T_camera_lidar) for prior in priors}
    T, fit = _iterate(observations, T_camera_lidar, priors, around, is_alone, edge_band_px)
    if fit is not None:
        # To the last digit, where steps are first order.
        T = clamp(T, [prior.exact for prior in priors])
    is_settled = fit is not None and fit.moved_px < SETTLED_PX
    far = [line for prior in priors for line in contradictions.get(prior.name) or _distance(prior, T)]
    return Fused(
        T_camera_lidar=T,
        agreement=_core.agreement(observations.core, T),
        findings=(*(() if is_settled else (UNSETTLED,)), *(map(Finding, far) if fit is not None else ())),
        uncertainty=None if fit is None else fit.uncertainty(T),
        is_alone=is_alone,
        label_gain=np.eye(6) if fit is None else fit.covariance @ fit.labels.information,
        is_settled=is_settled,
    )


class _Fit(NamedTuple):
    """Where the rounds of Gauss-Newton ended."""

    labels: _Labels
    """What labels say there."""
    covariance: Matrix
    """(6, 6) of a twist on the left of the pose."""
    is_closed: bool
    """Whether no direction is left open."""
    moved_px: float
    """How far the last round moved the points, root mean square."""

    def uncertainty(self, T_camera_lidar: Pose) -> Uncertainty | None:
        """How sure the pose is; None if a direction is left open."""
        if not self.is_closed:
            return None
        degrees_of_freedom = _degrees_of_freedom(self.labels, self.covariance)
        return Uncertainty.from_covariance(T_camera_lidar, self.covariance, degrees_of_freedom)


def _iterate(
    observations: Observations,
    T_start: Pose,
    priors: Sequence[Prior],
    around: _core.Sensitivity | None,
    is_alone: bool,
    edge_band_px: int,
) -> tuple[Pose, _Fit | None]:
    """Weigh labels and priors until a round moves little; no fit where labels say nothing at all.

    Where labels alone determine the pose, what they say is taken once; otherwise it is looked at anew in every round.
    """
    T = T_start if is_alone else clamp(T_start, priors)
    labels, fit = _SILENT, None
    for index in range(MAX_ROUNDS):
        if index > 0 and not is_alone:
            around = sensitivity(observations, T, edge_band_px=edge_band_px)
        if around is None:
            return T, None
        if index == 0 or not is_alone:
            labels = _labels(around, observations.num_frames)
        step, covariance, is_closed = _solve(labels, _known(T, priors), around.motions)
        moved_px = float(np.sqrt(step @ around.motions @ step))
        step *= 1.0 if is_alone else min(1.0, LONGEST_STEP_PX / max(moved_px, SETTLED_PX))
        T = apply_twist(T, step)
        # Where labels lead does not change, seen from where the step has led.
        labels = labels._replace(mean=labels.mean - labels.reads @ step)
        fit = _Fit(labels, covariance, is_closed, moved_px)
        if moved_px < SETTLED_PX:
            break
    return T, fit


class _Labels(NamedTuple):
    """What labels say of a twist: `reads @ twist` is a normal variable with this mean and covariance."""

    reads: Matrix
    """(k, 6), k directions in which they bend."""
    influences: Matrix
    """(parts, k) of each part of the pictures, centred."""
    mean: npt.NDArray[np.float64]
    covariance: Matrix

    @property
    def information(self) -> Matrix:
        """(6, 6), 0 in directions that are not read."""
        return np.asarray(self.reads.T @ np.linalg.solve(self.covariance, self.reads))


_SILENT = _Labels(np.zeros((0, 6)), np.zeros((1, 0)), np.zeros(0), np.zeros((0, 0)))
"""Labels that say nothing."""


class _Known(NamedTuple):
    """Rows of what is known: `jacobian @ twist` ought to be minus the residual."""

    jacobian: Matrix
    residual: npt.NDArray[np.float64]
    sigmas: npt.NDArray[np.float64]


def _labels(around: _core.Sensitivity, num_frames: int) -> _Labels:
    scale = 1.0 / np.sqrt(np.diag(around.motions))
    bends, directions = np.linalg.eigh(around.curvature * np.outer(scale, scale))
    bend = bends > LEAST_BEND * max(bends[-1], 0.0)
    if len(around.scores) <= len(bends) + 1:
        return _SILENT  # Fewer parts than that have no covariance to speak of.
    influences = around.scores @ (scale[:, None] * directions[:, bend]) / bends[bend]
    covariance, centred = scatter(influences, num_frames)
    return _Labels((directions[:, bend] / scale[:, None]).T, centred, influences.sum(axis=0), covariance)


def _known(T_camera_lidar: Pose, priors: Sequence[Prior]) -> _Known:
    sigmas = np.concatenate([prior.sigmas for prior in priors])
    stated = np.isfinite(sigmas)
    jacobian = np.concatenate([prior.jacobian(T_camera_lidar) for prior in priors])
    residual = np.concatenate([prior.residual(T_camera_lidar) for prior in priors])
    return _Known(jacobian[stated], residual[stated], sigmas[stated])


def _solve(labels: _Labels, known: _Known, motions: Matrix) -> tuple[Vector6, Matrix, bool]:
    """The twist to the best pose, its covariance, and whether no direction is left open; there, the pose stays."""
    is_exact = known.sigmas <= EXACT
    weight = 1.0 / known.sigmas[~is_exact] ** 2
    J, e = known.jacobian[~is_exact], known.residual[~is_exact]
    information = labels.information + J.T @ (weight[:, None] * J)
    pull = labels.reads.T @ np.linalg.solve(labels.covariance, labels.mean) - J.T @ (weight * e)
    to_exact, free = np.zeros(6), np.eye(6)
    if is_exact.any():
        to_exact = -np.linalg.pinv(known.jacobian[is_exact]) @ known.residual[is_exact]
        free = _null_space(known.jacobian[is_exact])
    # In directions that move the points alike.
    free = free / np.sqrt(np.diag(free.T @ motions @ free))
    weights, directions = np.linalg.eigh(free.T @ information @ free)
    closed = weights > LEAST_INFORMATION * weights[-1]
    basis = free @ directions[:, closed]
    covariance = basis / weights[closed] @ basis.T
    return to_exact + covariance @ (pull - information @ to_exact), covariance, bool(closed.all())


def _degrees_of_freedom(labels: _Labels, covariance: Matrix) -> Vector6:
    """Satterthwaite's, of the part of the variance that is estimated: what is known has plenty."""
    influences = labels.influences @ np.linalg.solve(labels.covariance, labels.reads) @ covariance
    of_labels = covariance @ labels.information @ covariance
    share = np.diag(of_labels) / np.maximum(np.diag(covariance), np.finfo(float).tiny)
    squares = influences**2
    estimated = squares.sum(axis=0) ** 2 / np.maximum((squares**2).sum(axis=0), np.finfo(float).tiny)
    return np.asarray(np.clip(estimated / np.maximum(share, 1e-3) ** 2, 1.0, MANY))


def _contradiction(labels: _Labels, prior: Prior, T_camera_lidar: Pose) -> list[str]:
    """Compare what is known with where labels alone lead, over all known axes at once."""
    from scipy.special import fdtri

    stated = np.isfinite(prior.sigmas)
    alone: Matrix = np.asarray(np.linalg.inv(labels.information), np.float64)
    jacobian = prior.jacobian(T_camera_lidar)[stated]
    twist = np.linalg.solve(labels.reads, labels.mean)
    off = prior.residual(T_camera_lidar)[stated] + jacobian @ twist
    covariance = jacobian @ alone @ jacobian.T + np.diag(np.square(prior.sigmas)[stated])
    chi2 = float(off @ np.linalg.solve(covariance, off))
    fewest = float(_degrees_of_freedom(labels, alone).min())
    # Of few parts of the pictures anything may be chance; that is no reason to believe it.
    by_chance = float(stated.sum() * fdtri(stated.sum(), fewest, 1.0 - CONTRADICTION_LEVEL))
    most = min(by_chance, float(stated.sum()) * MAX_SIGMAS**2)
    if chi2 <= most:
        return []
    worst = int((np.abs(off) / np.sqrt(np.diag(covariance))).argmax())
    far = _length(int(np.flatnonzero(stated)[worst]), float(off[worst]))
    return [
        f"{prior.name} is {far} from where labels alone lead, chi-square {chi2:.0f} of {stated.sum()}, needed at most "
        f"{most:.0f}"
    ]


def _distance(prior: Prior, T_camera_lidar: Pose) -> list[str]:
    """Compare what is known with the pose that all agreed on, labels and other knowledge."""
    deviations = np.abs(prior.residual(T_camera_lidar)) / np.maximum(prior.sigmas, EXACT)
    worst = int(deviations.argmax())
    if deviations[worst] <= MAX_SIGMAS:
        return []
    far = _length(worst, float(prior.residual(T_camera_lidar)[worst]))
    return [
        f"{prior.name} is {far} from the pose that all else leads to, {deviations[worst]:.1f} standard deviations, "
        f"needed at most {MAX_SIGMAS:.0f}"
    ]


def _length(axis: int, off: float) -> str:
    return f"{100.0 * abs(off):.1f} cm" if axis < 3 else f"{np.degrees(abs(off)):.2f} degrees"


def _null_space(rows: Matrix) -> Matrix:
    _, values, directions = np.linalg.svd(rows)
    return np.asarray(directions[int((values > 1e-9 * values[0]).sum()) :].T)
