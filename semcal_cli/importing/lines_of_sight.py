"""Which points of several sweeps one cloud keeps: those that stay where they are, and that its own origin sees.

Something that moves is where it is only for a while: the rays of other sweeps pass through it. What another sweep saw
behind a corner is hidden from the cloud's origin: rays beside it end before it, on all its sides. Both are told by the
rays that lie beside a point, so that the ends of surfaces need care. There, half of the rays belong to the surface, and
at a corner a quarter. What a straight border leaves free has no rays before it in one of its four quadrants.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from semcal_cli import core
from semcal_cli.geometry.arrays import Array, Mask, Points, Vector

BESIDE_RAD = np.radians(0.5)
"""Largest angle between a point and a ray beside it: a sweep of a Livox Mid-360, 20,000 rays over 360 by 59 degrees,
has one ray within it."""
NUM_RAYS_BESIDE = 64
"""Largest number of rays beside a point, the nearest ones: dense clouds are compared within a smaller angle."""
MIN_RAYS_BESIDE = 8
"""Fewest rays beside a point that decide. Of 8 rays beside the straight end of a surface, 7 pass it in 4 % of cases."""
SAME_RANGE_M, SAME_RANGE_SHARE = 0.3, 0.01
"""Difference of two ranges that are the same, as between neighbours on one surface in the edges cue, and the share of
the range that is added: noise, and the errors of poses."""
THROUGH = 0.75
"""Share of the rays beside a point that pass beyond it if nothing is there; a right-angled corner has a quarter."""
NUM_PARTS = 3
"""Parts of the sweeps, in order, in any of which nothing may be where a point is: a car of 4.5 m that passes at 10 m/s
is in one place for 0.45 s, half of a cloud of a second."""
BEYOND, QUADRANTS = 2, 3
"""Columns of the core's counts."""


def are_unmoved(sweeps: Sequence[Points], origins: Sequence[Vector]) -> Mask:
    """Find the points through which the rays of a part of the sweeps, or of all, do not pass.

    Args:
        sweeps: (N, 3) metres, all in one frame, in order of time.
        origins: (3,) where the rays of each sweep start, in the same frame.

    Returns:
        For all points, in the order of the sweeps; True where too few rays decide.
    """
    points = np.concatenate(sweeps)
    all_counts, is_gone = np.zeros((len(points), 4)), np.zeros(len(points), bool)
    for part in np.array_split(np.arange(len(sweeps)), NUM_PARTS):
        counts = np.zeros((len(points), 4))
        for origin in np.unique([origins[index] for index in part], axis=0):
            same_origin = [sweeps[index] for index in part if np.array_equal(origin, origins[index])]
            counts += _count(np.concatenate(same_origin), points, origin)
        is_gone |= _is_passed(counts)
        all_counts += counts
    unmoved: Mask = ~(is_gone | _is_passed(all_counts))
    return unmoved


def are_seen(points: Points, origin: Vector) -> Mask:
    """Find the points (N, 3) of a cloud that its other points do not hide from an origin (3,), metres."""
    seen: Mask = _count(points, points, origin)[:, QUADRANTS] < 4
    return seen


def _is_passed(counts: Array) -> Mask:
    total = counts[:, : BEYOND + 1].sum(axis=1)
    passed: Mask = (total >= MIN_RAYS_BESIDE) & (counts[:, BEYOND] > THROUGH * total)
    return passed


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
