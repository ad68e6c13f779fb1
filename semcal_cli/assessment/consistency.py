"""Consistency checks of a pose with its labels, its surroundings, the focal length and the clocks.

Each check gives findings, which are sentences with figures. The absence of findings does not prove a pose right.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.assessment.information import compared_by, information_by_squares, paired_gain
from semcal_cli.config import ExactConfig, PyramidConfig
from semcal_cli.drive.alike import shares_alike
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.frame_selection import evenly_spaced
from semcal_cli.drive.motion import delayed, differs, twists_per_s
from semcal_cli.drive.observations import NO_CLASS, Observations
from semcal_cli.geometry.poses import Pose
from semcal_cli.refinement.exact import refine_exactly
from semcal_cli.result.checks.check import Measured
from semcal_cli.result.checks.table import (
    NOTHING_LABELLED,
    ONE_CLASS,
    OTHER_AZIMUTH,
    WRONG_CLOCKS,
    WRONG_FOCAL_LENGTH,
    WRONG_PAIRING,
)
from semcal_cli.threads import thread_pool

NUM_FRAMES = 4
"""Number of frames that are checked."""
MAX_ALIKE = 0.8
"""Largest share of equal pixels of two label images whose exchange tells anything."""
MAX_SHARED = 0.4
"""Largest share of equal ranges in the sweeps of two frames whose exchange tells anything. Frames of synthetic drives
share at most 0.24; in a real jam, frames 2.4 seconds apart share 0.21 to 0.57."""
NO_FIT = "do not fit at all at this pose"
"""What is said where pixels tell nothing of points."""
TURN_DEG = 30.0
"""Step of the azimuths to which the camera is turned."""
OTHER_MODEL_EXACT = ExactConfig(batch_size=1024, max_points=50_000)
OTHER_MODEL_PYRAMID = PyramidConfig(coarsest_block_deg=1.0)
"""Settings of the refinements with other focal lengths and delays."""
FOCAL_CHANGE = 0.07
"""Share by which the focal length is made longer and shorter. Labels must agree less well with either."""
CLOCK_DELAYS_S = (-0.05, -0.015, 0.015, 0.05)
"""Delays of the images that are tried, in seconds."""


def check_consistency(
    observations: Observations, T_camera_lidar: Pose, *, with_clock: bool = True
) -> tuple[Measured, ...]:
    """Check a pose against its labels, its surroundings, the camera's focal length and the clocks.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4) refined pose, metres.
        with_clock: Whether the frames move so differently that they tell the clock.
    """
    few = observations.of_frames(evenly_spaced(range(observations.num_frames), NUM_FRAMES))
    return (
        *_too_few_classes(few, T_camera_lidar),
        *_wrong_pairing(few, T_camera_lidar),
        _wrong_azimuth(few, T_camera_lidar),
        *_wrong_model(few, T_camera_lidar, with_clock=with_clock),
    )


def _information(observations: Observations, T_camera_lidar: Pose) -> float:
    """What points tell of the pixels, less what is due to chance: nats, or AMI."""
    return _fit(observations, T_camera_lidar).information


class _Fit(NamedTuple):
    """How well observations agree at a pose."""

    T_camera_lidar: Pose
    information: float
    """Nats, or AMI."""
    agreement: _core.Agreement | None
    """Agreement of the labels, from which the information was computed; None for segments."""


def _fit(observations: Observations, T_camera_lidar: Pose) -> _Fit:
    if observations.has_segments:
        return _Fit(T_camera_lidar, information_by_squares(observations, T_camera_lidar).mean, None)
    return _fit_of(T_camera_lidar, _core.agreement(observations.core, T_camera_lidar))


def _fit_of(T_camera_lidar: Pose, agreement: _core.Agreement) -> _Fit:
    return _Fit(T_camera_lidar, agreement.mutual_information - agreement.bias, agreement)


def _too_few_classes(observations: Observations, T_camera_lidar: Pose) -> list[Measured]:
    """Check that the points in the image and its pixels have enough classes, weighted by their frequency."""
    sides = {}
    if not observations.has_segments:  # Each segment is a class of its own.
        camera = core_camera(observations.camera)
        sides["points in the picture"] = [
            cloud.classes[np.isfinite(_core.project_points(camera, cloud.points, T_camera_lidar).ranges)]
            for cloud in observations.clouds
        ]
    sides["pixels"] = [image.classes.ravel() for image in observations.images]
    return [_too_few_on_side(name, ids) for name, ids in sides.items()]


def _too_few_on_side(name: str, ids: Sequence[npt.NDArray[np.uint8]]) -> Measured:
    counts = np.sum([np.bincount(each, minlength=NO_CLASS + 1) for each in ids], axis=0)[:NO_CLASS]
    if not counts.any():
        return NOTHING_LABELLED.without_value(f"none of the {name} are labelled")
    shares = counts[counts > 0] / counts.sum()
    # The number of equally frequent classes that would have the same entropy.
    effective = float(np.exp(-np.sum(shares * np.log(shares))))
    found = (
        f"{name} are nearly all of one class, they vary like {effective:.2f} equally frequent classes, needed at least "
        f"{ONE_CLASS.limit():g}"
    )
    return ONE_CLASS.measured(effective, found)


def _wrong_pairing(observations: Observations, T_camera_lidar: Pose) -> list[Measured]:
    """Check that clouds agree less well with the label images of other frames."""
    # Pictures are compared by their likeliest classes, their own as well: shares alone tell less.
    images, found = [image.without_shares() for image in observations.images], []
    own = _information(observations.with_images(images), T_camera_lidar)
    shares = shares_alike([cloud.points for cloud in observations.clouds])
    for shift in range(1, observations.num_frames):
        others = images[shift:] + images[:shift]
        if np.diag(np.roll(shares, -shift, axis=1)).max() > MAX_SHARED:
            continue  # Pictures of one scene belong to all its sweeps.
        alike = np.mean([np.mean(a.classes == b.classes) for a, b in zip(images, others, strict=True)])
        if alike <= MAX_ALIKE:
            found.append(_information(observations.with_images(others), T_camera_lidar))
    if not found:
        return []
    by, best = compared_by(observations), max(found)
    sentence = f"clouds and pictures {NO_FIT}, and pictures of other frames fit better"
    if own > 0.0:
        most = WRONG_PAIRING.limit(by)
        sentence = (
            f"pictures of other frames fit the clouds {best / own:.0%} as well, needed at most {most:.0%}"
        )
    return [WRONG_PAIRING.measured(_share(best, own), sentence, by)]


def _wrong_azimuth(observations: Observations, T_camera_lidar: Pose) -> Measured:
    """Check that labels agree less well with the camera turned about the LiDAR's z axis to where points are visible."""
    own = _fit(observations, T_camera_lidar)
    least = 0.5 * _overlap(observations, T_camera_lidar, own)
    best, best_deg = 0.0, 0.0
    for turn_deg in np.arange(TURN_DEG, 360.0, TURN_DEG).tolist():
        T_turned = T_camera_lidar @ _about_z(turn_deg)
        turned = _fit(observations, T_turned)
        if turned.information > best and _overlap(observations, T_turned, turned) >= least:
            best, best_deg = turned.information, turn_deg
    by, turned_by = compared_by(observations), f"with the camera turned by {best_deg:.0f} degrees"
    found = f"points and pictures {NO_FIT}" + f", and better {turned_by}" * (best_deg > 0.0)
    if own.information > 0.0:
        found = (
            f"{turned_by} points and pictures fit {best / own.information:.0%} as well, needed at most "
            f"{OTHER_AZIMUTH.limit(by):.0%}"
        )
    return OTHER_AZIMUTH.measured(_share(best, own.information), found, by)


