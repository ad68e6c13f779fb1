"""Limits on the offset of a transform, and verdicts on offsets with their 95 % intervals."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from semcal_cli.config import Limits
from semcal_cli.errors import format_against_limit
from semcal_cli.estimation.uncertainty.quantiles import overall_width
from semcal_cli.readable import figure

Verdict: TypeAlias = Literal["pass", "fail", "inconclusive"]
Unit: TypeAlias = Literal["cm", "deg", "ms"]

VERDICTS: tuple[Verdict, ...] = ("fail", "inconclusive", "pass")
"""Verdicts, in the order in which they decide a combined one."""
AXES = ("x", "y", "z")
OVERALL = " overall"
"""Suffix of the names of checks of all three axes together."""
CLOCK = "clock"
"""Name of the check of the camera's clock."""
ONE_SIDED = 1.644854 / 1.959964
"""Distance to a limit that leaves a probability of 5 % beyond it, relative to the half width of a 95 % interval, which
leaves 2.5 % on either side. A displacement is within a limit if both one-sided tests say so (Schuirmann, *A comparison
of the two one-sided tests procedure*, 1987). With few degrees of freedom the ratio is smaller still."""
LIMITS: dict[Unit, tuple[str, float]] = {
    "deg": ("--max-rotation-deg", 1.0),
    "cm": ("--max-translation-m", 0.01),
    "ms": ("--max-delay-ms", 1.0),
}
"""Option of the limit of each unit, and the unit in that of the option."""
_UNITS: dict[Unit, str] = {"deg": "degrees", "cm": "cm", "ms": "ms"}
"""Units in words."""


class CheckText(NamedTuple):
    """A check as text, to two significant digits of its interval; all figures are in the unit of the check."""

    offset: str
    """The offset, with as many digits as tell it from the limit; empty if it is not determined."""
    half_width: str
    """Half width of the 95 % interval; empty if it is unknown."""
    allowed: str


@dataclass(frozen=True)
class AxisVerdict:
    """An offset with its limit and the verdict on it."""

    name: str
    """Name of the offset."""
    unit: Unit
    """Unit of all figures."""
    offset: float
    """Estimate of the offset."""
    half_width: float | None
    """Half width of its 95 % interval; None if it is unknown."""
    allowed: float
    """Largest offset that is allowed."""
    verdict: Verdict
    """`fail` if the offset is beyond the limit with a certainty of 95 %, `pass` if it is within with the same, else
    `inconclusive`."""

    @property
    def has_estimate(self) -> bool:
        """Whether the offset is an estimate; an undetermined time offset stays at its given value."""
        return self.name != CLOCK or self.half_width is not None

    @property
    def unit_word(self) -> str:
        """The unit as sentences have it."""
        return _UNITS[self.unit]

    @property
    def text(self) -> CheckText:
        """The check as text."""
        rounded = figure(abs(self.offset) if self.half_width is None else self.half_width)
        offset, allowed = format_against_limit(self.offset, self.allowed, len(rounded.partition(".")[2]))
        if not self.has_estimate:
            return CheckText("", "", f"{self.allowed:g}")
        if not math.isclose(float(allowed), self.allowed):  # 0.3 degrees beside 90
            allowed = f"{self.allowed:g}"
        return CheckText(offset, "" if self.half_width is None else rounded, allowed)

    def not_judged(self, *, is_trusted: bool) -> AxisVerdict:
        """Leave the offset unjudged; the interval of an estimate that is not trusted is left out."""
        return replace(self, half_width=self.half_width if is_trusted else None, verdict="inconclusive")


