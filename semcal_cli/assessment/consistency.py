"""What speaks against a pose: sentences, each with its figure. None is no proof that the pose is right."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.assessment.uncertainty import influences_of, is_determined, sandwich
from semcal_cli.config import ExactConfig, PyramidConfig, SensitivityConfig
from semcal_cli.drive.camera import core_camera
from semcal_cli.drive.classes import NO_CLASS
from semcal_cli.drive.frame_selection import evenly_spaced
from semcal_cli.drive.observations import LabelledCloud, Observations
from semcal_cli.errors import SemcalError
from semcal_cli.geometry.poses import Pose
from semcal_cli.refinement.exact import ExactEstimator
from semcal_cli.refinement.pyramid import refine
from semcal_cli.result.stage import Finding

NUM_FRAMES = 4
"""So many frames are looked at."""
MAX_EXCHANGED = 0.55
"""With pictures of other frames, labels may share no more than this of what they share with their own. On eight
development drives of five rigs with 5 and 20 frames it was at most 0.36, with clouds paired with another drive's
pictures or with shuffled labels at least 0.56."""
MIN_CLASSES = 1.2
"""So many equally frequent classes have to be on either side, by their entropy. Streets have 4 to 9, one thing in
twenty on a plain ground is 1.22, one class but for one label in a hundred 1.06."""
MAX_ALIKE = 0.8
"""Pictures that are the same in so many pixels say nothing when they are exchanged."""
MAX_TURNED = 0.65
"""With the camera turned to other azimuths, likewise: at most 0.55 on these drives, at least 0.71 with another drive's
pictures."""
TURN_DEG = 30.0
OTHER_MODEL_EXACT = ExactConfig(batch_size=1024, max_points=50_000)
OTHER_MODEL_PYRAMID = PyramidConfig(coarsest_block_deg=1.0)
"""The pose is refined so with other focal lengths and delays."""
FOCAL_CHANGE = 0.07
"""With the focal length changed by this share, either way, labels agree less than with the right one. On 34 single
frames and pairs of development drives of six rigs they did, without exception; with K wrong by 10 %, in 70 of 71
calibrations, they agreed more with it changed the right way."""
CLOCK_DELAYS_S = (-0.05, -0.015, 0.015, 0.05)
MIN_CLOCK_GAIN = 0.2
"""With pictures so much later or earlier, labels agree better by no more than so many standard errors. On a small
drive, at one steady speed, it was at most 0.04."""
INTRINSICS = ("fx", "fy", "cx", "cy", "k1")
AROUND_INTRINSICS = SensitivityConfig(factor=4, edge_band_px=0, max_points=150_000, with_intrinsics=True)
"""Wrong intrinsics show in blocks of this many pixels: errors are larger than one."""
MAX_INTRINSICS_CHI2 = 12.83
"""Of five degrees of freedom: one right camera in 40 is beyond, and most of those for less than the next figure. On 45
calibrations of six development drives it was at most 8 where that was exceeded, with K wrong by 10 % at least 16."""
MAX_INTRINSICS_PX = 5.0
"""And freeing them has to move the points by more than this, so that what little is wrong with any camera is let be."""


def check_consistency(observations: Observations, T_camera_lidar: Pose) -> tuple[Finding, ...]:
    """Say what speaks against a pose: its labels, its surroundings, the camera's intrinsics, the clocks.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4), refined.
    """
    few = observations.of_frames(evenly_spaced(range(observations.num_frames), NUM_FRAMES))
    sentences = [
        *_too_few_classes(few, T_camera_lidar),
        *_wrong_pairing(few, T_camera_lidar),
        *_wrong_azimuth(few, T_camera_lidar),
        *_wrong_model(few, T_camera_lidar),
        *_wrong_intrinsics(observations, T_camera_lidar),
    ]
    return tuple(map(Finding, sentences))


def _information(observations: Observations, T_camera_lidar: Pose) -> float:
    return _corrected(_core.agreement(observations.core, T_camera_lidar))


def _corrected(agreement: _core.Agreement) -> float:
    """Mutual information less its bias, nats."""
    return agreement.mutual_information - agreement.bias


def _too_few_classes(observations: Observations, T_camera_lidar: Pose) -> list[str]:
    """Count the classes of the points in the picture and of its pixels, the rarer the less."""
    camera = core_camera(observations.camera)
    inside = [
        cloud.classes[np.isfinite(_core.project_points(camera, cloud.points, T_camera_lidar).ranges)]
        for cloud in observations.clouds
    ]
    pixels = [image.classes.ravel() for image in observations.images]
    sides = {"points in the picture": inside, "pixels": pixels}
    return [line for name, ids in sides.items() for line in _too_few_on_side(name, ids)]


def _too_few_on_side(name: str, ids: Sequence[npt.NDArray[np.uint8]]) -> list[str]:
    counts = np.sum([np.bincount(each, minlength=NO_CLASS + 1) for each in ids], axis=0)[:NO_CLASS]
    if not counts.any():
        return [f"{name}: none is labelled"]
    shares = counts[counts > 0] / counts.sum()
    # The number of equally frequent classes that would have the same entropy.
    effective = float(np.exp(-np.sum(shares * np.log(shares))))
    if effective >= MIN_CLASSES:
        return []
    return [
        f"{name} are nearly all of one class: as if of {effective:.2f} equally frequent ones, needed at least "
        f"{MIN_CLASSES:g}"
    ]


def _wrong_pairing(observations: Observations, T_camera_lidar: Pose) -> list[str]:
    """Pair clouds with the pictures of other frames."""
    own = _information(observations, T_camera_lidar)
    images, found = [image.without_shares() for image in observations.images], []
    for shift in range(1, observations.num_frames):
        others = images[shift:] + images[:shift]
        alike = np.mean([np.mean(a.classes == b.classes) for a, b in zip(images, others, strict=True)])
        if alike <= MAX_ALIKE:
            found.append(_information(observations.with_images(others), T_camera_lidar))
    if not found or max(found) <= MAX_EXCHANGED * own:
        return []
    return [
        f"pictures of other frames fit the clouds {_as_well(max(found), own)}: {max(found):.2f} of {own:.2f} nats, "
        f"needed at most {MAX_EXCHANGED:.0%}: sweeps and pictures may not belong together"
    ]


def _wrong_azimuth(observations: Observations, T_camera_lidar: Pose) -> list[str]:
    """Turn the camera about the LiDAR's z axis, where there is something to see."""
    answer = _core.agreement(observations.core, T_camera_lidar)
    own = _corrected(answer)
    best, best_deg = 0.0, 0.0
    for turn_deg in np.arange(TURN_DEG, 360.0, TURN_DEG).tolist():
        turned = _core.agreement(observations.core, T_camera_lidar @ _about_z(turn_deg))
        information = _corrected(turned)
        if turned.overlap >= 0.5 * answer.overlap and information > best:
            best, best_deg = information, turn_deg
    if best <= MAX_TURNED * own:
        return []
    return [
        f"with the camera turned by {best_deg:.0f} degrees labels fit {_as_well(best, own)}: {best:.2f} of {own:.2f} "
        f"nats, needed at most {MAX_TURNED:.0%}"
    ]


