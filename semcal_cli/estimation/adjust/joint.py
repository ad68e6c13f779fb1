"""Joint estimation of intrinsics, the time offset and the pose.

The estimate (`adjust.joint_fit`) is kept if it differs from the drive's values by more than chance and
held-out data agree better with it.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace

import numpy as np

from semcal_cli import core
from semcal_cli.config import AdjustmentConfig, PolishConfig
from semcal_cli.drive.camera import Camera, intrinsic_value, with_all_coefficients
from semcal_cli.errors import format_against_limit
from semcal_cli.estimation.adjust.joint_fit import Fit, Problem, SpeedErrors, Variables, adjust_observations
from semcal_cli.estimation.refine.polish import newton, split
from semcal_cli.estimation.stage import StageResult
from semcal_cli.estimation.uncertainty.information import information_by_squares, paired_gain
from semcal_cli.estimation.uncertainty.intrinsics import around_intrinsics, shift_by
from semcal_cli.geometry.arrays import Matrix, Pose
from semcal_cli.observations.motion import can_be_unrolled, exposed_as, unrolled
from semcal_cli.observations.observations import Observations
from semcal_cli.result.refined_camera import Clock, Intrinsic, RefinedCamera, offset_words
from semcal_cli.result.uncertainty import Uncertainty

MIN_GAIN = 2.0
"""Gain of held-out data, in standard errors, above which an estimate is kept."""
NOT_DETERMINED = "not determined: drive at different speeds, with turns"
"""Meaning of a time offset that the data do not determine."""
DELAY_NOT_DETERMINED = f"the time offset is {NOT_DETERMINED}"
"""Note about a time offset that the data do not determine."""


@dataclass(frozen=True, kw_only=True)
class JointEstimate(StageResult):
    """Joint estimate of the pose, intrinsics and time offset; the pose before it where it is not kept."""

    observations: Observations
    """Observations as seen by the camera that the pose belongs to."""
    camera: RefinedCamera | None
    """Estimated intrinsics; None if none were asked for."""
    clock: Clock | None
    """Estimated time offset; None if it was not asked for."""
    uncertainty: Uncertainty | None
    """Uncertainty of the pose together with the other variables; None if the estimate is not kept."""
    left_open: Matrix | None
    """(6, 6) covariance to add to that of the pose, from errors of variables that keep the drive's values and are not
    part of the uncertainty; None if there are none or the labels determine no pose."""
    is_kept: bool
    """Whether the pose belongs to the estimate."""
    notes: tuple[str, ...]
    """Sentences about what is not determined or not kept."""

    @property
    def advice(self) -> str:
        """What to do where variables that keep the drive's values make the pose uncertain."""
        more, without = [], []
        if self.camera is not None and not self.is_kept:
            more.append("record near and far objects in all parts of the images")
            without.append("--refine-intrinsics if K is right")
        if self.clock is not None and not self.clock.is_kept:
            more.append("drive at different speeds, with turns")
            without.append("--estimate-delay if the clocks agree")
        return f"{' and '.join(more)}, or calibrate without {' and without '.join(without)}"


def fit_jointly(
    observations: Observations,
    T_camera_lidar: Pose,
    config: AdjustmentConfig,
    polish: PolishConfig,
    time_offset_s: float = 0.0,
    speed_errors: SpeedErrors | None = None,
) -> JointEstimate:
    """Estimate intrinsics and the time offset together with the pose.

    With a rolling shutter, an estimate that is kept changes the lines of points, and everything is estimated once more.

    Args:
        observations: Labelled points and label images of all frames, as the drive's camera sees them.
        T_camera_lidar: (4, 4) pose with that camera, metres.
        config: What to estimate, and what is known of it beforehand.
        polish: Settings of the polish, by which data are held out.
        time_offset_s: Time by which the observations assume images to be later than their stamps, seconds.
        speed_errors: Errors by those of the speed that deskewed the sweeps; None without a speed.
    """
    joint = _estimate(observations, T_camera_lidar, config, polish, time_offset_s, speed_errors)
    if not joint.is_kept or not can_be_unrolled(observations):
        return joint
    lines = unrolled(joint.observations, joint.T_camera_lidar)
    return _estimate(
        exposed_as(observations, lines), T_camera_lidar, config, polish, time_offset_s, speed_errors
    )


