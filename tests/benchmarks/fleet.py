"""Simulated fleets to which nothing happens: whether intervals hold the truth, and how often something is seen.

    python tests/benchmarks/fleet.py --fleets 150

Drives state standard errors of some millimetres and hundredths of a degree, half to twice as large from drive to drive,
and scatter by these and by `extra` times as much again. Prints a Markdown table.
"""

from __future__ import annotations

import click
import numpy as np

from semcal_cli.config import Limits
from semcal_cli.experiments.page_tables import run_script
from semcal_cli.fleet.combination import combine_drives
from semcal_cli.fleet.members import Member
from semcal_cli.geometry.poses import pose_from_mounting
from semcal_cli.geometry.twists import local_coordinates, pose_at

TRUTH = pose_from_mounting((0.0, 5.0, 30.0), (1.2, -0.3, 0.5))
SIGMAS = np.array([0.004, 0.003, 0.006, *np.radians([0.02, 0.03, 0.01])])


def fleet(rng: np.random.Generator, count: int, extra: float) -> list[Member]:
    """Simulate one."""
    members = []
    for index in range(count):
        stated = rng.uniform(0.5, 2.0) * SIGMAS
        off = stated * rng.standard_normal(6) + extra * SIGMAS * rng.standard_normal(6)
        members.append(
            Member(f"{index:03d}", 1.7e9 + 43_200.0 * index, pose_at(TRUTH, off), np.diag(stated**2), None)
        )
    return members


@click.command()
@click.option("--fleets", "num_fleets", default=150, show_default=True)
@click.option("--first-seed", default=1000, show_default=True)
def main(num_fleets: int, first_seed: int) -> None:
    """Print the table."""
    print(
        "| drives | extra scatter | 95 % intervals hold | a change or a drift is seen | a drive is said to disagree |"
    )
    print("|---|---|---|---|---|")
    for count in (3, 5, 8, 20, 60):
        for extra in (0.0, 1.0, 3.0):
            held, moves, alarms = [], 0, 0
            for seed in range(first_seed, first_seed + num_fleets):
                found = combine_drives(fleet(np.random.default_rng(seed), count, extra), Limits())
                (off,) = local_coordinates([found.T_camera_lidar], TRUTH)
                off[3:] = np.degrees(off[3:])
                held.append(np.abs(off) <= found.parts[-1].half_widths)
                moves += len(found.parts) > 1 or found.drift is not None
                alarms += any(drive.disagrees for drive in found.drives)
            shares = f"{np.mean(held):.1%} | {moves / num_fleets:.1%} | {alarms / num_fleets:.1%}"
            print(f"| {count} | {extra:g} | {shares} |", flush=True)


if __name__ == "__main__":
    run_script(main)
