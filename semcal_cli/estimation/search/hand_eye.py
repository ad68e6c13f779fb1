"""Hand-eye calibration: the rotation of the mounting from the motion of camera and LiDAR, without labels.

With A the camera's displacement between two images, B the LiDAR's, and X = T_camera_lidar, A X = X B (Park and Martin,
*Robot sensor calibration: solving AX = XB on the Euclidean group*, 1994). A camera does not measure lengths, so with
the camera at c in the LiDAR frame

    R_A R = R R_B                                 rotations
    t_A / |t_A| along R (t_B + (R_B - I) c)       translations

A car turns only about its vertical axis, and such turns leave the rotation about that axis undetermined. Translations
determine it, but not the rotation about their own direction: both are needed. The camera's position c changes the
translations in turns, so it is estimated together with R, and its uncertainty is part of the interval.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frames import Frame
from semcal_cli.geometry.arrays import Matrix, Pose, Vector
from semcal_cli.geometry.poses import cross_matrix, rotation_difference
from semcal_cli.geometry.twists import rotation_matrix
from semcal_cli.observations.motion import displacements

MAX_GAP_S = 0.75
"""Longest time between two images of a pair. After more, a car has passed what its camera saw."""
MIN_TURN_DEG, MIN_DISTANCE_M = 5.0, 2.5
"""Rotation or distance at which a pair ends: longer pairs lose matches."""
STANDING_M, STANDING_DEG = 0.1, 0.1
"""Distance and rotation below which the rig stands still, and a pair carries no information."""
MAX_PAIRS = 60
"""Largest number of pairs that are used, two images each."""
MIN_PAIRS = 6
"""Smallest number of pairs whose scatter gives an interval."""
TURN_SIGMA, DIRECTION_SIGMA, PLACE_SIGMA_M = math.radians(0.05), math.radians(0.2), 0.02
"""Smallest standard deviations of a pair: of its rotation, of the direction of its translation, and of the LiDAR's
position, which changes the direction of short translations."""
CAMERA_SIGMA_M = 1.0
"""Prior standard deviation of the camera's position relative to the LiDAR, along each axis."""
MAX_HALF_WIDTH_DEG = 2.0
"""Largest half width of the 95 % interval about any axis; a wider rotation is not determined. Edges converge from 5
degrees."""
ROUNDS = 30
SETTLED = 1e-12
"""Largest component of the last step, radians and metres."""
MEDIAN_CHI2 = 4.351
"""Median of chi squared with the five degrees of freedom of a pair."""

NO_MOTION = "the drive gives no motion, expected motion.poses or motion.twist: `semcal odometry` writes them"
NO_IMAGES = "the drive gives no images, expected images of consecutive frames"
NO_PAIRS = (
    f"no frames are consecutive, expected images at most {MAX_GAP_S} s apart: `import bag --every` keeps those of a "
    "recording"
)


class Pair(NamedTuple):
    """How camera and LiDAR moved between two images."""

    R_A: Matrix
    """(3, 3) rotation of the second camera in the frame of the first."""
    direction: Vector
    """(3,) unit vector from the first camera to the second."""
    across: Matrix
    """(2, 3) unit vectors perpendicular to that direction."""
    covariance: Matrix
    """(5, 5) of a rotation vector on the left of `R_A`, radians, and of the direction along `across`."""
    T_B: Pose
    """(4, 4) pose of the second LiDAR in the frame of the first, metres."""


