"""Whether the camera was moved during the drive.

Where the scores of frames show that there is not one pose, a change point is searched for along the drive (binary
segmentation: Scott and Knott, *A cluster analysis method for grouping means in the analysis of variance*, 1974): both
parts are refined and polished on their own, and must be farther apart than their intervals explain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli import core
from semcal_cli.checks.frames_disagree import FRAMES_DISAGREE, compare_frames, describe_disagreement
from semcal_cli.estimation.adjust.frame_offsets import Part, fit_part
from semcal_cli.estimation.uncertainty.information import (
    compared_by,
    information_by_frame,
    pointwise_information,
)
from semcal_cli.estimation.uncertainty.quantiles import hotelling_quantile
from semcal_cli.findings.check import Check, Measured
from semcal_cli.findings.entry import Entry, PageSection
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.twists import camera_motions, local_coordinates
from semcal_cli.observations.frame_naming import frame_name
from semcal_cli.observations.observations import Observations
from semcal_cli.result.sections import DrivePart, Movement

MOVED_CAMERA = Check(
    topic="moved-camera",
    explains=frozenset({"frames-disagree"}),
    advice="calibrate the frames of each part as a drive of their own, or record again",
    entry=Entry(
        title="The camera was moved",
        section=PageSection.FILES,
        quotes=(
            (
                "frames 000005 to 000009 fit a camera turned by 1.01 +- 0.06 degrees about (0.34 -0.89 "
                "-0.29), as if it had been knocked at 000005: calibrate the frames of each part as a "
                "drive of their own, or record again"
            ),
        ),
        meaning="The camera has at least two poses in this drive, one before and one after this frame.",
        cause=(
            "Somebody knocked or adjusted a sensor, or two drives were merged. Sweeps and images that are paired a "
            "frame off look alike where the speed differs between the parts."
        ),
        remedy=(
            "Write a `drive.yaml` for the frames of each part, and calibrate each: "
            "[calibrating.md](calibrating.md#a-camera-that-was-knocked)."
        ),
        figure=(
            "Probability that two parts of the drive lie this far apart by chance. The check needs "
            "two frames."
        ),
    ),
)
MAX_PARTS = 4
"""Largest number of parts of a drive."""


class FrameCheck(NamedTuple):
    """Result of comparing the frames: what was measured, and the parts of the drive if the camera was moved."""

    measured: tuple[Measured, ...] = ()
    parts: tuple[DrivePart, ...] = ()
    """At least two parts; empty if no movement was found."""


def check_frames(observations: Observations, T_camera_lidar: Pose, names: Sequence[str]) -> FrameCheck:
    """Check that all frames fit one pose.

    Args:
        observations: Labelled points and label images.
        T_camera_lidar: (4, 4) pose of all frames, metres.
        names: Name of each frame: its point cloud.
    """
    suspicion = compare_frames(observations, T_camera_lidar)
    if suspicion is None:
        return FrameCheck()
    # The scatter is given as a multiple of its limit by chance; whether it is a finding also depends on the parts.
    by, share = compared_by(observations), suspicion.scatter / suspicion.allowed
    scatter = FRAMES_DISAGREE.measured(share * FRAMES_DISAGREE.limit(by), limit=by)
    if not suspicion.is_grave:
        return FrameCheck((scatter,))
    parts, whole = list[Part](), range(observations.num_frames)
    if suspicion.place is not None:
        parts = _split(observations, whole, T_camera_lidar, suspicion.place, MAX_PARTS)
    if len(parts) > 1 and all(_is_one(observations, part) for part in parts):
        described = tuple(
            DrivePart(
                first_frame=names[part.frames[0]],
                last_frame=names[part.frames[-1]],
                num_frames=len(part.frames),
                T_camera_lidar=part.T_camera_lidar.tolist(),
                moved=None if before is None else _movement(before, part),
            )
            for before, part in zip((None, *parts), parts, strict=False)
        )
        moved = MOVED_CAMERA.without_value(_moved_sentence(parts, described, names))
        return FrameCheck((scatter, moved), described)
    return FrameCheck((scatter, FRAMES_DISAGREE.without_value(describe_disagreement(suspicion, names))))


def _is_one(observations: Observations, part: Part) -> bool:
    suspicion = compare_frames(observations.of_frames(part.frames), part.T_camera_lidar)
    return suspicion is None or suspicion.scatter <= suspicion.allowed


def _split(
    observations: Observations, frames: range, T_start: Pose, place: int, num_parts: int
) -> list[Part]:
    """Split frames where they fit two poses, and each part again; no parts where they do not."""
    all_parts: list[Part] = []
    parts = _two_parts(observations, frames, T_start, place)
    for later, part in zip((1, 0), parts, strict=False):
        # One part is reserved for each of those that follow.
        max_smaller, suspicion = num_parts - later - len(all_parts), None
        if max_smaller > 1:
            suspicion = compare_frames(observations.of_frames(part.frames), part.T_camera_lidar)
        smaller = []
        if suspicion is not None and suspicion.place is not None:
            smaller = _split(observations, part.frames, part.T_camera_lidar, suspicion.place, max_smaller)
        all_parts += smaller or [part]
    return all_parts


def _two_parts(observations: Observations, frames: range, T_start: Pose, place: int) -> tuple[Part, ...]:
    """Fit both sides of a change; no parts if their poses are no farther apart than chance explains."""

    def fit_both(place: int, T_before: Pose, T_after: Pose) -> tuple[Part, Part] | None:
        before = fit_part(observations, frames[:place], T_before)
        after = fit_part(observations, frames[place:], T_after)
        return None if before is None or after is None else (before, after)

    pair = fit_both(place, T_start, T_start)
    if pair is None:
        return ()
    poses = pair[0].T_camera_lidar, pair[1].T_camera_lidar
    better_place = _best_place(observations.of_frames(frames), *poses)
    if better_place != place:
        pair = fit_both(better_place, *poses)
    if pair is None:
        return ()
    offset, covariance, dof = _offset(*pair)
    apart = float(offset @ np.linalg.solve(covariance, offset))
    return pair if apart > hotelling_quantile(MOVED_CAMERA.limit("chance"), dof) else ()


def _best_place(observations: Observations, T_before: Pose, T_after: Pose) -> int:
    """Find after how many frames the pose of the second part explains the labels better than that of the first."""
    before, after = (core.agreement(observations.core, T).frame_joints for T in (T_before, T_after))
    table = pointwise_information((before + after).sum(axis=0))
    gains = information_by_frame(before, table) - information_by_frame(after, table)
    # The sum of the gains before the place, less the sum after it, is largest at the change.
    return int(np.argmax(np.cumsum(gains)[:-1])) + 1


def _offset(before: Part, after: Part) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], float]:
    """Local coordinates (6,) of a part about the one before, their covariance (6, 6), and degrees of freedom."""
    (offset,) = local_coordinates([after.T_camera_lidar], before.T_camera_lidar)
    covariance = np.array(before.uncertainty.covariance) + np.array(after.uncertainty.covariance)
    dof = np.add(before.uncertainty.degrees_of_freedom, after.uncertainty.degrees_of_freedom)
    return offset, covariance, float(dof.mean())


def _movement(before: Part, after: Part) -> Movement:
    offset, covariance, dof = _offset(before, after)
    half_widths = math.sqrt(hotelling_quantile(0.05, dof)) * np.sqrt(np.diag(covariance))
    (motion,) = camera_motions(offset[None])
    return Movement(
        camera_center_m=motion[:3].tolist(),
        rotation_deg=motion[3:].tolist(),
        half_width_95_camera_center_m=half_widths[:3].tolist(),
        half_width_95_rotation_deg=np.degrees(half_widths[3:]).tolist(),
    )


def _moved_sentence(parts: Sequence[Part], described: Sequence[DrivePart], names: Sequence[str]) -> str:
    """Describe which frames fit which camera, and where it may have been knocked."""
    sentences = []
    for part, document in zip(parts[1:], described[1:], strict=True):
        assert document.moved is not None
        first, last = frame_name(names, part.frames[0]), frame_name(names, part.frames[-1])
        stretch = f"frame {first} alone would" if len(part.frames) == 1 else f"frames {first} to {last}"
        sentences.append(
            f"{stretch} fit a camera {document.moved.words}, as if it had been knocked at {first}"
        )
    return "; ".join(sentences)
