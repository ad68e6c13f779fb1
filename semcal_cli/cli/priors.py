"""The options for prior knowledge of a pose."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.options import Command, FiniteNumber, FiniteRange, with_options
from semcal_cli.cli.rules import given

if TYPE_CHECKING:
    from semcal_cli.assessment.priors import Prior
    from semcal_cli.initialization.initial_pose import InitialPose

AXES = ("tx", "ty", "tz", "rx", "ry", "rz")
UNKNOWN = math.inf
NUMBERS_AND_SIGMA = (*[FiniteNumber()] * 3, FiniteRange(0.0))


class Axes(click.ParamType[tuple[str, ...]]):
    """Axes of a camera, separated by commas."""

    name = "axes"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, ...]:
        """Parse the axes, and sort them."""
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
        help="Keep these axes of the start transform, as `rz,tx`: tx ty tz are the camera's "
        "place along its axes, rx ry rz its rotation about them (x right, y down, z forward).",
    ),
    click.option(
        "--prior-translation-m",
        type=NUMBERS_AND_SIGMA,
        metavar="X Y Z SIGMA",
        help="The camera's place in the LiDAR frame is known beforehand, with this standard deviation along each axis; "
        "0: exactly.",
    ),
    click.option(
        "--prior-rotation-deg",
        type=NUMBERS_AND_SIGMA,
        metavar="R P Y SIGMA",
        help="The camera's roll, pitch and yaw in the LiDAR frame (as in URDF: yaw turns to the left, pitch looks "
        "down) are known beforehand, with this standard deviation about each axis; 0: exactly.",
    ),
)

PRIORS = ("--fix", "--prior-translation-m", "--prior-rotation-deg")
PRIOR_RULES = (
    given("--fix").requires("--init", "--init-rpy-xyz", because="it keeps axes of a transform"),
    given(*PRIORS).excludes("--cue features", because="it is weighed by the exact histogram"),
    given(*PRIORS).excludes("--no-polish", because="it is weighed after the polish"),
)


def prior_options(command: Command) -> Command:
    """Add the options for prior knowledge of the pose."""
    return with_options(command, PRIOR_OPTIONS)


def make_priors(
    options: Mapping[str, Any], initial_pose: InitialPose | None, max_baseline_m: float
) -> tuple[Prior, ...]:
    """Make priors of a command's options; exact ones come last.

    Raises:
        click.UsageError: no axis is left to estimate.
        InputError: the known place of the camera is farther from the LiDAR than is allowed.
    """
    from semcal_cli.assessment.priors import EXACT, Prior
    from semcal_cli.geometry.baseline import check_baseline
    from semcal_cli.geometry.poses import pose_from_mounting

    names = ("fix", "prior_translation_m", "prior_rotation_deg")
    fix, place, rotation = (options[name] for name in names)
    found = []
    if place is not None:
        *center_m, sigma_m = place
        T = pose_from_mounting((0.0, 0.0, 0.0), center_m)
        check_baseline("--prior-translation-m", T, max_baseline_m)
        found.append(Prior(_name("--prior-translation-m", place), T, (sigma_m,) * 3 + (UNKNOWN,) * 3))
    if rotation is not None:
        *rpy_deg, sigma_deg = rotation
        T = pose_from_mounting(rpy_deg, (0.0, 0.0, 0.0))
        sigma = math.radians(sigma_deg)
        found.append(Prior(_name("--prior-rotation-deg", rotation), T, (UNKNOWN,) * 3 + (sigma,) * 3))
    if fix is not None:
        assert initial_pose is not None  # by a rule of the command
        kept = tuple(0.0 if axis in fix else UNKNOWN for axis in AXES)
        found.append(Prior(f"--fix {','.join(fix)}", initial_pose.T_camera_lidar, kept))
    if found and all(min(sigmas) <= EXACT for sigmas in zip(*(prior.sigmas for prior in found), strict=True)):
        raise click.UsageError(f"{', '.join(p.name for p in found)}: leave nothing to be calibrated")
    return tuple(sorted(found, key=lambda prior: min(prior.sigmas) <= EXACT))


def _name(option: str, values: tuple[float, ...]) -> str:
    return " ".join([option, *(f"{value:g}" for value in values)])
