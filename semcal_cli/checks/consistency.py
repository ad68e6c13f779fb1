"""Consistency checks of a pose with its labels, its surroundings, the focal length and the clocks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.config import ExactConfig, PyramidConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.errors import told_apart
from semcal_cli.estimation.refine.pyramid import refine_exactly
from semcal_cli.estimation.uncertainty.information import (
    compared_by,
    entropy,
    information_by_squares,
    paired_gain,
)
from semcal_cli.findings.check import (
    NOTHING_LABELLED,
    ONE_CLASS,
    OTHER_AZIMUTH,
    WRONG_CLOCKS,
    WRONG_FOCAL_LENGTH,
    WRONG_PAIRING,
    Measured,
)
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.frame_selection import evenly_spaced
from semcal_cli.observations.motion import delayed, differs, twists_per_s
from semcal_cli.observations.observations import NO_CLASS, Observations
from semcal_cli.observations.scenes import ranges_of, shares_alike
from semcal_cli.threads import thread_pool

NUM_FRAMES = 4
"""Number of frames that are checked."""
MAX_ALIKE = 0.8
"""Largest fraction of equal pixels at which exchanging two label images is informative."""
MAX_SHARED = 0.4
"""Largest fraction of equal ranges in the sweeps of two frames at which exchanging them is informative. Frames of
synthetic drives share at most 0.24; in a real jam, frames 2.4 seconds apart share 0.21 to 0.57."""
NO_FIT = "do not fit at all at this pose"
"""Says that pixels carry no information about points."""
TURN_DEG = 30.0
"""Step between the azimuths to which the camera is turned."""
OTHER_MODEL_EXACT = ExactConfig(batch_size=1024, max_points=50_000)
OTHER_MODEL_PYRAMID = PyramidConfig(coarsest_block_deg=1.0)
"""Settings of the refinements with other focal lengths and delays."""
FOCAL_CHANGE = 0.07
"""Relative change by which the focal length is made longer and shorter. Labels must agree less well with either."""
CLOCK_DELAYS_S = (-0.05, -0.015, 0.015, 0.05)
"""Delays of the images to try, in seconds."""


def check_consistency(
    observations: Observations, T_camera_lidar: Pose, *, with_clock: bool = True
) -> tuple[Measured, ...]:
    """Check a pose against its labels, its surroundings, the camera's focal length and the clocks.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4) refined pose, metres.
        with_clock: Whether the motions of the frames differ enough to determine the time offset.
    """
    few = observations.of_frames(evenly_spaced(range(observations.num_frames), NUM_FRAMES))
    return (
        *_too_few_classes(few, T_camera_lidar),
        *_wrong_pairing(few, T_camera_lidar),
        _wrong_azimuth(few, T_camera_lidar),
        *_wrong_model(few, T_camera_lidar, with_clock=with_clock),
    )


class _Fit(NamedTuple):
    """How well observations agree at a pose."""

    T_camera_lidar: Pose
    information: float
    """Information of points about pixels, corrected for chance: nats, or adjusted MI."""
    agreement: core.Agreement
    """Agreement of the labels."""


def _fit(observations: Observations, T_camera_lidar: Pose, agreement: core.Agreement | None = None) -> _Fit:
    """Measure how well observations agree at a pose (4, 4); the agreement there is reused if given."""
    agreement = agreement or core.agreement(observations.core, T_camera_lidar)
    information = agreement.mutual_information - agreement.bias
    if observations.has_partitions:
        information = information_by_squares(observations, T_camera_lidar).mean
    return _Fit(T_camera_lidar, information, agreement)


def _too_few_classes(observations: Observations, T_camera_lidar: Pose) -> list[Measured]:
    """Check that the points in the image and its pixels have enough classes, weighted by their frequency."""
    sides = {}
    if not observations.has_partitions:  # Each segment is a class of its own.
        camera = core_camera(observations.camera)
        sides["points in the image"] = [
            cloud.classes[np.isfinite(core.project_points(camera, cloud.points, T_camera_lidar).ranges)]
            for cloud in observations.clouds
        ]
    sides["pixels"] = [image.classes.ravel() for image in observations.images]
    return [_too_few_on_side(name, ids) for name, ids in sides.items()]


def _too_few_on_side(name: str, ids: Sequence[npt.NDArray[np.uint8]]) -> Measured:
    counts = np.sum([np.bincount(each, minlength=NO_CLASS + 1) for each in ids], axis=0)[:NO_CLASS]
    if not counts.any():
        return NOTHING_LABELLED.without_value(f"none of the {name} are labelled")
    # The number of equally frequent classes that would have the same entropy.
    effective = float(np.exp(entropy(counts)))
    like, least = told_apart(effective, ONE_CLASS.limit(), 2)
    found = (
        f"nearly all {name} have the same class, equivalent to {like} equally frequent classes, needed at least "
        f"{least}"
    )
    return ONE_CLASS.measured(effective, found)


def _wrong_pairing(observations: Observations, T_camera_lidar: Pose) -> list[Measured]:
    """Check that clouds agree less well with the label images of other frames."""
    # All images, the own ones too, are compared by their likeliest classes: probabilities carry less information.
    images, found = [image.without_shares() for image in observations.images], []
    own = _fit(observations.with_images(images), T_camera_lidar).information
    shares = shares_alike(ranges_of([cloud.points for cloud in observations.clouds]))
    for shift in range(1, observations.num_frames):
        others = images[shift:] + images[:shift]
        if np.diag(np.roll(shares, -shift, axis=1)).max() > MAX_SHARED:
            continue  # Images of one scene belong to all of its sweeps.
        alike = np.mean([np.mean(a.classes == b.classes) for a, b in zip(images, others, strict=True)])
        if alike <= MAX_ALIKE:
            found.append(_fit(observations.with_images(others), T_camera_lidar).information)
    if not found:
        return []
    by, best = compared_by(observations), max(found)
    sentence = f"clouds and images {NO_FIT}, and images of other frames fit better"
    if own > 0.0:
        as_well, most = told_apart(best / own, WRONG_PAIRING.limit(by), unit="%")
        sentence = (
            f"images of other frames fit the clouds {as_well} as well as their own, needed at most {most}"
        )
    return [WRONG_PAIRING.measured(_share(best, own), sentence, by)]


def _wrong_azimuth(observations: Observations, T_camera_lidar: Pose) -> Measured:
    """Check that labels agree less well with the camera turned about the LiDAR's z axis to where points are visible."""
    own, best, best_deg = _fit(observations, T_camera_lidar), 0.0, 0.0
    for turn_deg in np.arange(TURN_DEG, 360.0, TURN_DEG).tolist():
        c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
        T_about_z = np.eye(4)
        T_about_z[:2, :2] = [[c, -s], [s, c]]
        turned = _fit(observations, T_camera_lidar @ T_about_z)
        if turned.information > best and turned.agreement.overlap >= 0.5 * own.agreement.overlap:
            best, best_deg = turned.information, turn_deg
    by, turned_by = compared_by(observations), f"with the camera turned by {best_deg:.0f} degrees"
    found = f"points and images {NO_FIT}" + f", and fit better {turned_by}" * (best_deg > 0.0)
    if own.information > 0.0:
        as_well, most = told_apart(best / own.information, OTHER_AZIMUTH.limit(by), unit="%")
        found = f"{turned_by}, points and images still fit {as_well} as well, needed at most {most}"
    return OTHER_AZIMUTH.measured(_share(best, own.information), found, by)


