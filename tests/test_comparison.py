"""Numbers beside what is allowed: with digits that tell them apart, and judged by what is known of them."""

import numpy as np
import pytest

from semcal_cli.errors import format_against_limit
from semcal_cli.geometry.poses import PoseError
from semcal_cli.pipeline.comparison import Axis, Comparison
from semcal_cli.pipeline.verdict import Verdict


@pytest.mark.parametrize(
    ("found", "needed", "digits", "unit", "expected"),
    [
        (0.6512, 0.65, 0, "%", ("65.1%", "65%")),
        (2.987, 3.0, 1, "", ("2.99", "3")),
        (1.4, 3.0, 1, "", ("1.4", "3")),
        (0.30004, 0.3, 3, "", ("0.30004", "0.3")),
        (3.0, 3.0, 1, "", ("3.0", "3")),
        (-1e-9, 0.3, 3, "", ("0.000", "0.3")),
        (float("inf"), 0.65, 0, "%", ("inf%", "65%")),
    ],
)
def test_two_numbers_are_written_so_that_they_differ(
    found: float, needed: float, digits: int, unit: str, expected: tuple[str, str]
) -> None:
    assert format_against_limit(found, needed, digits, unit) == expected


@pytest.mark.parametrize(
    ("half_a", "half_b", "off", "verdict"),
    [
        (0.2, 0.2, 0.308, "inconclusive"),
        (0.2, None, 0.308, "inconclusive"),
        (None, None, 0.308, "fail"),
        (0.003, 0.003, 0.308, "fail"),
        (0.2, 0.2, 0.29, "pass"),
    ],
)
def test_a_difference_within_what_is_known_of_its_limit_is_undecided(
    half_a: float | None, half_b: float | None, off: float, verdict: Verdict
) -> None:
    offsets_deg = (off, 0.0, 0.0)
    axes = tuple(
        Axis(f"rotation {axis}", "deg", offset_deg, half_a, half_b)
        for axis, offset_deg in zip("xyz", offsets_deg, strict=True)
    )
    offsets_rad = tuple(np.radians(offsets_deg).tolist())
    comparison = Comparison(PoseError(offsets_rad[0], 0.0, offsets_rad, (0.0, 0.0, 0.0)), axes)
    assert comparison.verdict(off, 0.3, "deg") == verdict
