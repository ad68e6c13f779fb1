"""The options that say how a pose is refined."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from semcal_cli.cli.options import Command

if TYPE_CHECKING:
    from semcal_cli.pipeline import RefinementConfig

REFINEMENT_OPTIONS = (
    click.option(
        "--estimator",
        type=click.Choice(["exact", "mine"]),
        default="exact",
        show_default=True,
        help="What climbs: the labels' exact mutual information, or the paper's MINE, a network's lower bound on it.",
    ),
    click.option(
        "--device",
        type=click.Choice(["cpu", "cuda"]),
        default="cpu",
        show_default=True,
        help="Where the network of MINE computes.",
    ),
    click.option("--no-polish", is_flag=True, help="Leave the pose where the estimator ended."),
)


def refinement_options(command: Command) -> Command:
    """Add what says how a pose is refined."""
    for option in reversed(REFINEMENT_OPTIONS):
        command = option(command)
    return command


def make_refinement(
    estimator: str, device: str, no_polish: bool, max_baseline_m: float | None
) -> RefinementConfig:
    """Turn the refinement options into how to refine.

    Raises:
        click.UsageError: options that exclude one another.
    """
    from semcal_cli.pipeline import RefinementConfig
    from semcal_cli.refinement import MAX_BASELINE_M

    if device != "cpu" and estimator != "mine":
        raise click.UsageError("--device: is where MINE's network computes: give --estimator mine")
    limit = MAX_BASELINE_M if max_baseline_m is None else max_baseline_m
    return RefinementConfig("mine" if estimator == "mine" else "exact", device, not no_polish, limit)
