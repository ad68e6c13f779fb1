"""Where the rays of a LiDAR start, from its points alone.

Seen from where its rays start, a sweep is a range image: neighbouring rays mostly end on one surface. Seen from
elsewhere, near and far surfaces lie behind one another, and ranges of neighbours jump. The mean jump has one broad
minimum (tests/benchmarks/ray_origin.py).

One place stands for all points. A cloud of several LiDARs cannot be divided this way: for one LiDAR, the places found
in quarters of a sweep differ by metres, as much as the places of DDAD's four LiDARs do (`--quarters` of the same
script). Along the view of a quarter, a place hardly changes the ranges of neighbours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli.geometry.arrays import Points, Vector

ROW_RAD = math.radians(0.2)
"""Height of the rows in which neighbours are looked for: half the distance between the rings of a dense LiDAR."""
MAX_GAP_ROWS = 3.0
"""Rays of a row that are farther apart are no neighbours."""
MAX_JUMP = 0.3
"""Jumps of the logarithm of the range count up to this, so that few occlusions do not decide."""
LONE_RAY_JUMP = 0.1
"""What a ray without a neighbour counts, so that no place where rays have none is the best."""
MAX_POINTS = 60_000
"""Maximum number of points of a sweep that are used."""
STEPS_M = (1.0, 0.5, 0.25, 0.12, 0.06, 0.03)
"""Steps of the descent along the axes, one after the other."""
FARTHEST_M = 4.0
"""Limit of each coordinate from the start: far away, all rays are alike."""
AT_LIMIT_M = FARTHEST_M - 0.25
"""Coordinate from which the search may have ended at its limit: descents of moved sweeps ended up to 7 cm before it."""

MIN_RATIO = 2.0
"""Ratio of the roughness seen from the stated place to that seen from the best one. It is 2.5 for DDAD, whose points
are in the frame of the vehicle, and 1.0 to 1.5 on the other real drives (tests/benchmarks/ray_origin.py)."""


class RayOrigin(NamedTuple):
    """Where rays start, and how rough the sweeps look from there and from the stated place."""

    origin_m: Vector
    """(3,) metres, in the frame of the points."""
    roughness: float
    """Mean jump of the logarithm of the range between neighbours, seen from there."""
    roughness_stated: float
    """The same seen from the origin of the points."""
    start_m: Vector
    """(3,) where the descent began, metres."""

    @property
    def ratio(self) -> float:
        """Times as much as from there that ranges jump, seen from the origin of the points."""
        return self.roughness_stated / self.roughness if self.roughness > 0.0 else 1.0

    @property
    def is_clear(self) -> bool:
        """Whether the difference is more than that of sweeps whose rays start at the origin of their points."""
        return self.ratio >= MIN_RATIO

    @property
    def is_at_limit(self) -> bool:
        """Whether rays may start farther away than was searched."""
        return bool(np.abs(self.origin_m - self.start_m).max() > AT_LIMIT_M)


def find_ray_origin(
    clouds: Sequence[Points], steps_m: Sequence[float] = STEPS_M, start_m: Vector | None = None
) -> RayOrigin:
    """Find where the rays of sweeps of one LiDAR start, by descent from the origin of their points.

    Args:
        clouds: Points (N, 3) of each sweep, metres.
        steps_m: Steps of the descent, metres.
        start_m: Another place (3,) where a second descent begins, metres, if there is one. The better end counts.
    """
    sweeps = [_thinned(cloud) for cloud in clouds]
    found = _descend(sweeps, steps_m, np.zeros(3))
    if start_m is None or not start_m.any():
        return found
    other = _descend(sweeps, steps_m, start_m)._replace(roughness_stated=found.roughness_stated)
    return min(found, other, key=lambda end: end.roughness)


def _descend(
    sweeps: Sequence[npt.NDArray[np.float64]], steps_m: Sequence[float], start_m: Vector
) -> RayOrigin:
    origin_m = start_m
    start = best = _roughness(sweeps, origin_m)
    for step_m in steps_m:
        is_better = True
        while is_better:
            places = origin_m + step_m * np.vstack([np.eye(3), -np.eye(3)])
            places = places[np.abs(places - start_m).max(axis=1) <= FARTHEST_M]
            values = [_roughness(sweeps, place) for place in places]
            is_better = min(values) < best
            if is_better:
                best, origin_m = min(values), places[int(np.argmin(values))]
    return RayOrigin(origin_m, best, start, start_m)


def place_text(place_m: Vector) -> str:
    """Write a place (3,), metres, as a list of drive.yaml."""
    return f"[{', '.join(f'{x + 0.0:.2f}' for x in place_m)}]"


def _thinned(points: Points) -> npt.NDArray[np.float64]:
    chosen = np.random.default_rng(0).permutation(len(points))[:MAX_POINTS]
    return points[chosen].astype(np.float64)


def _roughness(sweeps: Sequence[npt.NDArray[np.float64]], origin_m: Vector) -> float:
    """Compute the mean jump of the logarithm of the range between neighbours of a row, seen from a place (3,)."""
    total, count = 0.0, 0
    for points in sweeps:
        rays = points - origin_m
        ranges = np.maximum(np.linalg.norm(rays, axis=1), np.finfo(np.float32).tiny)
        azimuths, elevations = np.arctan2(rays[:, 1], rays[:, 0]), np.arcsin(rays[:, 2] / ranges)
        rows = np.floor(elevations / ROW_RAD)
        order = np.lexsort((azimuths, rows))
        gaps = np.diff(azimuths[order]) * np.cos(elevations[order][1:])
        are_neighbours = (np.diff(rows[order]) == 0.0) & (gaps < MAX_GAP_ROWS * ROW_RAD)
        jumps = np.abs(np.diff(np.log(ranges[order])))[are_neighbours]
        total += float(np.minimum(jumps, MAX_JUMP).sum()) + LONE_RAY_JUMP * (len(points) - len(jumps))
        count += len(points)
    return total / max(count, 1)
