"""Which points of several sweeps one cloud keeps: those that stay where they are, and that its own origin sees.

Something that moves is where it is only for a while: most rays of the other sweeps pass through it. What another sweep
saw behind a corner is hidden from the cloud's origin: most of the rays beside it end before it. Both are told by the
rays that lie beside a point. Where a surface ends, half of them belong to it, and at a corner a quarter, so that more
than three quarters have to speak against a point.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from semcal_cli import core
from semcal_cli.geometry.arrays import Array, Mask, Points, Vector

BESIDE_RAD = np.radians(0.5)
"""Largest angle between a point and a ray beside it: a sweep of a Livox Mid-360, 20,000 rays over 360 by 59 degrees,
has one ray within it."""
NUM_RAYS_BESIDE = 32
"""Largest number of rays beside a point, the nearest ones: dense clouds are compared within a smaller angle."""
MIN_RAYS_BESIDE = 4
"""Fewest rays beside a point that decide."""
SAME_RANGE_M, SAME_RANGE_SHARE = 0.3, 0.01
"""Difference of two ranges that are the same, as between neighbours on one surface in the edges cue, and the share of
the range that is added: noise, and the errors of poses."""
AGAINST = 0.75
"""Share of the rays beside a point that speak against it: a right angle of a surface still has a quarter."""
NEARER, BEYOND = 0, 2
"""Columns of the counts of rays that end before a point, at it, and beyond it."""


def are_unmoved(sweeps: Sequence[Points], origins: Sequence[Vector]) -> Mask:
    """Find the points of several sweeps through which no more rays pass than beside the edge of a surface.

    Args:
        sweeps: (N, 3) metres, all in one frame.
        origins: (3,) where the rays of each sweep start, in the same frame.

    Returns:
        For all points, in the order of the sweeps; True where too few rays decide.
    """
    points, counts = np.concatenate(sweeps), np.zeros((sum(map(len, sweeps)), 3))
    for origin in np.unique(origins, axis=0):
        of_origin = [
            sweep for sweep, other in zip(sweeps, origins, strict=True) if np.array_equal(origin, other)
        ]
        counts += _count(np.concatenate(of_origin), points, origin)
    return ~_speak(counts, BEYOND)


def are_seen(points: Points, origin: Vector) -> Mask:
    """Find the points (N, 3) of a cloud that its other points do not hide from an origin (3,), metres."""
    return ~_speak(_count(points, points, origin), NEARER)


def _count(rays: Points, points: Points, origin: Vector) -> Array:
    start: Points = origin.astype(np.float32)
    return core.count_beside(
        rays - start,
        points - start,
        angle=BESIDE_RAD,
        max_rays=NUM_RAYS_BESIDE,
        same_m=SAME_RANGE_M,
        same_share=SAME_RANGE_SHARE,
    )


def _speak(counts: Array, column: int) -> Mask:
    total = counts.sum(axis=1)
    against: Mask = (total >= MIN_RAYS_BESIDE) & (counts[:, column] > AGAINST * total)
    return against
