"""The options for the choices that the paper leaves open, of `calibrate --method paper`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, get_args

import click

from semcal_cli.baselines.config import PaperConfig
from semcal_cli.cli.options import Command, FiniteRange, number_option, with_options
from semcal_cli.cli.rules import given
from semcal_cli.config import LABELS, InitializationConfig, PyramidConfig
from semcal_cli.refinement.mine_config import MINE_WITH_VECTORS, MineConfig, Optimizer

FIELDS = {
    "mine_units": "num_hidden",
    "mine_steps": "steps_per_level",
    "mine_warm_up": "warm_up_steps",
    "mine_batch": "batch_size",
    "mine_optimizer": "optimizer",
    "mine_theta_rate": "learning_rate_theta",
    "mine_pose_rate": "learning_rate_pose",
}
"""Fields of `MineConfig` by the parameters that set them."""
PAPER_RULES = (
    given(*(f"--{name.replace('_', '-')}" for name in (*FIELDS, "mine_settled_px"))).requires(
        "--method paper"
    ),
)
MAX_UNITS, MAX_STEPS, MAX_BATCH = 4096, 100_000, 1 << 20


def _default(name: str) -> str:
    return f"  [default: {getattr(MineConfig, FIELDS[name])}]"


def _rate(name: str, of: str) -> Any:
    return click.option(
        f"--{name.replace('_', '-')}",
        type=FiniteRange(0.0, min_open=True),
        metavar="R",
        help=f"With --method paper: learning rate of {of}.{_default(name)}",
    )


PAPER_OPTIONS = (
    number_option(
        "--mine-units",
        most=MAX_UNITS,
        help=f"With --method paper: units of either hidden layer of the network.{_default('mine_units')}",
    ),
    click.option(
        "--mine-optimizer",
        type=click.Choice(get_args(Optimizer)),
        help=f"With --method paper: optimiser of network and pose.{_default('mine_optimizer')}",
    ),
    _rate("mine_theta_rate", "the network"),
    _rate("mine_pose_rate", "the pose, in blocks of a level"),
    number_option(
        "--mine-steps",
        most=MAX_STEPS,
        help=f"With --method paper: steps of each level of the pyramid.{_default('mine_steps')}",
    ),
    number_option(
        "--mine-warm-up",
        least=0,
        most=MAX_STEPS,
        help="With --method paper: steps of the first level before the pose moves; later levels take a third."
        f"{_default('mine_warm_up')}",
    ),
    number_option(
        "--mine-batch",
        most=MAX_BATCH,
        help=f"With --method paper: points in a mini-batch.{_default('mine_batch')}",
    ),
    click.option(
        "--mine-settled-px",
        type=FiniteRange(0.0, min_open=True),
        metavar="PX",
        help="With --method paper: largest drift of the pose over the last steps that counts as settled.  "
        f"[default: {PyramidConfig.max_final_drift}]",
    ),
)


def paper_options(command: Command) -> Command:
    """Add the options for the choices that the paper leaves open."""
    return with_options(command, PAPER_OPTIONS)


def make_paper(options: dict[str, Any], search: InitializationConfig) -> PaperConfig:
    """Make settings of the paper's options.

    Args:
        options: Options of the command.
        search: Settings of the search, of which the paper's method takes in-plane rotations and the largest distance.

    Raises:
        click.UsageError: several cues are given.
    """
    has_vectors = options["cues"] != LABELS
    if len(options["cues"]) > 1:
        raise click.UsageError(f"--cue: found {','.join(options['cues'])}, --method paper takes one cue.")
    given = {field: options[name] for name, field in FIELDS.items() if options[name] is not None}
    usual, settled_px = PaperConfig(), options["mine_settled_px"]
    mine = replace(
        MINE_WITH_VECTORS if has_vectors else usual.mine,
        edge_band_px=0,
        max_baseline_m=search.alignment.max_baseline_m,
        **given,
    )
    pyramid = usual.pyramid if settled_px is None else replace(usual.pyramid, max_final_drift=settled_px)
    return PaperConfig(replace(search, zoom=usual.initialization.zoom), pyramid, mine)