def _share(other: float, own: float) -> float:
    """Compute the information of another fit relative to the own one, which may be zero."""
    if own > 0.0:
        return other / own
    return math.inf if other > own else 0.0


def _wrong_model(observations: Observations, T_camera_lidar: Pose, *, with_clock: bool) -> list[Measured]:
    """Check that labels agree less well after refinements with other focal lengths and other delays of the images.

    All refinements use the same frames and settings. The agreement distinguishes focal lengths even in a single frame,
    although they hardly change its curvature.
    """
    twists = twists_per_s(observations) if with_clock else None
    delays_s = CLOCK_DELAYS_S if twists is not None and differs(twists) else ()
    zoomed = {
        change: replace(observations, camera=observations.camera.zoomed(1.0 + change))
        for change in (-FOCAL_CHANGE, FOCAL_CHANGE)
    }
    late = {delay_s: delayed(observations, delay_s) for delay_s in delays_s}

    def refitted(model: Observations) -> _Fit | None:
        found = refine_exactly(model, T_camera_lidar, OTHER_MODEL_EXACT, OTHER_MODEL_PYRAMID)
        return None if found is None else _fit(model, found.T_camera_lidar, found.agreement)

    # Each refinement is a sequence of small steps, so several run in parallel.
    with thread_pool() as pool:
        own, *others = pool.map(refitted, [observations, *zoomed.values(), *late.values()])
    if own is None:
        return []
    # A refinement may end at a lower top than the one that it left.
    own = max(own, _fit(observations, T_camera_lidar), key=lambda fit: fit.information)
    fits = {key: fit for key, fit in zip([*zoomed, *late], others, strict=True) if fit is not None}
    return [
        *_wrong_focal_length(own, {key: fits[key] for key in zoomed if key in fits}),
        *_wrong_clocks(observations, own, {key: fits[key] for key in late if key in fits}),
    ]


def _wrong_focal_length(own: _Fit, others: Mapping[float, _Fit]) -> list[Measured]:
    if not others:
        return []
    change = max(others, key=lambda change: others[change].information)
    gain = _share(others[change].information, own.information) - 1.0
    better = f"{gain:.1%} better" if own.information > 0.0 else "better"
    sentence = (
        f"the focal length looks wrong, since points and images agree {better} with fx and fy {abs(change):.0%} "
        f"{'longer' if change > 0.0 else 'shorter'}"
    )
    return [WRONG_FOCAL_LENGTH.measured(gain, sentence)]


def _wrong_clocks(observations: Observations, own: _Fit, others: Mapping[float, _Fit]) -> list[Measured]:
    if not others:
        return []
    before, sigmas = information_by_squares(observations, own.T_camera_lidar), {}
    for delay_s, fit in others.items():
        after = information_by_squares(delayed(observations, delay_s), fit.T_camera_lidar)
        gain = paired_gain(before, after)
        sigmas[delay_s] = gain.gain / max(gain.sigma, 1e-12)
    best_s = max(sigmas, key=lambda delay_s: sigmas[delay_s])
    sentence = (
        f"the clocks look wrong, since points and images agree {sigmas[best_s]:.1f} standard errors better if "
        f"images are {1e3 * abs(best_s):.0f} ms {'later' if best_s > 0.0 else 'earlier'} than image_stamp says"
    )
    return [WRONG_CLOCKS.measured(sigmas[best_s], sentence)]
