"""What a transform is allowed to be off, and the verdict on what is known of how far off it is."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from semcal_cli.config import Limits

Verdict: TypeAlias = Literal["pass", "fail", "inconclusive"]
Unit: TypeAlias = Literal["cm", "deg"]

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Check:
    """One figure that is judged."""

    name: str
    unit: Unit
    offset: float
    half_width: float | None
    """Of its 95 % interval; None if nothing is known of it."""
    allowed: float
    verdict: Verdict


def judge(
    center_m: Sequence[float],
    rotation_deg: Sequence[float],
    half_widths: Sequence[float] | None,
    limits: Limits,
) -> tuple[Check, ...]:
    """Judge how far a transform is off: a figure whose 95 % interval lies beyond its limit fails, within it passes.

    Args:
        center_m: (3,) offset of the camera's place along the axes of the camera.
        rotation_deg: (3,) rotation about them.
        half_widths: (6,) of the intervals, metres and degrees; None if nothing is known of them.
        limits: What is allowed.

    Returns:
        The camera's place along the axes, and in all; its rotation likewise.
    """
    widths = None if half_widths is None else np.array(half_widths) * ([100.0] * 3 + [1.0] * 3)
    parts: tuple[tuple[str, Unit, slice, list[float], float], ...] = (
        ("camera centre", "cm", slice(0, 3), [100.0 * x for x in center_m], 100.0 * limits.translation_m),
        ("rotation", "deg", slice(3, 6), list(rotation_deg), limits.rotation_deg),
    )
    checks = []
    for name, unit, part, offsets, allowed in parts:
        of_part = None if widths is None else widths[part]
        for index, axis in enumerate(AXES):
            width = None if of_part is None else float(of_part[index])
            checks.append(_check(f"{name} {axis}", unit, offsets[index], width, allowed))
        length = float(np.linalg.norm(offsets))
        along = np.array(offsets) / length if length > 0.0 else np.full(3, 3**-0.5)
        width = None if of_part is None else float(np.linalg.norm(along * of_part))
        checks.append(_check(f"{name} in all", unit, length, width, allowed))
    return tuple(checks)


def joint_quantile(alpha: float, degrees_of_freedom: float) -> float:
    """Give what the squared length of a vector of six, in its standard errors, exceeds by chance in a share alpha.

    Hotelling's, of standard errors that are known with so many degrees of freedom; chi squared if with very many.
    """
    from scipy.stats import f as fisher

    return 6.0 * float(fisher.isf(alpha, 6, degrees_of_freedom))


def together(verdicts: Iterable[Verdict]) -> Verdict:
    """Give the verdict on several figures: none may fail, and all have to pass."""
    found = set(verdicts)
    return "fail" if "fail" in found else "inconclusive" if "inconclusive" in found else "pass"


def _check(name: str, unit: Unit, offset: float, half_width: float | None, allowed: float) -> Check:
    verdict: Verdict = "inconclusive"
    if half_width is not None and abs(offset) - half_width > allowed:
        verdict = "fail"
    if half_width is not None and abs(offset) + half_width <= allowed:
        verdict = "pass"
    return Check(name, unit, offset, half_width, allowed, verdict)
