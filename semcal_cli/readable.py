"""Figures as people read them: two significant digits, centimetres or millimetres, and plus-minus signs.

Files of results keep "+-", which every encoding has.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Sequence

from semcal_cli.errors import printable

PLAIN = re.compile(r"(\d )?\+- ?")
MIN_CM_M = 0.01
"""Length from which on people read centimetres, in metres: below it, millimetres."""


def signed(text: str) -> str:
    """Write the intervals of a text with plus-minus signs."""
    return PLAIN.sub(lambda sign: f"{sign[1]}± " if sign[1] else "±", text)


def for_people(text: str) -> str:
    """Write a line of the terminal: printable, and with plus-minus signs where both streams can encode them."""
    text = printable(text)
    try:
        for stream in (sys.stdout, sys.stderr):
            "±".encode(getattr(stream, "encoding", None) or "ascii")
    except (UnicodeEncodeError, LookupError):
        return text
    return signed(text)


def lengths(values_m: Sequence[float]) -> str:
    """Format the lengths of one line, in metres, to two significant digits: in cm, or in mm if all are below 1 cm."""
    scale, unit = (100.0, "cm") if max(map(abs, values_m)) >= MIN_CM_M else (1000.0, "mm")
    return f"{' '.join(figure(scale * value) for value in values_m)} {unit}"


def figure(value: float) -> str:
    """Format a figure with two significant digits and without an exponent."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    # The power of ten is that of the rounded figure: 0.0998 is 0.10.
    digits = max(0, 1 - math.floor(math.log10(abs(float(f"{value:.1e}")))))
    return f"{value:.{min(digits, 6)}f}"