def _estimate(
    observations: Observations,
    T_camera_lidar: Pose,
    config: AdjustmentConfig,
    polish: PolishConfig,
    time_offset_s: float,
    speed_errors: SpeedErrors | None,
) -> JointEstimate:
    """Estimate once, with points that stay on their lines."""
    camera = with_all_coefficients(observations.camera, config.intrinsics)
    adjusted, asked = replace(observations, camera=camera), Variables(config.intrinsics, config.with_delay)
    problem = Problem(adjusted, asked, config, polish, speed_errors)
    fit = problem.fit_determined(T_camera_lidar)
    gain = _held_out_gain(problem, T_camera_lidar, fit)
    is_kept = bool(
        fit.variables.names
        and fit.is_beyond_chance
        and math.isfinite(gain.sigma)
        and gain.gain > MIN_GAIN * gain.sigma
        and fit.moved_px <= polish.settled_px
    )
    T, after, uncertainty = T_camera_lidar, observations, None
    # The joint covariance of an estimate that is kept includes errors of all intrinsics.
    staying = asked
    if is_kept:
        T, after, adjusted = fit.T_camera_lidar, fit.observations, fit.observations
        staying = Variables((), asked.with_delay and not fit.variables.with_delay)
        if fit.covariance is not None:
            uncertainty = Uncertainty.from_covariance(T, fit.covariance[:6, :6], fit.degrees_of_freedom[:6])
    refined = _camera_of(fit, asked, camera, gain, is_kept) if asked.intrinsics else None
    clock = _clock_of(fit, time_offset_s, is_kept) if asked.with_delay else None
    words = [
        f"{name} {estimate.found - estimate.given:+.4g}"
        for name, estimate in ({} if refined is None else refined.intrinsics).items()
        if estimate.is_determined
    ]
    if clock is not None and clock.is_determined:
        words.append(f"clock {1e3 * clock.time_offset_s:+.1f} ms")
    return JointEstimate(
        T_camera_lidar=T,
        agreement=core.agreement(after.core, T),
        settings={"jointly": asdict(config)},
        note=f"{', '.join(words) or 'nothing determined'}, {'kept' if is_kept else 'not kept'}",
        observations=after,
        camera=refined,
        clock=clock,
        uncertainty=uncertainty,
        left_open=_left_open(fit, problem, adjusted, T, staying),
        is_kept=is_kept,
        notes=_notes(fit, asked, gain, is_kept),
    )


def _left_open(
    fit: Fit, problem: Problem, observations: Observations, T: Pose, asked: Variables
) -> Matrix | None:
    """Compute the covariance (6, 6) of a pose from errors of variables that keep the drive's values.

    Undetermined variables have their prior standard deviation; those of an estimate that is not kept have the second
    moment about the drive's value, from their uncertainty and the change that was found. The two are taken as
    independent of each other. On twelve development drives each of one frame through a narrow lens, of one frame, and
    of flat scenes, 76, 100 and 99 % of all values lie within their intervals, and 69, 98 and 98 % with the fit's
    covariance of both. Intrinsics that are kept are held while the clock moves the pose.

    Args:
        fit: The fit.
        problem: What was fitted, and what is known of the variables beforehand.
        observations: Observations as the pose sees them.
        T: (4, 4) pose, metres.
        asked: Variables that stay.
    """
    if not asked.names:
        return None
    camera = observations.camera
    around = around_intrinsics(observations, T, asked.of_core(camera), asked.twists(observations))
    shift = shift_by(around)
    if shift is None:
        return None
    about = np.diag(asked.sigmas(camera, problem.config) ** 2)
    indices = [asked.names.index(name) for name in fit.variables.names if name in asked.names]
    if indices and fit.covariance is not None:
        about[np.ix_(indices, indices)] = fit.covariance[np.ix_(fit.places, fit.places)]
        about[np.ix_(indices, indices)] += np.outer(fit.changes, fit.changes)
        errors = problem.speed_errors
        if errors is not None and errors.center in fit.variables.names:
            # An error dv of the speed is counted elsewhere, by the change p' of the pose per m/s with the
            # coordinate c free, which comes with its change c'. The pose with the given one is off by
            # shift (c_given - c_true) + (p' - shift c') dv = shift (c_given - c_found + noise) + p' dv,
            # as c_found = c_true + noise + c' dv: the part of its variance by the speed cancels.
            at_center = asked.names.index(errors.center)
            about[at_center, at_center] -= errors.covariance[6, 6]
    return np.asarray(shift @ about @ shift.T)