class HandEye(NamedTuple):
    """A rotation of the mounting that motion determines, and its interval."""

    T_camera_lidar: Pose
    """(4, 4) rotation, and the position of the camera as far as rotations determine it, metres."""
    covariance: Matrix
    """(6, 6) of a rotation vector on the left of T_camera_lidar, radians, and of the camera's position, metres, LiDAR
    frame."""
    num_pairs: int
    turn_deg: float
    """Sum of the rotations of all pairs."""

    @property
    def half_width_deg(self) -> float:
        """Half width of the 95 % interval about the least certain axis, degrees."""
        return half_width_deg(self.covariance, self.num_pairs)

    @property
    def sentence(self) -> str:
        """Describe how well the rotation is known, and from what."""
        return (
            f"the motion of camera and LiDAR gives the rotation to +- {self.half_width_deg:.2f} degrees (95 %), from "
            f"{self.num_pairs} pairs of images that turn by {self.turn_deg:.0f} degrees in all"
        )

    @property
    def record(self) -> dict[str, object]:
        """The part of it that a result records."""
        return {
            "T_camera_lidar": self.T_camera_lidar.tolist(),
            "half_width_95_deg": self.half_width_deg,
            "num_pairs": self.num_pairs,
        }


class NotDetermined(NamedTuple):
    """Why motion does not determine the rotation, and what is needed."""

    why: str
    is_unsuited: bool = False
    """Whether the drive has no motion or no consecutive images at all."""


def hand_eye(drive: Drive) -> HandEye | NotDetermined:
    """Find the rotation of the mounting by motion, from all consecutive frames of a drive.

    Images are read only if the LiDAR's motion can determine the rotation.

    Raises:
        InputError: an image or the file of the poses is missing or wrong, or a frame with an image has no stamps.
    """
    if drive.motion is None or drive.motion.speed_m_s is not None:
        return NotDetermined(NO_MOTION, is_unsuited=True)
    if all(frame.image is None for frame in drive.frames):
        return NotDetermined(NO_IMAGES, is_unsuited=True)
    pairs = choose_pairs(drive)
    if not pairs:
        return NotDetermined(NO_PAIRS, is_unsuited=True)
    if (missing := _missing([T for _, T in pairs])) is not None:
        return NotDetermined(missing)
    from semcal_cli.estimation.search.visual_motion import camera_motions

    usable_pairs = []
    for motion, (_, T_B) in zip(camera_motions(drive, [frames for frames, _ in pairs]), pairs, strict=True):
        if motion is not None:
            covariance = np.linalg.inv(motion.information) + _min_covariance(T_B)
            usable_pairs.append(Pair(motion.R, motion.direction, motion.across, covariance, T_B))
    if len(usable_pairs) < MIN_PAIRS:
        matched = f"features match in {len(usable_pairs)} of {len(pairs)} pairs of images"
        return NotDetermined(f"{matched}, needed {MIN_PAIRS}: give sharp consecutive images")
    solution = solve(usable_pairs)
    if solution.half_width_deg > MAX_HALF_WIDTH_DEG:
        return NotDetermined(
            f"{solution.num_pairs} pairs of images determine the rotation only to +- {solution.half_width_deg:.1f} "
            f"degrees, needed at most {MAX_HALF_WIDTH_DEG:g}: record more turns, and straight driving as well"
        )
    return solution


