"""What a fleet of drives says of one rig: where the camera is, who disagrees, whether something moved, and a verdict.

A rig stays as it is, changes now and then, or drifts; which of the three explains the drives best is told by the
Bayesian information criterion. Every drive is compared with what holds at its time, and the last is what holds now.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from semcal_cli import _core
from semcal_cli.assessment.limits import Check, Verdict, joint_quantile, judge, together
from semcal_cli.config import Limits
from semcal_cli.errors import CalibrationError
from semcal_cli.files.messages import listed
from semcal_cli.fleet.changes import Drift, change_points, drift, misfit
from semcal_cli.fleet.consensus import (
    Matrices,
    Vectors,
    extra_scatter,
    robust_mean,
)
from semcal_cli.fleet.members import Member
from semcal_cli.geometry.poses import Pose
from semcal_cli.geometry.twists import local_coordinates, pose_at

ALPHA = 0.01
"""A fleet that agrees has a drive that is said to disagree no more often than this (Bonferroni)."""
MIN_DRIVES = 3
"""Fewer do not tell how they scatter."""
MIN_USED = 0.5
"""Share of the drives; of a fleet that mostly could not be calibrated the rest says little."""
MIN_DRIFT_DRIVES = 6
"""Fewer do not tell a line from chance."""
MAX_NAMED = 8
"""Of the changes, in one sentence."""
DAY_S = 86_400.0
EPOCH_S = 1e9
"""Stamps of drives compare if they are seconds since 1970, which now are more than this; others begin anywhere."""

Order: TypeAlias = Literal["stamp", "name"]


@dataclass(frozen=True)
class Offset:
    """How far a transform is from another, along and about the axes of the other's camera."""

    center_m: npt.NDArray[np.float64]
    """(3,) of the camera's place."""
    rotation_deg: npt.NDArray[np.float64]
    """(3,)"""
    half_widths: npt.NDArray[np.float64]
    """(6,) of the 95 % intervals, metres and degrees."""

    @property
    def words(self) -> str:
        """How far it is in all."""
        center_cm, rotation_deg = 100.0 * np.linalg.norm(self.center_m), np.linalg.norm(self.rotation_deg)
        return f"{center_cm:.2f} cm and {rotation_deg:.3f} deg"

    def judge(self, limits: Limits) -> tuple[Check, ...]:
        """Judge it along and about each axis, and in all."""
        return judge(self.center_m.tolist(), self.rotation_deg.tolist(), self.half_widths.tolist(), limits)


@dataclass(frozen=True)
class Standing:
    """A drive beside what holds at its time."""

    member: Member
    time: float
    part: int
    course: npt.NDArray[np.float64]
    """(6,) what holds then relative to what holds at the last drive: the camera's place and rotation, metres and
    degrees."""
    offset: Offset
    disagrees: bool
    """By more than chance explains."""
    is_far: bool
    """Whether the offset itself, whatever its interval, is beyond a limit."""
    verdict: Verdict
    """`fail` if the offset is surely beyond a limit."""

    @property
    def is_suspect(self) -> bool:
        """Whether it may be beyond a limit, and nobody knows."""
        return self.is_far and self.verdict != "fail"


@dataclass(frozen=True)
class Part:
    """A stretch of time in which the rig stayed as it was, or the whole of a fleet that drifts."""

    first: str
    last: str
    num_drives: int
    T_camera_lidar: Pose
    """At its end."""
    half_widths: npt.NDArray[np.float64]
    """(6,) of the 95 % intervals of the camera's place and rotation, metres and degrees."""
    change: Offset | None
    """From the part before; None for the first."""
    change_in_all: Offset | None
    """From the first part, if that is not the one before."""