def _as_well(other: float, own: float) -> str:
    return "almost as well" if other < own else "as well or better"


def _about_z(angle_deg: float) -> Pose:
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    T = np.eye(4)
    T[:2, :2] = [[c, -s], [s, c]]
    return T


def _wrong_model(observations: Observations, T_camera_lidar: Pose) -> list[str]:
    """Refine once more with other focal lengths and clocks, and as they are: all on the same frames, by the same steps.

    Focal lengths hardly bend the optimum, but even single frames tell them apart so.
    """
    changes = (-FOCAL_CHANGE, FOCAL_CHANGE)
    delays_s = CLOCK_DELAYS_S if _tells_clocks(observations) else ()
    models = [
        observations,
        *(replace(observations, camera=observations.camera.zoomed(1.0 + change)) for change in changes),
        *(_delayed(observations, delay_s) for delay_s in delays_s),
    ]
    # Each refinement is a chain of small steps, so several run side by side.
    with ThreadPoolExecutor() as pool:
        own, *others = pool.map(lambda model: _refitted(model, T_camera_lidar), models)
    if own is None:
        return []
    zoomed, delayed = others[: len(changes)], others[len(changes) :]
    return [
        *_wrong_focal_length(own, dict(zip(changes, zoomed, strict=True))),
        *_wrong_clocks(own, dict(zip(delays_s, delayed, strict=True))),
    ]


