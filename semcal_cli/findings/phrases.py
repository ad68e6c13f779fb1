"""Phrases of findings that several checks use."""

from __future__ import annotations

from semcal_cli.errors import format_against_limit

ELSEWHERE = "add frames from other places"
BY_HAND = f"{ELSEWHERE}, or measure the mounting by hand and give it with --init-rpy-xyz"
NEARER = "add frames, or start nearer with --init"
ESTIMATE = "or calibrate with --refine-intrinsics "
"""Advice that names of intrinsics follow, by commas."""
OR_ESTIMATE_K = f"{ESTIMATE}fx,fy,cx,cy"
OR_CALIBRATE_CAMERA = "or calibrate the intrinsics of the camera anew, with a board"
"""Advice where the intrinsics were estimated already."""


def describe_rival_fit(behind: float, min_behind: float, digits: int) -> str:
    """Describe how well a rival explains the data, to follow "explains the data".

    Args:
        behind: Standard errors by which it is worse than the pose; negative if it is better.
        min_behind: Standard errors by which it would have to be worse.
        digits: Minimum number of digits after the decimal point.
    """
    apart, limit = format_against_limit(abs(behind), min_behind, digits)
    fit = f"better, by {apart} standard errors" if behind < 0.0 else f"only {apart} standard errors worse"
    return f"{fit}; a trusted pose must beat every other by {limit}"