def choose_pairs(drive: Drive) -> list[tuple[tuple[Frame, Frame], Pose]]:
    """Choose pairs of consecutive frames, with the LiDAR's motion (4, 4) from the one to the other.

    A pair ends when the rig has turned or moved far enough, or before the next image would be too late; the next pair
    begins there. Of many pairs, those with the largest rotations and those with the longest translations are kept.
    """
    stamped = [frame for frame in drive.frames if frame.image is not None and frame.image_stamp is not None]
    frames = sorted(stamped, key=lambda frame: frame.image_stamp or 0.0)
    stamps = [frame.image_stamp or 0.0 for frame in frames]
    steps = [
        (first, second)
        for first in range(len(frames))
        for second in range(first + 1, len(frames))
        if 0.0 < stamps[second] - stamps[first] <= MAX_GAP_S
    ]
    motions = displacements(drive, [(frames[first], frames[second]) for first, second in steps])
    moved = {step: T for step, T in zip(steps, motions, strict=True) if T is not None}
    pairs, first = list[tuple[tuple[Frame, Frame], Pose]](), 0
    while first < len(frames):
        ends = [second for second in range(first + 1, len(frames)) if (first, second) in moved]
        far = (second for second in ends if _is_enough(moved[first, second]))
        end = next(far, ends[-1] if ends else None)
        if end is not None and _moves(T := moved[first, end]):
            pairs.append(((frames[first], frames[end]), T))
        first = first + 1 if end is None else end
    by_turn = sorted(pairs, key=lambda pair: -_turn(pair[1]))
    turning, others = by_turn[: MAX_PAIRS // 2], by_turn[MAX_PAIRS // 2 :]
    return turning + sorted(others, key=lambda pair: -_distance_m(pair[1]))[: MAX_PAIRS - len(turning)]


def solve(pairs: Sequence[Pair]) -> HandEye:
    """Find the rotation and the position of the camera at which the motions of all pairs agree, by least squares.

    Pairs that agree badly, for example beside a moving lorry, weigh less (Cauchy). If the scatter of all pairs is
    larger than their known errors, it widens the interval.

    Raises:
        ValueError: there are no pairs.
    """
    R, c, scale = _start(pairs), np.zeros(3), 1.0
    prior = np.diag([0.0] * 3 + [CAMERA_SIGMA_M**-2] * 3)
    weights = [np.linalg.inv(pair.covariance) for pair in pairs]
    for _ in range(ROUNDS):
        fits = [_fit(pair, R, c) for pair in pairs]
        distances = np.array([e @ W @ e for (e, _), W in zip(fits, weights, strict=True)])
        scale = max(1.0, float(np.median(distances)) / MEDIAN_CHI2)
        robust = 1.0 / (1.0 + distances / (5.0 * scale)) / scale
        H, g = prior.copy(), prior @ np.concatenate([np.zeros(3), c])
        for (e, J), W, w in zip(fits, weights, robust, strict=True):
            H += w * J.T @ W @ J
            g += w * J.T @ W @ e
        step = -np.linalg.lstsq(H, g, rcond=None)[0]
        R, c = rotation_matrix(step[:3]) @ R, c + step[3:]
        if np.abs(step).max() < SETTLED:
            break
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, -R @ c
    turn_deg = math.degrees(sum(_turn(pair.T_B) for pair in pairs))
    return HandEye(T, _inverse(H), len(pairs), turn_deg)


def rotation_between(to: Matrix, source: Matrix, weights: npt.NDArray[np.float64]) -> Matrix:
    """Find the rotation R (3, 3) that takes vectors (N, 3) to others, to_i = R source_i, by Kabsch's closed form."""
    U, _, Vt = np.linalg.svd((to * weights[:, None]).T @ source)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)]) @ Vt)


def half_width_deg(covariance: Matrix, num_pairs: int) -> float:
    """Compute the half width of the 95 % interval about the least certain axis, degrees; infinite if one is open."""
    quantile = core.student_quantile(0.975, max(num_pairs - 2, 1))
    widest = float(np.linalg.eigvalsh(covariance[:3, :3])[-1]) if np.isfinite(covariance).all() else math.inf
    return math.degrees(quantile * math.sqrt(widest))


def _start(pairs: Sequence[Pair]) -> Matrix:
    """Find the rotation in closed form (Wahba), without the camera's position, from rotations and translations."""
    to, source, sigmas = [], [], []
    for pair in pairs:
        T, distance_m, turn = pair.T_B, _distance_m(pair.T_B), _turn(pair.T_B)
        to.append(rotation_difference(_posed(pair.R_A), np.eye(4)))
        source.append(rotation_difference(T, np.eye(4)))
        sigmas.append(math.sqrt(float(np.trace(pair.covariance[:3, :3])) / 3.0))
        to.append(pair.direction)
        source.append(T[:3, 3] / max(distance_m, STANDING_M))
        place_sigma = turn * CAMERA_SIGMA_M / max(distance_m, STANDING_M)
        sigmas.append(math.sqrt(float(np.trace(pair.covariance[3:, 3:])) / 2.0 + place_sigma**2))
    a, b, inverse_variances = np.array(to), np.array(source), np.array(sigmas) ** -2.0
    weights = inverse_variances
    for _ in range(ROUNDS):
        R = rotation_between(a, b, weights)
        distances = ((a - b @ R.T) ** 2).sum(1) * inverse_variances
        weights = inverse_variances / (1.0 + distances / max(float(np.median(distances)), 1.0))
    return R