@dataclass(frozen=True)
class Fleet:
    """What the drives of a rig say together."""

    verdict: Verdict
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    """What a reader has to know that is no reason for the verdict."""
    checks: tuple[Check, ...]
    """Of what they agree on; single drives are judged beside."""
    T_camera_lidar: Pose
    """At the last drive."""
    covariance: npt.NDArray[np.float64]
    """(6, 6) of a twist on its left, (rho, phi)."""
    scatter: npt.NDArray[np.float64]
    """(6,) standard deviation of the camera's place and rotation beyond what drives say of themselves, metres and
    degrees."""
    order: Order
    """`stamp`: times are days since the first; `name`: they count drives, since stamps do not compare."""
    parts: tuple[Part, ...]
    drift: Offset | None
    """From the first drive to the last, if it explains them better than changes do."""
    standings: tuple[Standing, ...]
    """In the order of time."""
    left_out: tuple[Member, ...]
    limits: Limits


def assess(members: Sequence[Member], limits: Limits, T_reference: Pose | None = None) -> Fleet:
    """Put the drives of one rig together.

    Args:
        members: The drives, in any order: their stamps give it, or without stamps their names.
        limits: What drives may be off, and the rig may move.
        T_reference: T_camera_lidar that the rig should have.

    Raises:
        CalibrationError: no drive can be used.
    """
    usable = [member for member in members if member.left_out is None]
    left_out = tuple(sorted((m for m in members if m.left_out is not None), key=lambda m: m.drive))
    if not usable:
        raise CalibrationError(
            f"found no drive of {len(members):,} that can be used, needed {MIN_DRIVES}; the first, "
            f"{left_out[0].drive}: {left_out[0].left_out}"
            if left_out
            else f"found no drives, needed {MIN_DRIVES}"
        )
    used, times, order = _in_order(usable)
    poses = [member.T_camera_lidar for member in used if member.T_camera_lidar is not None]
    stated = np.array([member.covariance for member in used])
    T_middle = robust_mean(poses, stated).T_camera_lidar
    extra = extra_scatter(local_coordinates(poses, T_middle), stated)
    covariances = stated + np.diag(extra.variances)
    T_middle = robust_mean(poses, covariances).T_camera_lidar
    series = local_coordinates(poses, T_middle)
    least = float(extra.degrees_of_freedom.min())
    course = _explain(times, series, covariances, least)

    factors = np.array([_core.student_quantile(0.975, dof) for dof in extra.degrees_of_freedom])
    standings = _standings(used, times, series, covariances, course, factors, least, limits)
    parts = _parts(used, course, T_middle, factors)
    T_now, covariance = pose_at(T_middle, course.expected[-1]), course.covariances[-1]
    drifted = None if course.drift is None else _total_drift(course.drift, times, factors)

    nothing = Offset(np.zeros(3), np.zeros(3), _half_widths(covariance, factors))
    checks = _named("known to", nothing.judge(limits))
    if T_reference is not None:
        (off,) = local_coordinates([T_now], T_reference)
        checks += _named("from the reference", _offset(off, covariance, factors).judge(limits))
    for part in parts:
        if part.change is not None:
            checks += _named(f"change at {part.first}", part.change.judge(limits))
        if part.change_in_all is not None:
            checks += _named(
                f"change from {parts[0].first} to {part.first}", part.change_in_all.judge(limits)
            )
    if drifted is not None:
        checks += _named("drift", drifted.judge(limits))
    verdict, reasons = _conclude(checks, standings, left_out, parts, drifted)
    return Fleet(
        verdict,
        reasons,
        _notes(used, order),
        tuple(checks),
        T_now,
        covariance,
        _half_widths(np.diag(extra.variances), np.ones(6)),
        order,
        parts,
        drifted,
        standings,
        left_out,
        limits,
    )


@dataclass(frozen=True)
class _Course:
    """How a rig went, in local coordinates."""

    expected: Vectors
    """(N, 6) at each drive."""
    covariances: Matrices
    """(N, 6, 6) of that."""
    starts: tuple[int, ...] = (0,)
    """Where parts begin."""
    drift: Drift | None = None


def _in_order(used: list[Member]) -> tuple[list[Member], npt.NDArray[np.float64], Order]:
    """Sort drives by their stamps, days since the first, or if these do not compare by their names."""
    by_name = sorted(used, key=lambda member: _natural(member.drive))
    stamps = [member.stamp for member in by_name if member.stamp is not None and has_stamp(member)]
    if len(stamps) < len(used) or len(set(stamps)) == 1:
        return by_name, np.arange(len(used), dtype=np.float64), "name"
    order = np.argsort(stamps, kind="stable")
    return [by_name[i] for i in order], (np.sort(stamps) - min(stamps)) / DAY_S, "stamp"


