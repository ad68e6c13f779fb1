"""The options for the search of the initial calibration."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.convert import DIRECTIONS
from semcal_cli.cli.options import (
    KNOWN_TRANSFORMS,
    PATH,
    Command,
    FiniteNumber,
    FiniteRange,
    max_baseline_option,
    setting_option,
    with_options,
)
from semcal_cli.cli.rules import given
from semcal_cli.config import AlignmentConfig, InitializationConfig
from semcal_cli.errors import InputError
from semcal_cli.files.writing import descriptor

if TYPE_CHECKING:
    from semcal_cli.formats.format import Direction
    from semcal_cli.initialization.initial_pose import InitialPose

ALL_ROLLS_DEG = 180.0


class Roll(FiniteRange):
    """Degrees, or the word `any` for all in-plane rotations."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Parse the largest in-plane rotation in degrees."""
        return ALL_ROLLS_DEG if value == "any" else super().convert(value, param, ctx)


INIT_DIRECTION = "--init-direction"

init_direction_option = click.option(
    INIT_DIRECTION,
    type=click.Choice(DIRECTIONS),
    help="Direction of the matrix in the file of --init, if that does not tell: p_camera = T p_lidar, or p_lidar = T "
    "p_camera.",
)

SEARCH_OPTIONS = (
    click.option(
        "--init",
        type=PATH,
        metavar="FILE",
        help=f"Start at this transform instead of searching all mounting directions: {KNOWN_TRANSFORMS}.",
    ),
    init_direction_option,
    click.option(
        "--init-rpy-xyz",
        type=FiniteNumber(),
        nargs=6,
        metavar="R P Y X Y Z",
        help="Start at this mounting, measured by hand: roll, pitch and yaw (degrees, as in URDF: yaw turns to the "
        "left, pitch looks down) of the camera's body frame, x forward and z up, and its place (metres), in the LiDAR "
        "frame.",
    ),
    setting_option(InitializationConfig, "search_deg"),
    click.option(
        "--roll",
        "max_roll_deg",
        type=Roll(0.0, ALL_ROLLS_DEG),
        default=InitializationConfig.max_roll_deg,
        metavar="DEG|any",
        help="Search in-plane rotations up to this angle from upright, in degrees; `any` for portrait and upside-down "
        f"cameras.  [default: {InitializationConfig.max_roll_deg:g}]",
    ),
    max_baseline_option,
    setting_option(InitializationConfig, "zoom"),
)

STARTS = ("--init", "--init-rpy-xyz")
SEARCH_RULES = (
    given(INIT_DIRECTION).requires("--init"),
    given("--init").excludes("--init-rpy-xyz"),
    given("--search-deg").requires(*STARTS),
    given("--roll").excludes(*STARTS, because="around a transform, --search-deg covers it"),
    given("--zoom").requires(
        "--search-deg", where=STARTS, because="nothing else is searched around a transform"
    ),
)


def search_options(command: Command) -> Command:
    """Add the options for the search of the initial calibration."""
    return with_options(command, SEARCH_OPTIONS)


def make_search(options: Mapping[str, Any]) -> tuple[InitializationConfig, InitialPose | None]:
    """Make a configuration and a start of a command's search options.

    Raises:
        InputError: the file of `--init` is not a transform, or its camera is too far from the LiDAR.
    """
    chosen = {name: options[name] for name in ("zoom", "max_roll_deg", "search_deg")}
    max_baseline_m = options["max_baseline_m"]
    config = InitializationConfig(**chosen, alignment=AlignmentConfig(max_baseline_m=max_baseline_m))
    initial_pose = _initial_pose(*(options[name] for name in ("init", "init_direction", "init_rpy_xyz")))
    if initial_pose is not None:
        initial_pose.check_distance(max_baseline_m)
    return config, initial_pose


def _initial_pose(
    init: Path | None, direction: Direction | None, init_rpy_xyz: tuple[float, ...] | None
) -> InitialPose | None:
    from semcal_cli.geometry.poses import pose_from_mounting
    from semcal_cli.initialization.initial_pose import InitialPose

    if init is not None:
        return read_initial_pose(init, direction, direction_option=INIT_DIRECTION)
    if init_rpy_xyz is not None:
        name = " ".join(map(repr, init_rpy_xyz))
        return InitialPose(
            pose_from_mounting(init_rpy_xyz[:3], init_rpy_xyz[3:]), name=f"--init-rpy-xyz {name}"
        )
    return None


def read_initial_pose(
    path: Path, direction: Direction | None = None, *, direction_option: str | None = None
) -> InitialPose:
    """Read the transform to start from, or to verify.

    Args:
        path: The file.
        direction: Direction of a matrix whose file does not state it; None if it is not given.
        direction_option: Name of the command's option for it; None if it has none.

    Raises:
        InputError: the file is not a transform, leaves something open, or is standard input.
    """
    from semcal_cli.formats import read_extrinsic
    from semcal_cli.formats.format import FormatOptions
    from semcal_cli.initialization.initial_pose import InitialPose

    if path == Path("-") or descriptor(path) == 0:
        raise InputError(f"{path}: found standard input, needed a file: the result names and hashes it")
    options = None if direction_option is None else FormatOptions(direction=direction)
    found = read_extrinsic(path, None, options, direction_option=direction_option)
    return InitialPose(
        found.T_camera_lidar, name=str(path), source=path, direction=direction, record=found.record
    )
