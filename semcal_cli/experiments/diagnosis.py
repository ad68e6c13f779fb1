"""What the result of a spoiled drive says of the spoiling."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from semcal_cli.errors import SemcalError
from semcal_cli.experiments.outcome import Outcome, errors_of
from semcal_cli.pipeline import calibrate
from semcal_cli.result.calibration import Calibration
from semcal_cli.synthetic.raw_drive import RawDrive, write_raw_drive

MAX_WIDTH_CHANGE = 1.2
"""Largest ratio between the intervals of copies of a frame and those of the frame alone, either way."""
OF_SCALE = re.compile(r"\b(?:scaled?|units?|in metres|feet)\b", re.IGNORECASE)
"""Words of a note about the scale of the clouds."""


class Knock(NamedTuple):
    """A change of the camera's pose in mid-drive, as a result states it."""

    frame_index: int
    """Index of the first frame after the knock, among the frames that were used."""
    offset: tuple[float, ...]
    """(6,) displacement of the camera centre in centimetres and rotation in degrees, as `compare_poses` has them."""
    half_widths: tuple[float, ...]
    """(6,) half widths of its 95 % intervals."""


class Diagnosis(NamedTuple):
    """What a result says of the spoiling: see the fields of `Outcome`."""

    is_told: bool
    """Whether it says what is wrong."""
    detail: str = ""
    has_frame: bool | None = None
    num_axes_inside: int | None = None


class Run(NamedTuple):
    """A spoiled drive and its calibration."""

    raw: RawDrive
    found: Calibration | SemcalError
    outcome: Outcome


def attempt(raw: RawDrive) -> Calibration | SemcalError:
    """Write a drive, and calibrate it as a user does."""
    with TemporaryDirectory() as folder:
        try:
            return calibrate(write_raw_drive(raw, Path(folder)))
        except SemcalError as failure:
            return failure


def stated_knock(calibration: Calibration) -> Knock | None:
    """Read the largest movement that a result states; None without one."""
    starts = np.cumsum([0, *(part.num_frames for part in calibration.parts)]).tolist()
    knocks = [
        Knock(
            start,
            (*(100.0 * x for x in moved.camera_center_m), *(-x for x in moved.rotation_deg)),
            (*(100.0 * x for x in moved.half_width_95_camera_center_m), *moved.half_width_95_rotation_deg),
        )
        for start, part in zip(starts, calibration.parts, strict=False)
        if (moved := part.moved) is not None
    ]
    return max(knocks, key=lambda knock: float(np.linalg.norm(knock.offset)), default=None)


def stated_cost(calibration: Calibration, name: str) -> tuple[float, ...]:
    """Read the stated cost of one of `fx`, `fy`, 0.1 % off, or `cx`, `cy`, 1 px off: (6,) centimetres and degrees."""
    cost: Any = getattr(calibration.uncertainty, "intrinsics_cost", None)
    if cost is None:
        return (0.0,) * 6
    of_one = getattr(cost, name)
    return (*(100.0 * x for x in of_one.camera_center_m), *of_one.rotation_deg)


def names_knock(run: Run) -> Diagnosis:
    """Check that the knock is named with its frame, within one, and that all six axes lie within the intervals."""
    first = run.raw.knock
    stated = None if isinstance(run.found, SemcalError) else stated_knock(run.found)
    if stated is None:
        return Diagnosis(False, f"frame {first}, none named", has_frame=False)
    before, after = (run.raw.frames[place].T_camera_lidar for place in (0, first))
    true = errors_of(after, before)
    inside = sum(
        abs(x - y) <= half for x, y, half in zip(stated.offset, true, stated.half_widths, strict=True)
    )
    has_frame = abs(stated.frame_index - first) <= 1
    detail = f"frame {first}, named {stated.frame_index}, {inside} of 6 axes inside"
    return Diagnosis(has_frame and inside == len(true), detail, has_frame, inside)


def covers_intrinsics(offsets: Mapping[str, float], run: Run) -> Diagnosis:
    """Check that the interval, and what wrong intrinsics cost by the result's own figures, cover the error.

    Args:
        offsets: How far intrinsics are off, by name, in units of the stated costs: pixels, or 0.1 %.
        run: The run.
    """
    if isinstance(run.found, SemcalError):
        return Diagnosis(False)
    costs = np.zeros(6)
    for name, offset in offsets.items():
        costs += offset * np.abs(stated_cost(run.found, name))
    halves = run.outcome.half_widths or (0.0,) * 6
    covered = [
        abs(error) <= half + cost for error, half, cost in zip(run.outcome.errors, halves, costs, strict=True)
    ]
    return Diagnosis(all(covered), f"{sum(covered)} of 6 axes covered")


def names_leak(run: Run) -> Diagnosis:
    """Check that a reason says that labels of points were made from those of pictures."""
    return Diagnosis(not isinstance(run.found, SemcalError) and "leaked-labels" in run.found.topics)


def names_scale(run: Run) -> Diagnosis:
    """Check that a note or a reason speaks of scale or units."""
    return Diagnosis(OF_SCALE.search(f"{run.outcome.reasons} {run.outcome.notes}") is not None)


def matches_one_frame(run: Run) -> Diagnosis:
    """Check that copies of a frame have the interval and the verdict of the frame alone."""
    alone = attempt(run.raw.with_frames(run.raw.frames[:1]))
    if isinstance(alone, SemcalError) or isinstance(run.found, SemcalError):
        is_same = isinstance(alone, SemcalError) and isinstance(run.found, SemcalError)
        return Diagnosis(is_same, f"alone {_status(alone)}")
    ratio = 1.0
    if alone.uncertainty is not None and run.found.uncertainty is not None:
        ratios = np.divide(run.found.uncertainty.half_widths, alone.uncertainty.half_widths)
        ratio = float(ratios[np.argmax(np.abs(np.log(ratios)))])
    elif (alone.uncertainty is None) != (run.found.uncertainty is None):
        return Diagnosis(False, f"alone {alone.status}, one without intervals")
    is_as_wide = 1.0 / MAX_WIDTH_CHANGE <= ratio <= MAX_WIDTH_CHANGE
    return Diagnosis(
        is_as_wide and alone.status == run.found.status,
        f"alone {alone.status}, intervals {ratio:.2f} times as wide",
    )


def _status(found: Calibration | SemcalError) -> str:
    return "failed" if isinstance(found, SemcalError) else found.status