def has_stamp(member: Member) -> bool:
    """Tell whether a drive's stamp compares with those of others."""
    return member.stamp is not None and member.stamp >= EPOCH_S


def _notes(used: Sequence[Member], order: Order) -> tuple[str, ...]:
    notes = []
    if order == "name":
        notes.append("drives have no stamps in seconds since 1970 that differ: ordered by name")
    num_cameras = len({member.camera for member in used if member.camera is not None})
    if num_cameras > 1:
        notes.append(f"drives have {num_cameras:,} cameras that differ in picture size, intrinsics or lens")
    return tuple(notes)


def _natural(name: str) -> tuple[list[tuple[int, str]], str]:
    """Sort key by which 10 comes after 2."""
    parts = re.split(r"([0-9]+)", name)
    digits = (part.lstrip("0") if index % 2 else part for index, part in enumerate(parts))
    return [(len(part) if index % 2 else 0, part) for index, part in enumerate(digits)], name


def _explain(
    times: npt.NDArray[np.float64], series: Vectors, covariances: Matrices, degrees_of_freedom: float
) -> _Course:
    """Find what explains the drives best: nothing happened, changes, or a drift."""
    steady = _in_parts(series, covariances, (0,))
    found = [(misfit(series, steady.expected, covariances, 6), steady)]
    if starts := change_points(series, covariances, degrees_of_freedom):
        steps = _in_parts(series, covariances, (0, *starts))
        num_parameters = 6 * (len(starts) + 1) + len(starts)
        found.append((misfit(series, steps.expected, covariances, num_parameters), steps))
    line = drift(times, series, covariances, degrees_of_freedom) if len(series) >= MIN_DRIFT_DRIVES else None
    if line is not None and line.is_significant:
        along = np.array([line.covariance_at(time) for time in times])
        drifting = _Course(line.at(times), along, drift=line)
        found.append((misfit(series, drifting.expected, covariances, 12), drifting))
    return min(found, key=lambda pair: pair[0])[1]


def _in_parts(series: Vectors, covariances: Matrices, starts: tuple[int, ...]) -> _Course:
    """Take the robust mean of each part for what holds in it."""
    expected, known = np.zeros_like(series), np.zeros_like(covariances)
    for begin, end in zip(starts, (*starts[1:], len(series)), strict=True):
        # Local coordinates are far smaller than what would make their own frame matter.
        poses = [pose_at(np.eye(4), each) for each in series[begin:end]]
        mean = robust_mean(poses, covariances[begin:end])
        expected[begin:end] = local_coordinates([mean.T_camera_lidar], np.eye(4))
        known[begin:end] = mean.covariance
    return _Course(expected, known, starts)


def _standings(
    used: Sequence[Member],
    times: npt.NDArray[np.float64],
    series: Vectors,
    covariances: Matrices,
    course: _Course,
    factors: npt.NDArray[np.float64],
    degrees_of_freedom: float,
    limits: Limits,
) -> tuple[Standing, ...]:
    off = series - course.expected
    squared = np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariances), off)
    disagrees = squared > joint_quantile(ALPHA / len(used), degrees_of_freedom)
    parts = np.searchsorted(course.starts, np.arange(len(used)), side="right") - 1
    relative = course.expected - course.expected[-1]
    course_off = np.hstack([-relative[:, :3], np.degrees(relative[:, 3:])])
    standings = []
    for index, member in enumerate(used):
        offset = _offset(off[index], covariances[index], factors)
        checks = offset.judge(limits)
        verdict = together(check.verdict for check in checks)
        is_far = any(abs(check.offset) > check.allowed for check in checks)
        standings.append(
            Standing(
                member,
                float(times[index]),
                int(parts[index]),
                course_off[index],
                offset,
                bool(disagrees[index]),
                is_far,
                verdict,
            )
        )
    return tuple(standings)


