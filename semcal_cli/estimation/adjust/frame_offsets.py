"""Poses that some frames fit on their own, and the offset of each frame's own pose from the result.

Each frame is refined and polished on its own. One Newton step from the pose of all frames would be cheaper but
inaccurate: fine blocks of pixels do not sense borders that are farther away than their size. The refinement begins with
blocks of several degrees only where coarse blocks show that the frame's own pose is too far away for a near start.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from semcal_cli.config import ExactConfig, PolishConfig, PyramidConfig, SensitivityConfig
from semcal_cli.estimation.refine.polish import newton
from semcal_cli.estimation.refine.pyramid import pyramid_factors, refine_exactly
from semcal_cli.estimation.uncertainty.sensitivity import determined_sensitivity, sensitivity
from semcal_cli.geometry.arrays import Pose, Vectors
from semcal_cli.geometry.twists import camera_motions, local_coordinates
from semcal_cli.observations.observations import Observations
from semcal_cli.result.sections import DrivePart
from semcal_cli.result.uncertainty import Uncertainty
from semcal_cli.threads import thread_pool

FAR_PYRAMID = PyramidConfig(coarsest_block_deg=4.0)
"""Refinement pyramid for frames whose pose may be several degrees off."""
NEAR_PYRAMID = PyramidConfig()
"""Refinement pyramid for a frame whose own pose is near."""
FAR_BLOCKS = 0.5
"""Distance above which a frame's own pose is not near, in blocks twice as wide as the widest of `NEAR_PYRAMID`. On 20
frames of a clean drive, one Newton step put the pose of all frames 0.2 of these blocks off in the median, and at most
0.4 in nine of ten frames. From starts 0.1 degrees off it was 1.6 in the median, and from starts 0.5 to 3 degrees off,
from where these blocks hardly sense the borders, at least 4 in nine of ten."""
MAX_POINTS = 4_000
"""Number of points in the image of a frame that decide whether its own pose is near."""


@dataclass(frozen=True)
class Part:
    """Consecutive frames and the pose that they fit."""

    frames: range
    T_camera_lidar: Pose
    """(4, 4), metres."""
    uncertainty: Uncertainty
    """Uncertainty of the pose."""


def fit_part(
    observations: Observations, frames: range, T_start: Pose, pyramid: PyramidConfig = FAR_PYRAMID
) -> Part | None:
    """Refine and polish the pose of some frames; None if they do not determine one."""
    few = observations.of_frames(frames)
    refined = refine_exactly(few, T_start, ExactConfig(), pyramid)
    if refined is None:
        return None
    T = newton(few, refined.T_camera_lidar, PolishConfig()).T_camera_lidar
    around = determined_sensitivity(few, T, SensitivityConfig())
    if around is None:
        return None
    # Errors that the points of a class share move all parts alike, and parts are only compared with one another.
    noise = around.noise(around.influence)
    return Part(frames, T, Uncertainty.from_covariance(T, *noise))


@dataclass(frozen=True)
class FrameOffsets:
    """Offset of each of F frames, along and about the axes of the camera.

    The six columns are the camera's position x y z, in metres, and its turn about x y z, in degrees.
    """

    offsets: Vectors
    """(F, 6) offset of each frame's own pose; NaN if the labels of the frame do not determine one."""
    half_widths_95: Vectors
    """(F, 6) half widths of the 95 % interval of each offset."""
    of_parts: Vectors
    """(F, 6) offset of the pose that the part of each frame fits; zero if all frames fit one pose."""

    @property
    def is_determined(self) -> npt.NDArray[np.bool_]:
        """(F,) whether the labels of a frame determine its pose."""
        return np.asarray(np.isfinite(self.offsets).all(axis=1))

    @property
    def is_within(self) -> npt.NDArray[np.bool_]:
        """(F, 6) whether an interval contains the offset of the part."""
        return np.asarray(np.abs(self.offsets - self.of_parts) <= self.half_widths_95)


def frame_offsets(
    observations: Observations, T_camera_lidar: Pose, parts: Sequence[DrivePart] = ()
) -> FrameOffsets:
    """Find the pose of each frame on its own, and its offset from the pose of all.

    Args:
        observations: Labelled points and label images, without features.
        T_camera_lidar: (4, 4) pose of all frames, metres.
        parts: Parts of these frames that fit different poses, in order; none if all frames fit one pose.
    """
    observations, starts = observations.with_scenes, [T_camera_lidar] * observations.num_frames
    if parts:
        starts = [np.array(part.T_camera_lidar) for part in parts for _ in range(part.num_frames)]

    def fit(frame: int) -> Part | None:
        # Segments have no sharp maximum, so they climb the same blocks as in a calibration.
        is_near = not observations.has_partitions and _is_near(observations.of_frames([frame]), starts[frame])
        pyramid = NEAR_PYRAMID if is_near else FAR_PYRAMID
        return fit_part(observations, range(frame, frame + 1), starts[frame], pyramid)

    offsets, half_widths = np.full((2, len(starts), 6), np.nan)
    with thread_pool() as pool:
        parts_of_frames = list(pool.map(fit, range(len(starts))))
    for frame, fitted in enumerate(parts_of_frames):
        if fitted is not None:
            offsets[frame] = _offsets([fitted.T_camera_lidar], T_camera_lidar)[0]
            half_widths[frame] = fitted.uncertainty.half_widths
    of_parts = _offsets(starts, T_camera_lidar) if parts else np.zeros_like(offsets)
    return FrameOffsets(offsets, half_widths, of_parts)


def _is_near(observations: Observations, T_start: Pose) -> bool:
    """Whether Newton's method, on blocks that sense borders farther away, would take only a short step."""
    factor = 2 * pyramid_factors(observations.camera, NEAR_PYRAMID)[0]
    around = sensitivity(observations, T_start, SensitivityConfig(factor=factor, max_points=MAX_POINTS))
    if around is None or not around.is_determined:
        return False
    step = np.linalg.solve(around.curvature, around.scores.sum(axis=0))
    return float(step @ around.motions @ step) <= (FAR_BLOCKS * factor) ** 2


def _offsets(poses: Sequence[Pose], T_reference: Pose) -> Vectors:
    """Compute the offsets (N, 6) of the camera, in metres and degrees."""
    return camera_motions(local_coordinates(poses, T_reference))
