"""Options that several commands share."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from semcal_cli.initialization import InitializationConfig
    from semcal_cli.pipeline import Given

Command = TypeVar("Command", bound=Callable[..., Any])

PATH = click.Path(path_type=Path)

MAX_SEED = 2**63 - 1
MAX_THREADS = 1024
ALL_ROLLS_DEG = 180.0

drive_argument = click.argument("drive", type=PATH)

output_option = click.option(
    "-o",
    "--output",
    type=PATH,
    metavar="FILE",
    help="Where the result goes: .yaml, .yml or .json. Standard output, as YAML, if not given.",
)
log_option = click.option(
    "--log", type=PATH, metavar="FILE", help="Write times, host and threads to a JSON file."
)
quiet_option = click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
seed_option = click.option(
    "--seed",
    type=click.IntRange(0, MAX_SEED),
    default=0,
    show_default=True,
    help="Seed of every random choice: the same seed gives the same bytes.",
)
threads_option = click.option(
    "--threads",
    type=click.IntRange(1, MAX_THREADS),
    metavar="N",
    help="Threads of the Rust stages; all cores if not given. The result does not depend on it.",
)
device_option = click.option(
    "--device",
    type=click.Choice(["cpu", "cuda"]),
    default="cpu",
    show_default=True,
    help="Where the refinement computes.",
)


class FiniteRange(click.FloatRange):
    """A range of numbers; not a number and infinity are none."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Give the number."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{number} is not a finite number.", param, ctx)
        return number


class Roll(FiniteRange):
    """Degrees, or the word `any` for all in-plane rotations."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Give the largest in-plane rotation in degrees."""
        return ALL_ROLLS_DEG if value == "any" else super().convert(value, param, ctx)


KNOWN_TRANSFORMS = "a calibration, a drive with its reference, a RELLIS-3D transforms.yaml"

SEARCH_OPTIONS = (
    click.option(
        "--init",
        type=PATH,
        metavar="FILE",
        help=f"Start at this transform instead of searching all mounting directions: {KNOWN_TRANSFORMS}.",
    ),
    click.option(
        "--init-rpy-xyz",
        type=FiniteRange(),
        nargs=6,
        metavar="R P Y X Y Z",
        help="Likewise, as one measures it by hand: roll, pitch and yaw (degrees, as in URDF: yaw turns to the left, "
        "pitch looks down) of the camera's body frame, x forward and z up, and its place (metres), in the LiDAR frame.",
    ),
    click.option(
        "--search-deg",
        type=FiniteRange(0.0, 180.0, min_open=True),
        metavar="DEG",
        help="With --init or --init-rpy-xyz: search all rotations within this angle of it.",
    ),
    click.option(
        "--roll",
        type=Roll(0.0, ALL_ROLLS_DEG),
        metavar="DEG|any",
        help="Search in-plane rotations up to this angle from upright, in degrees; `any` for portrait and upside-down "
        "cameras.  [default: 15]",
    ),
    click.option(
        "--max-baseline-m",
        type=FiniteRange(0.0, min_open=True),
        metavar="M",
        help="The camera is at most so far from the LiDAR.  [default: 3]",
    ),
    click.option(
        "--zoom",
        type=click.Choice(["exact", "paper"]),
        help="How label images are brought to the LiDAR's angular grid: through K and the lens, or as the paper does.  "
        "[default: exact]",
    ),
)


def search_options(command: Command) -> Command:
    """Add what says where and how the initial calibration is searched for."""
    for option in reversed(SEARCH_OPTIONS):
        command = option(command)
    return command


def make_search(
    init: Path | None,
    init_rpy_xyz: tuple[float, ...] | None,
    search_deg: float | None,
    roll: float | None,
    max_baseline_m: float | None,
    zoom: str | None,
) -> tuple[InitializationConfig, Given | None]:
    """Turn the search options into how to search, and where.

    Raises:
        click.UsageError: options that exclude one another.
        InputError: the file of `--init` is no transform, or the camera is too far from the LiDAR.
    """
    from semcal_cli.errors import InputError
    from semcal_cli.formats import read_transform
    from semcal_cli.initialization import AlignmentConfig, InitializationConfig
    from semcal_cli.pipeline import Given
    from semcal_cli.poses import camera_center, pose_from_mounting

    if init is not None and init_rpy_xyz is not None:
        raise click.UsageError("--init and --init-rpy-xyz: give one of them")
    is_given = init is not None or init_rpy_xyz is not None
    if search_deg is not None and not is_given:
        raise click.UsageError("--search-deg: is around --init or --init-rpy-xyz: give one of them")
    if is_given and roll is not None:
        raise click.UsageError("--roll: is for a search from nothing; with --init it is --search-deg")
    if is_given and search_deg is None and zoom is not None:
        raise click.UsageError("--zoom: is for a search; with --init there is one only with --search-deg")
    given = None
    if init is not None:
        given = Given(read_transform(init), name=str(init), source=init)
    elif init_rpy_xyz is not None:
        name = " ".join(f"{number:g}" for number in init_rpy_xyz)
        given = Given(pose_from_mounting(init_rpy_xyz[:3], init_rpy_xyz[3:]), name=f"--init-rpy-xyz {name}")
    config = InitializationConfig(search_deg=search_deg)
    if zoom is not None:
        config = replace(config, zoom=zoom)
    if roll is not None:
        config = replace(config, max_roll_deg=roll)
    if max_baseline_m is not None:
        config = replace(config, alignment=AlignmentConfig(max_baseline_m=max_baseline_m))
    if given is not None:
        distance = math.hypot(*camera_center(given.T_camera_lidar))
        if distance > config.alignment.max_baseline_m:
            raise InputError(
                f"{given.name}: found the camera {distance:g} m from the LiDAR, needed at most "
                f"{config.alignment.max_baseline_m:g} m; --max-baseline-m sets the limit"
            )
    return config, given


def result_options(command: Command) -> Command:
    """Add what every command takes that computes a calibration."""
    for option in (log_option, quiet_option, threads_option, seed_option, output_option):
        command = option(command)
    return command
