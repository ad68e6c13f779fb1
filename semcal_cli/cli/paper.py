"""The options for the choices that the paper leaves open, of `calibrate --method paper`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import click

from semcal_cli.cli.options import Command, setting_option, with_options
from semcal_cli.cli.rules import given
from semcal_cli.config import LABELS, InitializationConfig, PyramidConfig
from semcal_cli.config.mine import MINE_WITH_VECTORS, MineConfig
from semcal_cli.config.setting import settings_of
from semcal_cli.experiments.baselines.config import PaperConfig

MINE = tuple(settings_of(MineConfig))
OF_PAPER = "{} Only with --method paper."
PAPER_OPTIONS = (
    *(setting_option(MineConfig, name, help=OF_PAPER, is_open=True) for name in MINE),
    setting_option(PyramidConfig, "max_final_drift", help=OF_PAPER, is_open=True),
)
PAPER_RULES = (
    given(
        *(each.option for config in (MineConfig, PyramidConfig) for each in settings_of(config).values())
    ).requires("--method paper"),
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
    asked = {name: options[name] for name in MINE if options[name] is not None}
    usual, settled_px = PaperConfig(), options["max_final_drift"]
    mine = replace(
        MINE_WITH_VECTORS if has_vectors else usual.mine,
        edge_band_px=0,
        max_baseline_m=search.alignment.max_baseline_m,
        **asked,
    )
    pyramid = usual.pyramid if settled_px is None else replace(usual.pyramid, max_final_drift=settled_px)
    return PaperConfig(replace(search, zoom=usual.initialization.zoom), pyramid, mine)