def judge(
    center_m: Sequence[float],
    rotation_deg: Sequence[float],
    half_widths: Sequence[float] | None,
    limits: Limits,
) -> tuple[AxisVerdict, ...]:
    """Judge the offsets of a transform: one that is beyond its limit with a certainty of 95 % fails, one within passes.

    Args:
        center_m: (3,) offset of the camera's position along the axes of the camera.
        rotation_deg: (3,) offset of its rotation about these axes.
        half_widths: (6,) half widths of the 95 % intervals, metres and degrees; None if they are unknown.
        limits: Largest offsets that are allowed.

    Returns:
        Checks of the camera centre along each axis and in total, and of the rotation about each axis and in total.
    """
    widths = None if half_widths is None else np.array(half_widths) * ([100.0] * 3 + [1.0] * 3)
    parts: tuple[tuple[str, Unit, slice, list[float], float], ...] = (
        ("camera centre", "cm", slice(0, 3), [100.0 * x for x in center_m], 100.0 * limits.translation_m),
        ("rotation", "deg", slice(3, 6), list(rotation_deg), limits.rotation_deg),
    )
    checks = []
    for name, unit, part, offsets, allowed in parts:
        part_widths = None if widths is None else widths[part]
        for index, axis in enumerate(AXES):
            width = None if part_widths is None else float(part_widths[index])
            checks.append(_check(f"{name} {axis}", unit, offsets[index], width, allowed))
        width = None if part_widths is None else overall_width(offsets, part_widths)
        checks.append(_check(f"{name}{OVERALL}", unit, float(np.linalg.norm(offsets)), width, allowed))
    return tuple(checks)


def judge_clock(offset_s: float, half_width_s: float | None, limit_s: float) -> AxisVerdict:
    """Judge the time offset, in milliseconds, as `judge` judges the offsets of a transform.

    Args:
        offset_s: Time by which images are later than assumed, seconds.
        half_width_s: Half width of its 95 % interval, seconds; None if it is not determined.
        limit_s: Largest offset that is allowed, seconds.
    """
    half_width = None if half_width_s is None else 1e3 * half_width_s
    return _check(CLOCK, "ms", 1e3 * offset_s, half_width, 1e3 * limit_s)


def figures(check: AxisVerdict) -> str:
    """Put a check's offset, interval and limit into words."""
    text, unit = check.text, check.unit_word
    allowed = f"allowed {text.allowed} {unit}"
    if not text.offset:
        return f"not determined, {allowed}"
    half = f"+- {text.half_width} {unit}" if text.half_width else f"{unit}, interval unknown"
    return f"{text.offset} {half}, {allowed}"


def overall_offsets(checks: Sequence[AxisVerdict]) -> list[str]:
    """Describe how far the camera centre, rotation and clock are off, ordered by how much they decide the verdict.

    Where only axes decide it, they come first.
    """
    overall = [check for check in checks if check.name.endswith(OVERALL) or check.name == CLOCK]
    if (verdict := together(check.verdict for check in checks)) not in {check.verdict for check in overall}:
        overall += [check for check in checks if check.verdict == verdict]
    overall.sort(key=lambda check: (VERDICTS.index(check.verdict), -abs(check.offset) / check.allowed))
    return [
        f"{check.name.removesuffix(OVERALL)} {'off by ' * check.has_estimate}{figures(check)}"
        for check in overall
    ]


def sufficient_limits(checks: Iterable[AxisVerdict]) -> list[str]:
    """Write the options with the smallest limits, to two digits, within which inconclusive checks would pass."""
    needed = dict.fromkeys(LIMITS, 0.0)
    for check in checks:
        if check.verdict == "inconclusive" and check.half_width is not None:
            needed[check.unit] = max(needed[check.unit], abs(check.offset) + ONE_SIDED * check.half_width)
    return [
        f"{option} {_rounded_up(scale * needed[unit]):g}"
        for unit, (option, scale) in LIMITS.items()
        if needed[unit]
    ]


def _rounded_up(value: float) -> float:
    """Round a positive value up to two significant digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.ceil(value / unit) * unit


def together(verdicts: Iterable[Verdict]) -> Verdict:
    """Combine verdicts: one `fail` fails, and only all `pass` pass."""
    return min(verdicts, key=VERDICTS.index, default="pass")


def _check(name: str, unit: Unit, offset: float, half_width: float | None, allowed: float) -> AxisVerdict:
    verdict: Verdict = "inconclusive"
    if half_width is not None and abs(offset) - ONE_SIDED * half_width > allowed:
        verdict = "fail"
    if half_width is not None and abs(offset) + ONE_SIDED * half_width <= allowed:
        verdict = "pass"
    return AxisVerdict(name, unit, offset, half_width, allowed, verdict)
