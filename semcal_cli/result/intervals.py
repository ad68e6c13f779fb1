"""The 95 % intervals of a pose, along and about the axes of its camera, in words."""

from __future__ import annotations

from collections.abc import Sequence


def intervals(half_widths: Sequence[float]) -> tuple[str, str]:
    """Tell the intervals of the camera's place along x, y and z, and of pitch, yaw and roll.

    Args:
        half_widths: (6,), metres and degrees.
    """
    center, rotation = [1000.0 * half for half in half_widths[:3]], half_widths[3:]
    return (
        f"x y z +- {' '.join(f'{half:.1f}' for half in center)} mm",
        f"pitch yaw roll +- {' '.join(f'{half:.3f}' for half in rotation)} degrees",
    )


def widest(half_widths: Sequence[float]) -> str:
    """Tell the widest of the intervals (6,), metres and degrees, of the place and of the rotation."""
    center_mm, rotation_deg = 1000.0 * max(half_widths[:3]), max(half_widths[3:])
    return f"+- {center_mm:.1f} mm, +- {rotation_deg:.3f} degrees (95 %)"
