"""What the result of a spoiled drive says about the fault."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias

import numpy as np
from laboratory.outcomes import Outcome, errors_of, in_cm
from laboratory.raw_drive import RawDrive, write_raw_drive

from semcal_cli.api.calls import calibrate
from semcal_cli.errors import SemcalError
from semcal_cli.result.calibration_document import CalibrationDocument

MAX_WIDTH_CHANGE = 1.2
"""Largest ratio, either way, between the intervals from copies of a frame and from the frame alone."""
OF_SCALE = re.compile(r"\b(?:scaled?|units?|in metres|feet)\b", re.IGNORECASE)
"""Words of a note about the scale of the clouds."""
Found: TypeAlias = CalibrationDocument | SemcalError
Diagnose = Callable[[RawDrive, Found, Outcome], Outcome]
"""Adds to an outcome whether the result says what is wrong with the drive, and the figures behind that."""


def attempt(raw: RawDrive) -> Found:
    """Write a drive and calibrate it as a user would."""
    with TemporaryDirectory() as folder:
        try:
            return calibrate(write_raw_drive(raw, Path(folder)))
        except SemcalError as failure:
            return failure


def names_knock(raw: RawDrive, found: Found, outcome: Outcome) -> Outcome:
    """Check that the result names the frame of the knock, within one, and that all six axes lie within their intervals.

    The largest movement that the result states is taken as the knock.
    """
    first, parts = raw.knock, () if isinstance(found, SemcalError) else found.parts
    starts = np.cumsum([0, *(part.num_frames for part in parts)]).tolist()
    knocks = []
    for start, part in zip(starts, parts, strict=False):
        if (moved := part.moved) is not None:
            offset = in_cm(moved.camera_center_m, [-x for x in moved.rotation_deg])
            halves = in_cm(moved.half_width_95_camera_center_m, moved.half_width_95_rotation_deg)
            knocks.append((start, offset, halves))
    if not knocks:
        return replace(outcome, is_told=False, detail=f"frame {first}, none named", has_frame=False)
    stated, offset, halves = max(knocks, key=lambda knock: float(np.linalg.norm(knock[1])))
    before, after = (raw.frames[place].T_camera_lidar for place in (0, first))
    true = errors_of(after, before)
    inside = sum(abs(x - y) <= half for x, y, half in zip(offset, true, halves, strict=True))
    has_frame = abs(stated - first) <= 1
    detail = f"frame {first}, named {stated}, {inside} of 6 axes inside"
    is_told = has_frame and inside == len(true)
    return replace(outcome, is_told=is_told, detail=detail, has_frame=has_frame, num_axes_inside=inside)


def covers_intrinsics(offsets: Mapping[str, float], raw: RawDrive, found: Found, outcome: Outcome) -> Outcome:
    """Check that the interval and the result's own figures for the cost of wrong intrinsics cover the error.

    Args:
        offsets: Errors of the intrinsics by name, in units of the stated costs: pixels for `cx` and `cy`, 0.1 % for
            `fx` and `fy`.
        raw: The spoiled drive.
        found: Its result.
        outcome: The outcome so far.
    """
    if isinstance(found, SemcalError):
        return replace(outcome, is_told=False)
    costs = np.zeros(6)
    stated = getattr(found.uncertainty, "intrinsics_cost", None)
    for name, offset in offsets.items() if stated is not None else ():
        cost = getattr(stated, name)
        costs += offset * np.abs(in_cm(cost.camera_center_m, cost.rotation_deg))
    halves = outcome.half_widths or (0.0,) * 6
    covered = [
        abs(error) <= half + cost for error, half, cost in zip(outcome.errors, halves, costs, strict=True)
    ]
    return replace(outcome, is_told=all(covered), detail=f"{sum(covered)} of 6 axes covered")


def names_leak(raw: RawDrive, found: Found, outcome: Outcome) -> Outcome:
    """Check that a reason says that point labels were made from image labels."""
    is_told = not isinstance(found, SemcalError) and "leaked-labels" in found.topics
    return replace(outcome, is_told=is_told)


def names_scale(raw: RawDrive, found: Found, outcome: Outcome) -> Outcome:
    """Check that a note or a reason mentions scale or units."""
    return replace(outcome, is_told=OF_SCALE.search(f"{outcome.reasons} {outcome.notes}") is not None)


def matches_one_frame(raw: RawDrive, found: Found, outcome: Outcome) -> Outcome:
    """Check that copies of a frame give the interval and the verdict of the frame alone."""
    alone = attempt(raw.with_frames(raw.frames[:1]))
    if isinstance(alone, SemcalError) or isinstance(found, SemcalError):
        is_same = isinstance(alone, SemcalError) and isinstance(found, SemcalError)
        status = "failed" if isinstance(alone, SemcalError) else alone.status
        return replace(outcome, is_told=is_same, detail=f"alone {status}")
    ratio = 1.0
    if alone.uncertainty is not None and found.uncertainty is not None:
        ratios = np.divide(found.uncertainty.half_widths, alone.uncertainty.half_widths)
        ratio = float(ratios[np.argmax(np.abs(np.log(ratios)))])
    elif (alone.uncertainty is None) != (found.uncertainty is None):
        return replace(outcome, is_told=False, detail=f"alone {alone.status}, one without intervals")
    is_as_wide = 1.0 / MAX_WIDTH_CHANGE <= ratio <= MAX_WIDTH_CHANGE
    detail = f"alone {alone.status}, intervals {ratio:.2f} times as wide"
    return replace(outcome, is_told=is_as_wide and alone.status == found.status, detail=detail)
