"""Simulated fleets to which nothing happens: whether intervals hold the truth, and how often something is seen.

    python tests/benchmarks/fleet.py --fleets 150

Drives state standard errors of some millimetres and hundredths of a degree, half to twice as large from drive to drive,
and scatter by these and by `extra` times as much again. Prints a Markdown table.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from benchmark import script, table

from semcal_cli.config import Limits
from semcal_cli.fleet.combination import combine_drives
from semcal_cli.fleet.fleet_drives import FleetDrive
from semcal_cli.geometry.poses import pose_from_mounting
from semcal_cli.geometry.twists import local_coordinates, pose_at

TRUTH = pose_from_mounting((0.0, 5.0, 30.0), (1.2, -0.3, 0.5))
SIGMAS = np.array([0.004, 0.003, 0.006, *np.radians([0.02, 0.03, 0.01])])


def fleet(rng: np.random.Generator, count: int, extra: float) -> list[FleetDrive]:
    """Simulate one."""
    drives = []
    for index in range(count):
        stated = rng.uniform(0.5, 2.0) * SIGMAS
        off = stated * rng.standard_normal(6) + extra * SIGMAS * rng.standard_normal(6)
        pose, covariance = pose_at(TRUTH, off), np.diag(stated**2)
        drives.append(FleetDrive(f"{index:03d}", 1.7e9 + 43_200.0 * index, pose, covariance, None))
    return drives


def rows(fleets: int, first_seed: int) -> Iterator[tuple[object, ...]]:
    """Combine fleets of each size."""
    for count in (3, 5, 8, 20, 60):
        for extra in (0.0, 1.0, 3.0):
            held, moves, alarms = [], 0, 0
            for seed in range(first_seed, first_seed + fleets):
                found = combine_drives(fleet(np.random.default_rng(seed), count, extra), Limits())
                (off,) = local_coordinates([found.T_camera_lidar], TRUTH)
                off[3:] = np.degrees(off[3:])
                held.append(np.abs(off) <= found.parts[-1].half_widths)
                moves += len(found.parts) > 1 or found.drift is not None
                alarms += any(drive.disagrees for drive in found.drives)
            shares = (np.mean(held), moves / fleets, alarms / fleets)
            yield count, f"{extra:g}", *(f"{share:.1%}" for share in shares)


def main(*, fleets: int = 150, first_seed: int = 1000) -> Iterator[str]:
    seen = "95 % intervals hold | a change or a drift is seen | a drive is said to disagree"
    yield from table(f"drives | extra scatter | {seen}", rows(fleets, first_seed))


if __name__ == "__main__":
    script(main)
