"""The options that say what is known of a pose beforehand."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.options import Command, FiniteRange

if TYPE_CHECKING:
    from semcal_cli.pipeline import Given
    from semcal_cli.prior import Prior

AXES = ("tx", "ty", "tz", "rx", "ry", "rz")
UNKNOWN = math.inf


class Axes(click.ParamType[tuple[str, ...]]):
    """Axes of a camera, with commas between them."""

    name = "axes"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, ...]:
        """Give the axes in their order."""
        named = [name.strip() for name in value.split(",")]
        for name in named:
            if name not in AXES:
                self.fail(f"found {name!r}, needed some of {','.join(AXES)}.", param, ctx)
        if len(set(named)) == len(AXES):
            self.fail("found all six axes, needed one to be left free.", param, ctx)
        return tuple(name for name in AXES if name in named)


PRIOR_OPTIONS = (
    click.option(
        "--fix",
        type=Axes(),
        metavar="AXES",
        help="Keep these axes as they are in --init or --init-rpy-xyz, as `rz,tx`: tx ty tz are the camera's place "
        "along its axes, rx ry rz its rotation about them (x right, y down, z forward).",
    ),
    click.option(
        "--prior-translation-m",
        type=FiniteRange(),
        nargs=4,
        metavar="X Y Z SIGMA",
        help="The camera's place in the LiDAR frame is known beforehand, with this standard deviation.",
    ),
    click.option(
        "--prior-rotation-deg",
        type=FiniteRange(),
        nargs=4,
        metavar="R P Y SIGMA",
        help="Its roll, pitch and yaw are, as in --init-rpy-xyz, with this standard deviation about each axis.",
    ),
)


def prior_options(command: Command) -> Command:
    """Add what says what is known of the pose."""
    for option in reversed(PRIOR_OPTIONS):
        command = option(command)
    return command


def make_priors(options: dict[str, Any], given: Given | None) -> tuple[Prior, ...]:
    """Take the options out of a command's, and turn them into what is known; what is exact comes last.

    Raises:
        click.UsageError: axes to keep without a transform to keep them from, or a standard deviation that is none.
    """
    from semcal_cli.poses import pose_from_mounting
    from semcal_cli.prior import Prior

    names = ("fix", "prior_translation_m", "prior_rotation_deg")
    fix, place, rotation = (options.pop(name) for name in names)
    found = []
    if place is not None:
        *center_m, sigma_m = place
        _check_sigma(sigma_m, "--prior-translation-m")
        T = pose_from_mounting((0.0, 0.0, 0.0), center_m)
        found.append(Prior(_name("--prior-translation-m", place), T, (sigma_m,) * 3 + (UNKNOWN,) * 3))
    if rotation is not None:
        *rpy_deg, sigma_deg = rotation
        _check_sigma(sigma_deg, "--prior-rotation-deg")
        T = pose_from_mounting(rpy_deg, (0.0, 0.0, 0.0))
        sigma = math.radians(sigma_deg)
        found.append(Prior(_name("--prior-rotation-deg", rotation), T, (UNKNOWN,) * 3 + (sigma,) * 3))
    if fix is not None:
        if given is None:
            raise click.UsageError("--fix: keeps axes of --init or --init-rpy-xyz: give one of them")
        kept = tuple(0.0 if axis in fix else UNKNOWN for axis in AXES)
        found.append(Prior(f"--fix {','.join(fix)}", given.T_camera_lidar, kept))
    return tuple(found)


def _name(option: str, values: tuple[float, ...]) -> str:
    return " ".join([option, *(f"{value:g}" for value in values)])


def _check_sigma(sigma: float, option: str) -> None:
    if not sigma > 0.0:
        raise click.UsageError(f"{option}: found a standard deviation of {sigma:g}, needed one above 0")