def _held_out_gain(problem: Problem, T: Pose, fit: Fit) -> core.InformationGain:
    """Compute the gain of held-out data from estimates on the other data, with the variables against without them."""
    kept, held_out = split(problem.observations, problem.polish)
    before, part = newton(kept, T, problem.polish).T_camera_lidar, None
    if fit.variables.names:
        # The maximum of the kept data is near that of all.
        kept_problem = replace(problem, observations=kept, asked=fit.uncertain)
        part = kept_problem.finish(fit.T_camera_lidar, fit.variables, fit.changes)
    if part is None or part.variables != fit.variables:
        return core.held_out_gain(kept.core, held_out.core, before, before)
    adjusted = adjust_observations(held_out, part.variables, part.changes)
    if problem.observations.has_partitions:
        return paired_gain(
            information_by_squares(held_out, before), information_by_squares(adjusted, part.T_camera_lidar)
        )
    return core.held_out_gain(
        kept.core, held_out.core, before, part.T_camera_lidar, (part.observations.core, adjusted.core)
    )


def _camera_of(
    fit: Fit, asked: Variables, camera: Camera, gain: core.InformationGain, is_kept: bool
) -> RefinedCamera:
    intrinsics = {}
    for name in asked.intrinsics:
        drive_value = intrinsic_value(camera, name)
        change, sigma, half_width = 0.0, None, None
        if is_determined := name in fit.variables.intrinsics:
            index = fit.variables.names.index(name)
            change, sigma, half_width = (float(x[index]) for x in (fit.changes, fit.sigmas, fit.half_widths))
        intrinsics[name] = Intrinsic(
            given=drive_value,
            found=drive_value + change,
            sigma=sigma,
            half_width_95=half_width,
            is_determined=is_determined,
        )
    covariance = fit.covariance if fit.variables.names else None
    return RefinedCamera(
        is_kept=is_kept,
        held_out_gain_nats=gain.gain,
        held_out_sigma_nats=gain.sigma if math.isfinite(gain.sigma) else None,
        found=fit.observations.camera,
        intrinsics=intrinsics,
        joint_covariance=None if covariance is None else covariance.tolist(),
    )


def _clock_of(fit: Fit, before_s: float, is_kept: bool) -> Clock:
    offset_s, sigma_s, half_width_s, covariance = before_s, None, None, None
    if is_determined := fit.variables.with_delay:
        offset_s, sigma_s = before_s + float(fit.changes[-1]), float(fit.sigmas[-1])
        half_width_s, places = float(fit.half_widths[-1]), [*range(6), fit.places[-1]]
        covariance = None if fit.covariance is None else fit.covariance[np.ix_(places, places)].tolist()
    return Clock(
        time_offset_s=offset_s,
        given_s=before_s,
        sigma_s=sigma_s,
        half_width_95_s=half_width_s,
        is_determined=is_determined,
        is_kept=is_kept and is_determined,
        meaning=offset_words(offset_s) if is_determined else NOT_DETERMINED,
        joint_covariance=covariance,
    )


def _notes(fit: Fit, asked: Variables, gain: core.InformationGain, is_kept: bool) -> tuple[str, ...]:
    """Describe what is not determined, and why an estimate is not kept."""
    notes = []
    if missing := [name for name in asked.intrinsics if name not in fit.variables.intrinsics]:
        *others, last = missing
        subject = f"{', '.join(others)} and {last} are" if others else f"{last} is"
        stay = "stay" if others else "stays"
        notes.append(
            f"{subject} not determined by these frames and {stay} as in the drive: record near and far objects in all "
            "parts of the images"
        )
    if asked.with_delay and not fit.variables.with_delay:
        notes.append(DELAY_NOT_DETERMINED)
    if not is_kept and fit.variables.names:
        both = ["intrinsics"] * bool(fit.variables.intrinsics) + ["clocks"] * fit.variables.with_delay
        why = "the estimate differs from them only by chance"
        if fit.is_beyond_chance:
            better, limit = format_against_limit(gain.significance, MIN_GAIN, 1)
            why = (
                f"held-out data agree only {better} standard errors better with the estimate, needed more than "
                f"{limit}"
            )
        notes.append(f"the {' and '.join(both)} of the drive are kept, because {why}")
    return tuple(notes)