def _fit(pair: Pair, R: Matrix, c: Vector) -> tuple[Vector, Matrix]:
    """Compute the errors (5,) of a pair's rotation and direction, and their gradients (5, 6) by R and c."""
    R_B, t_B = pair.T_B[:3, :3], pair.T_B[:3, 3]
    rotation = R @ R_B @ R.T
    turn_error = rotation_difference(_posed(rotation), _posed(pair.R_A))
    translation = R @ (t_B + (R_B - np.eye(3)) @ c)
    length = max(float(np.linalg.norm(translation)), 1e-9)
    along = translation / length
    sideways = pair.across @ along
    # The angle between them rather than its sine, which vanishes for opposite directions.
    sine = float(np.linalg.norm(sideways))
    stretch = math.atan2(sine, float(along @ pair.direction)) / sine if sine > 0.0 else 1.0
    J = np.zeros((5, 6))
    J[:3, :3] = np.eye(3) - rotation
    J[3:, :3] = -pair.across @ cross_matrix(along)
    J[3:, 3:] = pair.across @ (np.eye(3) - np.outer(along, along)) @ R @ (R_B - np.eye(3)) / length
    return np.concatenate([turn_error, stretch * sideways]), J


def _missing(motions: Sequence[Pose]) -> str | None:
    """Describe what LiDAR motions (4, 4) lack to determine the rotation, however well a camera sees them."""
    turn_deg = math.degrees(sum(map(_turn, motions)))
    if len(motions) < MIN_PAIRS:
        return f"{len(motions)} pairs of consecutive images are in motion, needed {MIN_PAIRS}"
    H = np.diag([0.0] * 3 + [CAMERA_SIGMA_M**-2] * 3)
    for T in motions:
        exact = Pair(T[:3, :3], T[:3, 3], _across_of(T), _min_covariance(T), T)
        _, J = _fit(exact, np.eye(3), np.zeros(3))
        H += J.T @ np.linalg.inv(exact.covariance) @ J
    if half_width_deg(_inverse(H), len(motions)) <= MAX_HALF_WIDTH_DEG:
        return None
    return (
        f"the drive has too few turns, {turn_deg:.1f} degrees in {len(motions)} pairs of images: straight driving "
        "does not determine the rotation about its direction"
    )


def _min_covariance(T: Pose) -> Matrix:
    direction_variance = DIRECTION_SIGMA**2 + (PLACE_SIGMA_M / max(_distance_m(T), 1e-3)) ** 2
    return np.diag([TURN_SIGMA**2] * 3 + [direction_variance] * 2)


def _across_of(T: Pose) -> Matrix:
    translation = T[:3, 3] if _distance_m(T) > 0.0 else np.eye(3)[0]
    return np.linalg.svd(translation[None])[2][1:]


def _inverse(H: Matrix) -> Matrix:
    """Invert an information matrix; infinite if it leaves a direction undetermined."""
    values, axes = np.linalg.eigh(H)
    if values[0] <= 1e-9 * values[-1]:
        return np.full_like(H, math.inf)
    return np.asarray(axes / values @ axes.T)


def _posed(R: Matrix) -> Pose:
    T = np.eye(4)
    T[:3, :3] = R
    return T


def _turn(T: Pose) -> float:
    return float(np.linalg.norm(rotation_difference(T, np.eye(4))))


def _distance_m(T: Pose) -> float:
    return float(np.linalg.norm(T[:3, 3]))


def _is_enough(T: Pose) -> bool:
    return math.degrees(_turn(T)) >= MIN_TURN_DEG or _distance_m(T) >= MIN_DISTANCE_M


def _moves(T: Pose) -> bool:
    return math.degrees(_turn(T)) >= STANDING_DEG or _distance_m(T) >= STANDING_M