def _overlap(observations: Observations, T_camera_lidar: Pose, fit: _Fit) -> float:
    return (fit.agreement or _core.agreement(observations.core, T_camera_lidar)).overlap


def _share(other: float, own: float) -> float:
    """Give what another fit has as a share of the own one, which may be none at all."""
    if own > 0.0:
        return other / own
    return math.inf if other > own else 0.0


def _about_z(angle_deg: float) -> Pose:
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    T = np.eye(4)
    T[:2, :2] = [[c, -s], [s, c]]
    return T


def _wrong_model(observations: Observations, T_camera_lidar: Pose, *, with_clock: bool) -> list[Measured]:
    """Check that labels agree less well after refinements with other focal lengths and other delays of the images.

    All refinements use the same frames and settings. The agreement tells focal lengths apart even with a single frame,
    although they hardly change its curvature.
    """
    changes = (-FOCAL_CHANGE, FOCAL_CHANGE)
    twists = twists_per_s(observations) if with_clock else None
    delays_s = CLOCK_DELAYS_S if twists is not None and differs(twists) else ()
    models = [
        observations,
        *(replace(observations, camera=observations.camera.zoomed(1.0 + change)) for change in changes),
        *(delayed(observations, delay_s) for delay_s in delays_s),
    ]
    # Each refinement is a sequence of small steps, so several run in parallel.
    with thread_pool() as pool:
        own, *others = pool.map(lambda model: _refitted(model, T_camera_lidar), models)
    if own is None:
        return []
    # A refinement may end at a lower top than the one that it left.
    own = max(own, _fit(observations, T_camera_lidar), key=lambda fit: fit.information)
    zoomed, of_delays = others[: len(changes)], others[len(changes) :]
    return [
        *_wrong_focal_length(own, dict(zip(changes, zoomed, strict=True))),
        *_wrong_clocks(observations, own, dict(zip(delays_s, of_delays, strict=True))),
    ]