def _parts(
    used: Sequence[Member], course: _Course, T_middle: Pose, factors: npt.NDArray[np.float64]
) -> tuple[Part, ...]:
    ends = (*course.starts[1:], len(used))
    parts: list[Part] = []
    for begin, end in zip(course.starts, ends, strict=True):

        def change_from(index: int, begin: int = begin) -> Offset:
            step = course.expected[begin] - course.expected[index]
            return _offset(step, course.covariances[begin] + course.covariances[index], factors)

        parts.append(
            Part(
                used[begin].drive,
                used[end - 1].drive,
                end - begin,
                pose_at(T_middle, course.expected[end - 1]),
                _half_widths(course.covariances[end - 1], factors),
                change_from(begin - 1) if begin > 0 else None,
                change_from(0) if len(parts) > 1 else None,
            )
        )
    return tuple(parts)


def _total_drift(line: Drift, times: npt.NDArray[np.float64], factors: npt.NDArray[np.float64]) -> Offset:
    span = float(times[-1] - times[0])
    return _offset(span * line.per_unit, span**2 * line.covariance, factors)


def _offset(
    coordinates: npt.NDArray[np.float64],
    covariance: npt.NDArray[np.float64],
    factors: npt.NDArray[np.float64],
) -> Offset:
    """Give what local coordinates say of the camera: rho moves its centre the other way."""
    return Offset(-coordinates[:3], np.degrees(coordinates[3:]), _half_widths(covariance, factors))


def _half_widths(
    covariance: npt.NDArray[np.float64], factors: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Give (6,) standard errors times factors (6,), metres and degrees."""
    sigmas = factors * np.sqrt(np.diag(covariance))
    return np.concatenate([sigmas[:3], np.degrees(sigmas[3:])])


def _named(subject: str, checks: Sequence[Check]) -> list[Check]:
    return [replace(check, name=f"{subject}: {check.name}") for check in checks]


def _conclude(
    checks: Sequence[Check],
    standings: Sequence[Standing],
    left_out: Sequence[Member],
    parts: Sequence[Part],
    drifted: Offset | None,
) -> tuple[Verdict, tuple[str, ...]]:
    """Give the verdict on all, and sentences on what happened and what is missing."""
    num_used, num_all = len(standings), len(standings) + len(left_out)
    verdicts: list[Verdict] = [check.verdict for check in checks]
    changed = [f"{part.first} by {part.change.words}" for part in parts if part.change is not None]
    more = [f"and {len(changed) - MAX_NAMED:,} times more"] if len(changed) > MAX_NAMED else []
    reasons = [f"changed at {', '.join([*changed[:MAX_NAMED], *more])}"] if changed else []
    if drifted is not None:
        reasons.append(f"drifted by {drifted.words} from the first drive to the last")
    for words, found in (
        ("surely farther off than is allowed", [s for s in standings if s.verdict == "fail"]),
        ("farther off than is allowed, not surely", [s for s in standings if s.is_suspect]),
        ("disagreeing, within what is allowed", [s for s in standings if s.disagrees and not s.is_far]),
    ):
        if found:
            names = listed(standing.member.drive for standing in found)
            reasons.append(f"{len(found):,} of {num_used:,} drives {words}: {names}")
    # A drive that is not known well enough is no reason to doubt the others, one that seems far off is.
    verdicts += [standing.verdict for standing in standings if standing.is_far]
    num_stamped = sum(has_stamp(standing.member) for standing in standings)
    if 0 < num_stamped < num_used:
        # By their names, a change or a drift may look like scatter.
        reasons.append(
            f"{num_used - num_stamped:,} of {num_used:,} drives have no stamp in seconds since 1970, needed one of "
            "each: the order of time is not known"
        )
        verdicts.append("inconclusive")
    if num_used < MIN_DRIVES:
        few = f"{num_used} of {num_all:,} drives can be used, needed {MIN_DRIVES} to tell how they scatter"
    elif num_used < MIN_USED * num_all:
        few = f"{num_used:,} of {num_all:,} drives can be used, needed {MIN_USED:.0%}"
    else:
        return together(verdicts), tuple(reasons)
    verdicts.append("inconclusive")
    return together(verdicts), (*reasons, few)
