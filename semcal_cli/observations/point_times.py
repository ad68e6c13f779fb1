"""Times of the points of a sweep: whether they can be seconds, and refer to the stamp of the sweep.

No reader can know the unit of a field of times. Sweeps of one LiDAR follow one another, so the time between them tells
how long a sweep may be: times that span much more have another unit.
"""

from __future__ import annotations

import numpy as np

from semcal_cli.config.point_files import SECONDS_PER_UNIT, SHARES, NamedUnit, may_be_shares
from semcal_cli.drive.document import Drive
from semcal_cli.drive.frames import Frame
from semcal_cli.errors import InputError
from semcal_cli.files.array_forms import SweepCloud
from semcal_cli.geometry.arrays import Numbers

MAX_SWEEP_S = 1.0
"""Largest time between a point and its sweep's stamp; larger ones mean different clocks or units."""
MIN_SWEEP_S = 0.005
"""Shortest duration of a sweep; times that span less have another unit, because no LiDAR turns that fast."""
MAX_OVERLAP = 2.0
"""Duration of a sweep, in times from one sweep to the next, beyond which sweeps overlap by far."""
MIN_FILLED, MAX_FILLED = 0.5, 1.1
"""Duration of a sweep, in times from one sweep to the next, of a LiDAR that turns all the time."""
IN_DRIVE = "in drive.yaml (--time-unit at import)"
"""Where a user states the unit, for messages."""
TURNS_HZ = tuple(5.0 * n for n in range(2, 7))
"""Usual rates of LiDARs that turn: 10 to 20 Hz in the manuals of Velodyne, Ouster and Hesai, and some faster ones.
Sweeps at 5 Hz may as well be every second one of a LiDAR that turns at 10 Hz."""
TURN_TOLERANCE = 0.05
"""Largest difference of a rate from a usual one, as a share of it."""


def checked_times(
    drive: Drive, frame: Frame, cloud: SweepCloud, reference: str | None
) -> tuple[Numbers, bool] | None:
    """Find when the points of a sweep were measured, and check that the times of its file are seconds.

    Args:
        drive: The drive, which may state the unit of the times, and the spin of the LiDAR.
        frame: The frame of the sweep.
        cloud: The sweep.
        reference: What times of the file refer to, as `point_times` of the drive's motion states it; None if they are
            not for that motion.

    Returns:
        Times (N,) in seconds, and whether they are on the clock of the stamps instead of counting from `points_stamp`;
        None where `Drive.point_times` finds none.

    Raises:
        InputError: times of the file are not finite, span no sweep, sweeps would overlap by far, they may be seconds or
            shares of a sweep, or they are too far from the stamp. The message names the unit or the reference that
            would fit. Those of a drive that stands are not checked, and with a speed alone any clock will do.
    """
    told = drive.point_times(cloud)
    if told is None:
        return None
    times_s, is_spun = told
    if is_spun:
        return times_s, False
    speed_m_s = None if reference is None or drive.motion is None else drive.motion.speed_m_s
    if speed_m_s == 0.0:  # Nothing depends on them.
        return times_s, reference == "absolute"
    first, last = float(times_s.min()), float(times_s.max())
    if reference is None:
        reference = "relative" if min(abs(first), abs(last)) <= MAX_SWEEP_S else "absolute"
    if not np.isfinite([first, last]).all():
        complaint = "found point times that are not finite, expected a time for each point"
    else:
        complaint = _unit_complaint(drive, first, last)
        # A motion without a direction moves no point: what it may cost follows from how long a sweep takes.
        if speed_m_s is None:
            complaint = complaint or _reference_complaint(frame, first, last, reference)
    if complaint:
        raise InputError(f"{drive.resolve(frame.points)}: {complaint}")
    return times_s, reference == "absolute"


def deduced_unit(times_s: Numbers, gap_s: float | None) -> NamedUnit | float | None:
    """Deduce the unit of point times that is not the one they are read in, from the time between sweeps.

    Args:
        times_s: Times of one sweep as read, seconds.
        gap_s: Time from one sweep to the next, seconds; None if unknown.

    Returns:
        The only unit in which a sweep fills the time to the next one, or the length in seconds of a turn, of which the
        times are shares; None if they can be seconds, or if nothing is certain.
    """
    if gap_s is None:
        return None
    first, last = float(times_s.min()), float(times_s.max())
    if turn_s := _turn_of_shares(first, last, gap_s):
        return turn_s
    unit, span_s = _fitting_unit(last - first)
    return unit if MIN_FILLED * gap_s <= span_s <= MAX_FILLED * gap_s else None


def length_of_unit(first: float, last: float, tick_s: float, gap_s: float | None) -> float | None:
    """Find how long the unit of times is that span a sweep in a usual one.

    Args:
        first: First time of a sweep.
        last: Last one.
        tick_s: Length of the usual unit, seconds.
        gap_s: Time from one sweep to the next, seconds; None if unknown.

    Returns:
        Seconds: `tick_s`, or the length of a turn whose shares the times are; None if it may be another one.
    """
    if turn_s := _turn_of_shares(first, last, gap_s):
        return turn_s
    span_s = (last - first) * tick_s
    # A recording has all sweeps of its LiDAR: one that lasts until the next one is a slow scanner's.
    fills_gap = gap_s is not None and gap_s / MAX_FILLED <= span_s <= MAX_FILLED * gap_s
    is_open = may_be_shares(first, last) and not fills_gap
    return None if is_open or _overlap(span_s, gap_s) else tick_s