def _wrong_focal_length(own: _Fit, others: Mapping[float, _Fit | None]) -> list[Measured]:
    found = {change: fit.information for change, fit in others.items() if fit is not None}
    if not found:
        return []
    best_change = max(found, key=lambda change: found[change])
    gain = _share(found[best_change], own.information) - 1.0
    better = f"{gain:.1%} better" if own.information > 0.0 else "better"
    sentence = (
        f"the focal length looks wrong, points and pictures agree {better} with fx and fy {abs(best_change):.0%} "
        f"{'longer' if best_change > 0.0 else 'shorter'}"
    )
    return [WRONG_FOCAL_LENGTH.measured(gain, sentence)]


def _wrong_clocks(
    observations: Observations, own: _Fit, others: Mapping[float, _Fit | None]
) -> list[Measured]:
    found = {delay_s: fit for delay_s, fit in others.items() if fit is not None}
    if not found:
        return []
    before = information_by_squares(observations, own.T_camera_lidar)
    gains = {}
    for delay_s, fit in found.items():
        after = information_by_squares(delayed(observations, delay_s), fit.T_camera_lidar)
        gain = paired_gain(before, after)
        gains[delay_s] = gain.gain / max(gain.sigma, 1e-12)
    best_delay_s = max(gains, key=lambda delay_s: gains[delay_s])
    sentence = (
        f"the clocks look wrong, points and pictures agree better by {gains[best_delay_s]:.1f} standard errors if "
        f"pictures are {1e3 * abs(best_delay_s):.0f} ms {'later' if best_delay_s > 0.0 else 'earlier'} than "
        "image_stamp says"
    )
    return [WRONG_CLOCKS.measured(gains[best_delay_s], sentence)]


def _refitted(observations: Observations, T_camera_lidar: Pose) -> _Fit | None:
    """Refine a pose and score it by the agreement of the labels; None if it cannot be refined."""
    found = refine_exactly(observations, T_camera_lidar, OTHER_MODEL_EXACT, OTHER_MODEL_PYRAMID)
    if found is None:
        return None
    if observations.has_segments:
        return _fit(observations, found.T_camera_lidar)
    return _fit_of(found.T_camera_lidar, found.agreement)
