"""The options for the refinement of a pose."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.options import Command, FiniteRange, setting_option, with_options
from semcal_cli.cli.priors import PRIOR_RULES, PRIORS, make_priors, prior_options
from semcal_cli.cli.rules import given
from semcal_cli.config import AUTO, LABELS, JointlyConfig, RefinementConfig
from semcal_cli.errors import check_torch

if TYPE_CHECKING:
    from semcal_cli.assessment.priors import Prior
    from semcal_cli.initialization.initial_pose import InitialPose

LEAST_SIGMA = 1e-9
"""Least standard deviation of intrinsics that are estimated: less would be exact."""


class IntrinsicNames(click.ParamType[tuple[str, ...]]):
    """Names of intrinsics, separated by commas; which names there are is the lens's matter."""

    name = "names"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, ...]:
        """Parse the names."""
        if isinstance(value, tuple):
            return value
        named = tuple(name.strip() for name in value.split(","))
        if "" in named:
            self.fail(f"found {value!r}, needed names as fx,fy,cx,cy.", param, ctx)
        if len(set(named)) < len(named):
            self.fail(f"found {value!r}, needed each name once.", param, ctx)
        return named


REFINEMENT_OPTIONS = (
    *(setting_option(RefinementConfig, name) for name in ("estimator", "device", "edge_band_px")),
    click.option("--no-polish", is_flag=True, help="Leave the pose where the estimator ended."),
    click.option(
        "--refine-intrinsics",
        "intrinsics",
        type=IntrinsicNames(),
        default=(),
        metavar="NAMES",
        help="Estimate these intrinsics together with the pose, as `fx,fy,cx,cy` or `fx,fy,cx,cy,k1,k2`: names of K "
        "and of the lens's own numbers. They are kept if held-out data agree better with them.",
    ),
    click.option(
        "--intrinsics-sigma",
        type=FiniteRange(0.0, 1e3),
        nargs=2,
        metavar="PERCENT PX",
        help="How well the drive's intrinsics are known: standard deviations of the focal lengths and of the principal "
        "point, which are part of the interval; 0 0 says that they are exact.  [default: `intrinsics_sigma` of the "
        "drive, or 0.1 1; with --refine-intrinsics 2 10]",
    ),
    click.option(
        "--estimate-delay",
        is_flag=True,
        help="Estimate by how much pictures are later than their stamps say, together with the pose. Needs `motion:` "
        "with poses or a twist, different speeds, and turns.",
    ),
)

REFINEMENT_RULES = (
    given("--device cuda").requires("--estimator mine", "--method paper"),
    given("--cue features").requires(
        "--estimator mine", "--method paper", because="vectors have no histogram"
    ),
    given("--cue segments").excludes(
        "--estimator mine", "--method paper", because="segments differ from frame to frame"
    ),
    *PRIOR_RULES,
    given("--refine-intrinsics", "--estimate-delay").excludes(
        "--no-polish",
        "--cue features",
        *PRIORS,
        because="these follow the polish, by the exact histogram, without priors",
    ),
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
    """Make a configuration and priors of a command's refinement options.

    Args:
        options: Options of the command.
        max_baseline_m: Largest distance between camera and LiDAR, metres.
        initial_pose: Transform that the refinement starts at.

    Raises:
        click.UsageError: no axis is left to estimate, or intrinsics that are estimated are stated to be exact.
    """
    jointly = _make_jointly(options)
    names = ("estimator", "device", "no_polish", "edge_band_px")
    estimator, device, no_polish, edge_band_px = (options[name] for name in names)
    if estimator == "mine" and options["cues"] == AUTO:
        options["cues"] = LABELS
    priors = make_priors(options, initial_pose, max_baseline_m)
    return RefinementConfig(estimator, device, not no_polish, max_baseline_m, edge_band_px, jointly), priors


def _make_jointly(options: Mapping[str, Any]) -> JointlyConfig:
    """Tell by a command's options what is estimated beside the pose.

    Raises:
        click.UsageError: intrinsics that are estimated are stated to be exact.
    """
    names = ("intrinsics", "intrinsics_sigma", "estimate_delay")
    intrinsics, sigma, with_delay = (options[name] for name in names)
    if sigma is None:
        return JointlyConfig(intrinsics, with_delay=with_delay)
    focal_percent, center_px = sigma
    if intrinsics and min(sigma) < LEAST_SIGMA:
        raise click.UsageError(
            f"--intrinsics-sigma: found {focal_percent:g} {center_px:g}, --refine-intrinsics requires {LEAST_SIGMA:g} "
            "or more of both."
        )
    return JointlyConfig(intrinsics, 0.01 * focal_percent, center_px, with_delay=with_delay)