def _turn_of_shares(first: float, last: float, gap_s: float | None) -> float | None:
    """Return the length of a turn in seconds, of which times are shares that cannot be seconds; None if unknown.

    Args:
        first: First time of a sweep as read.
        last: Last one.
        gap_s: Time from one sweep to the next, seconds, which is that of a turn if it is a usual one; None if unknown.
    """
    if gap_s is None or not may_be_shares(first, last) or not _overlap(last - first, gap_s):
        return None
    return _usual_turn(gap_s)


def _usual_turn(gap_s: float) -> float | None:
    """Return the length in seconds of the usual turn that a time between sweeps is; None if it is none."""
    rate_hz = min(TURNS_HZ, key=lambda usual: abs(usual * gap_s - 1.0))
    return 1.0 / rate_hz if abs(rate_hz * gap_s - 1.0) <= TURN_TOLERANCE else None


def _is_a_turn(drive: Drive, span_s: float) -> bool:
    """Whether times span a turn of the LiDAR whose spin the drive states, so that they are seconds."""
    spin = None if drive.lidar is None else drive.lidar.spin
    return spin is not None and SHARES[0] <= span_s * spin.rate_hz <= MAX_FILLED


def _unit_complaint(drive: Drive, first: float, last: float) -> str:
    """Describe why times cannot be seconds, or may be something else; empty if they are seconds."""
    span_s, gap_s, stated = last - first, drive.sweep_gap_s, drive.time_unit
    # Times on both sides of the stamp may span twice the largest time from it.
    if not MIN_SWEEP_S <= span_s <= 2.0 * MAX_SWEEP_S:
        unit, fitting_s = _fitting_unit(span_s) if stated is None else (None, 0.0)
        found = f"found point times that span {span_s:.4g} s"
        found += f" in units of {stated}" if isinstance(stated, float) else f" in {stated}" if stated else ""
        if unit is not None:
            return f"{found}, {fitting_s:.4g} s as {unit}, expected time_unit: {unit} {IN_DRIVE}"
        needed = f"needed {MIN_SWEEP_S:g} s or more, within {MAX_SWEEP_S:g} s of points_stamp"
        return f"{found}, {needed}; whole numbers are read as nanoseconds, others as seconds: see time_unit"
    could_be_shares, do_overlap = may_be_shares(first, last), _overlap(span_s, gap_s)
    if stated is not None or not (could_be_shares or do_overlap) or _is_a_turn(drive, span_s):
        return ""
    needed = f"expected time_unit {IN_DRIVE}"
    if gap_s is None or not do_overlap:
        found = "found point times from 0 to 1, which may be seconds or shares of a sweep"
        return f"{found}, {needed}: s, or the seconds of a sweep, such as 0.1"
    found = f"found point times that span {span_s:.4g} s in sweeps {gap_s:.3g} s apart"
    if could_be_shares:
        shares = f"{gap_s:.3g} if they are shares of a sweep of {gap_s:.3g} s"
        if _usual_turn(gap_s) is None:
            shares += f", {gap_s / 2.0:.3g} if every second sweep is left out"
        return f"{found}, {needed}: {shares}, or s if they are seconds"
    return f"{found}, {needed}: its length in seconds, or s if sweeps overlap"


def _reference_complaint(frame: Frame, first_s: float, last_s: float, reference: str) -> str:
    """Describe why times cannot belong to the stamp of the sweep; empty if they can, or if there is none."""
    stamp_s = frame.points_stamp
    if stamp_s is None:
        return ""
    zeros = {"relative": 0.0, "absolute": stamp_s}
    after = {name: (first_s - zero, last_s - zero) for name, zero in zeros.items()}
    fitting = [name for name, ends in after.items() if max(map(abs, ends)) <= MAX_SWEEP_S * SHARES[1]]
    if reference in fitting:
        return ""
    first_s, last_s = after[reference]
    found = f"found point times from {first_s:g} to {last_s:g} s after points_stamp"
    needed = f"expected them within {MAX_SWEEP_S:g} s; motion.point_times is {reference}"
    return f"{found}, {needed}" + "".join(f", and {other} would fit" for other in fitting)


def _fitting_unit(span_s: float) -> tuple[NamedUnit | None, float]:
    """Find the unit, other than the one in which times were read, in which they span a sweep, and how long it is.

    Whole numbers were read as nanoseconds, and all others as seconds, whose units are at least milliseconds.
    """
    for unit, seconds in SECONDS_PER_UNIT.items():
        for read_unit_s in (1.0, SECONDS_PER_UNIT["ns"]):
            is_finer = seconds < read_unit_s if read_unit_s == 1.0 else seconds > read_unit_s
            if is_finer and MIN_SWEEP_S <= (fitting_s := span_s * seconds / read_unit_s) <= MAX_SWEEP_S:
                name: NamedUnit = unit  # type: ignore[assignment]
                return name, fitting_s
    return None, 0.0


def _overlap(span_s: float, gap_s: float | None) -> bool:
    return gap_s is not None and span_s > MAX_OVERLAP * gap_s