def _wrong_focal_length(own: _core.Agreement, others: Mapping[float, _core.Agreement | None]) -> list[str]:
    best, best_change = _corrected(own), 0.0
    for change, found in others.items():
        if found is not None and _corrected(found) > best:
            best, best_change = _corrected(found), change
    if best_change == 0.0:
        return []
    return [
        f"the focal length looks wrong: labels agree better with fx and fy {abs(best_change):.0%} "
        f"{'longer' if best_change > 0.0 else 'shorter'}, {best:.4f} against {_corrected(own):.4f} nats"
    ]


def _tells_clocks(observations: Observations) -> bool:
    """Whether frames move differently: at one steady motion another moment is no other than a camera elsewhere."""
    twists = _twists_per_s(observations)
    return bool(twists) and bool(np.ptp(twists, axis=0).any())


def _twists_per_s(observations: Observations) -> list[Sequence[float]]:
    """How the LiDAR moves, (6,) of each frame; empty if not known."""
    return [frame.twist_per_s for frame in observations.frames if frame.twist_per_s is not None]


def _wrong_clocks(own: _core.Agreement, others: Mapping[float, _core.Agreement | None]) -> list[str]:
    best, best_delay_s = MIN_CLOCK_GAIN, 0.0
    for delay_s, found in others.items():
        if found is not None:
            gain = (_corrected(found) - _corrected(own)) / max(math.hypot(own.sigma, found.sigma), 1e-12)
            if gain > best:
                best, best_delay_s = gain, delay_s
    if best_delay_s == 0.0:
        return []
    return [
        f"the clocks look wrong: labels agree better, by {best:.1f} standard errors, if pictures are "
        f"{1e3 * abs(best_delay_s):.0f} ms {'later' if best_delay_s > 0.0 else 'earlier'} than image_stamp says"
    ]


def _refitted(observations: Observations, T_camera_lidar: Pose) -> _core.Agreement | None:
    """How well labels agree where the pose goes; None if it cannot."""
    try:
        found = refine(
            observations,
            T_camera_lidar,
            ExactEstimator(observations, OTHER_MODEL_EXACT, seed=0),
            OTHER_MODEL_PYRAMID,
        )
    except SemcalError:
        return None  # The lens reaches no farther, or nothing is left in the picture.
    return _core.agreement(observations.core, found.T_camera_lidar)


def _delayed(observations: Observations, delay_s: float) -> Observations:
    """Sweeps as the LiDAR would have seen them later, if it goes on as it does."""
    clouds = zip(observations.clouds, _twists_per_s(observations), strict=True)
    return observations.with_clouds(_at_constant_twist(cloud, twist, delay_s) for cloud, twist in clouds)


def _at_constant_twist(cloud: LabelledCloud, twist_per_s: Sequence[float], delay_s: float) -> LabelledCloud:
    along = _core.Trajectory.constant(twist_per_s, 0.0)
    return cloud.with_points(along.compensate(cloud.points, np.zeros(cloud.num_points), delay_s))


def _wrong_intrinsics(observations: Observations, T_camera_lidar: Pose) -> list[str]:
    """Free fx, fy, cx, cy and k1 beside the pose: a step of Newton's method, and whether it is more than chance."""
    around = _core.sensitivity(observations.core, T_camera_lidar, AROUND_INTRINSICS)
    if around is None:
        return []
    pose = _core.Sensitivity(around.curvature[:6, :6], around.scores[:, :6], around.motions[:6, :6])
    if not is_determined(pose):
        return []
    step = influences_of(around).sum(axis=0)
    covariance, _ = sandwich(around, observations.num_frames)
    chi2 = float(step[6:] @ np.linalg.solve(covariance[6:, 6:], step[6:]))
    moved = step.copy()
    moved[:6] -= influences_of(pose).sum(axis=0)
    moved_px = float(np.sqrt(moved @ around.motions @ moved))
    if chi2 <= MAX_INTRINSICS_CHI2 or moved_px <= MAX_INTRINSICS_PX:
        return []
    z = step[6:] / np.sqrt(np.diag(covariance)[6:])
    named = [
        f"{name} by {abs(each):.1f}" for name, each in zip(INTRINSICS, z, strict=True) if abs(each) > 2.0
    ]
    which = f" ({', '.join(named)} standard errors)" if named else ""
    return [
        f"the intrinsics look wrong{which}: freed, they would move the points by {moved_px:.0f} pixels, chi-square "
        f"{chi2:.0f} of 5, needed at most {MAX_INTRINSICS_CHI2:.0f}"
    ]
