"""The options for the refinement of a pose."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, get_args

import click

from semcal_cli.cli.options import Command, choice_option, with_options
from semcal_cli.cli.priors import make_priors, prior_options
from semcal_cli.config import Device, Estimator, RefinementConfig
from semcal_cli.extras import check_torch

if TYPE_CHECKING:
    from semcal_cli.assessment.priors import Prior
    from semcal_cli.initialization.initial_pose import InitialPose

MAX_EDGE_BAND_PX = 100

REFINEMENT_OPTIONS = (
    choice_option(
        "--estimator",
        get_args(Estimator),
        default=RefinementConfig.estimator,
        help="Objective: the labels' exact mutual information, or the paper's MINE, a network's lower bound "
        "on it (needs PyTorch: the extra mine).",
    ),
    choice_option(
        "--device",
        get_args(Device),
        default=RefinementConfig.device,
        help="Device of the network of MINE.",
    ),
    click.option(
        "--edge-band",
        type=click.IntRange(0, MAX_EDGE_BAND_PX),
        default=RefinementConfig.edge_band_px,
        show_default=True,
        metavar="PX",
        help="Pixels nearer than this to another class count a tenth; use more for labels with ragged borders.",
    ),
    click.option("--no-polish", is_flag=True, help="Leave the pose where the estimator ended."),
)


def refinement_options(command: Command) -> Command:
    """Add the options for the refinement of a pose, and for prior knowledge of it."""
    return with_options(prior_options(command), REFINEMENT_OPTIONS)


def check_estimator(options: Mapping[str, Any]) -> None:
    """Check that torch is there if a command's options ask for MINE.

    Raises:
        InputError: it is not installed.
    """
    if options.get("method") == "paper":
        check_torch("--method paper")
    elif options.get("estimator") == "mine":
        check_torch("--estimator mine")


def make_refinement(
    options: dict[str, Any], max_baseline_m: float, initial_pose: InitialPose | None
) -> tuple[RefinementConfig, tuple[Prior, ...]]:
    """Take the refinement options out of a command's options, and make a configuration and priors of them.

    Args:
        options: Options of the command.
        max_baseline_m: Largest distance between camera and LiDAR, metres.
        initial_pose: Transform that the refinement starts at.

    Raises:
        click.UsageError: two options exclude one another.
    """
    names = ("estimator", "device", "no_polish", "edge_band")
    estimator, device, no_polish, edge_band_px = (options.pop(name) for name in names)
    if device != "cpu" and estimator != "mine":
        raise click.UsageError("--device: is where MINE's network computes: give --estimator mine")
    if "features" in options["cues"] and estimator != "mine":
        raise click.UsageError("--cue features: vectors have no histogram: give --estimator mine")
    if "segments" in options["cues"] and estimator == "mine":
        raise click.UsageError(
            "--cue segments: they differ from frame to frame, so that no network learns them: give --estimator exact"
        )
    priors = make_priors(options, initial_pose, max_baseline_m)
    if priors and "features" in options["cues"]:
        raise click.UsageError(
            f"{priors[0].name}: is weighed by the exact histogram, which features have none of"
        )
    if priors and no_polish:
        raise click.UsageError(f"{priors[0].name}: is weighed after the polish: leave --no-polish out")
    return RefinementConfig(estimator, device, not no_polish, max_baseline_m, edge_band_px), priors
