"""The options of both stages: the start, the search for the mounting, the refinement, and prior knowledge."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, cast

import click

from semcal_cli.cli.parameter_types import FiniteNumber, FiniteRange, Names
from semcal_cli.cli.rules import given
from semcal_cli.cli.settings import KNOWN_TRANSFORMS, option, setting_of
from semcal_cli.config import (
    AUTO,
    LABELS,
    AdjustmentConfig,
    CueName,
    Device,
    Estimator,
    InitializationConfig,
    RefinementConfig,
    Zoom,
)
from semcal_cli.config.directions import Direction
from semcal_cli.errors import ChoiceError, InputError, check_torch
from semcal_cli.files.output_files import descriptor

if TYPE_CHECKING:
    from semcal_cli.cli.options import DriveSettings
    from semcal_cli.estimation.adjust.priors import Prior
    from semcal_cli.estimation.search.initial_pose import InitialPose

ALL_ROLLS_DEG = 180.0
STARTS = ("--init", "--init-rpy-xyz")
AXES = ("tx", "ty", "tz", "rx", "ry", "rz")
PRIORS = ("--fix", "--prior-translation-m", "--prior-rotation-deg")
UNKNOWN = math.inf
NUMBERS_AND_SIGMA = (*[FiniteNumber()] * 3, FiniteRange(0.0))
MIN_SIGMA = 1e-9
"""Smallest standard deviation of estimated intrinsics: less would mean exact."""


class Roll(FiniteRange):
    """Degrees, or the word `any` for all in-plane rotations."""

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Parse the largest in-plane rotation in degrees."""
        return ALL_ROLLS_DEG if value == "any" else super().convert(value, param, ctx)


def read_initial_pose(
    path: Path,
    direction: Direction | None = None,
    *,
    direction_option: str | None = None,
    drive: Path | None = None,
    ignores_unasked: bool = False,
) -> InitialPose:
    """Read the transform to start from, or to verify.

    Args:
        path: The file.
        direction: Direction of a matrix whose file does not state it; None if it is not given.
        direction_option: Name of the command's option for the direction; None if it has none.
        drive: The drive, whose `frame_ids` name the frames of a file with several cameras or LiDARs.
        ignores_unasked: Whether the direction counts only for a file that does not state it; otherwise it is refused
            for other files.

    Raises:
        InputError: the file is not a transform, is ambiguous, or is standard input.
    """
    from semcal_cli.drive.document import drive_file, read_drive
    from semcal_cli.estimation.search.initial_pose import InitialPose
    from semcal_cli.formats import read_extrinsic
    from semcal_cli.formats.format import FormatOptions

    if path == Path("-") or descriptor(path) == 0:
        raise InputError(
            f"{path}: found standard input, expected a file: the result records its name and hash"
        )
    frame_ids = None
    with suppress(InputError):  # What is no drive, or a wrong one, is told where it is used.
        frame_ids = None if drive is None else read_drive(drive).frame_ids
    names = {} if direction_option is None else {"direction": direction_option}
    options = FormatOptions(direction, frame_ids=frame_ids, names=names)
    extrinsic = read_extrinsic(path, None, options, ignores_unasked=ignores_unasked)
    return InitialPose(
        extrinsic.T_camera_lidar,
        name=str(path),
        source=drive_file(path),
        direction=direction,
        record=extrinsic.record,
    )


@contextmanager
def as_far_as_named(drive: Path) -> Iterator[None]:
    """Leave open which sensors of a file are meant, where only a drive that is made later names them."""
    from semcal_cli.drive.document import drive_file
    from semcal_cli.files.documents import FORMATS

    try:
        yield
    except ChoiceError:
        file = drive_file(drive)
        if file.suffix.lower() in FORMATS and file.is_file():
            raise


@dataclass(frozen=True, kw_only=True)
class StartSettings:
    """Options for a transform to start from."""

    section = "Start"
    rules = [given("--init-direction").requires("--init"), given("--init").excludes("--init-rpy-xyz")]
    init: Path | None = option(
        f"Start from this transform instead of searching all mounting directions: {KNOWN_TRANSFORMS}.",
        metavar="FILE",
        brief="Start from this transform: a calibration, a drive with a reference, or a file of another tool.",
    )
    init_direction: Direction | None = option(
        "Direction of the matrix in the --init file, if the file does not state it: p_camera = T p_lidar, or p_lidar = "
        "T p_camera."
    )
    max_baseline_m: float = setting_of(RefinementConfig, "max_baseline_m")

    @cached_property
    def initial_pose(self) -> InitialPose | None:
        """Transform to start from; None if all mounting directions are searched.

        Raises:
            InputError: the file is not a transform, or the camera is too far from the LiDAR.
        """
        start = self._read_start()
        if start is not None:
            start.check_distance(self.max_baseline_m)
        return start

    def _read_start(self) -> InitialPose | None:
        if self.init is None:
            return None
        option, drive = "--init-direction", cast("DriveSettings", self).drive
        return read_initial_pose(self.init, self.init_direction, direction_option=option, drive=drive)


@dataclass(frozen=True, kw_only=True)
class SearchSettings(StartSettings):
    """Options for the search of the initial calibration."""

    section = "Start"
    rules = [
        given("--search-deg").requires(*STARTS),
        given("--roll").excludes(*STARTS, because="--search-deg searches around a transform"),
        given("--zoom").requires(
            "--search-deg", where=STARTS, because="without it, there is no search around a transform"
        ),
    ]
    init_rpy_xyz: tuple[float, ...] | None = option(
        "Start from this mounting, measured by hand: roll, pitch and yaw in degrees (as in URDF: positive yaw turns "
        "left, positive pitch looks down) of the camera's body frame (x forward, z up), and its position in metres, "
        "all in the LiDAR frame.",
        type=FiniteNumber(),
        nargs=6,
        metavar="R P Y X Y Z",
        brief="Start from a mounting measured by hand, in the LiDAR frame: degrees, 0 0 0 for a camera that looks "
        "along x, and metres.",
    )
    search_deg: float | None = setting_of(InitializationConfig, "search_deg")
    max_roll_deg: float = option(
        "Search in-plane rotations up to this angle from upright, in degrees; `any` for portrait and upside-down "
        f"cameras.  [default: {InitializationConfig.max_roll_deg:g}]",
        "--roll",
        type=Roll(0.0, ALL_ROLLS_DEG),
        default=InitializationConfig.max_roll_deg,
        metavar="DEG|any",
        show_default=False,
    )
    zoom: Zoom = setting_of(InitializationConfig, "zoom")

    @property
    def initialization(self) -> InitializationConfig:
        """Settings of the search."""
        return InitializationConfig(
            zoom=self.zoom,
            max_roll_deg=self.max_roll_deg,
            search_deg=self.search_deg,
        )

    def _read_start(self) -> InitialPose | None:
        if self.init_rpy_xyz is None:
            return super()._read_start()
        from semcal_cli.estimation.search.initial_pose import InitialPose
        from semcal_cli.geometry.poses import pose_from_mounting

        name = " ".join(["--init-rpy-xyz", *map(repr, self.init_rpy_xyz)])
        return InitialPose(pose_from_mounting(self.init_rpy_xyz[:3], self.init_rpy_xyz[3:]), name)


@dataclass(frozen=True, kw_only=True)
class RefinementSettings(StartSettings):
    """Options for the refinement of a pose, and for prior knowledge of it."""

    section = "Refinement"
    rules = [
        given("--device cuda").requires("--estimator mine", "--method paper"),
        given("--cue features").requires(
            "--estimator mine", "--method paper", because="feature vectors have no histogram"
        ),
        given("--cue segments").excludes(
            "--estimator mine", "--method paper", because="segments differ from frame to frame"
        ),
        given("--fix").requires(*STARTS, because="it keeps axes of the start transform"),
        given(*PRIORS).excludes("--cue features", because="priors need the exact estimator"),
        given(*PRIORS).excludes("--no-polish", because="priors are applied after the polish"),
        given("--refine-intrinsics", "--estimate-delay").excludes(
            *("--no-polish", "--cue features", *PRIORS),
            because="it follows the polish, needs the exact estimator, and takes no priors",
        ),
    ]
    estimator: Estimator = setting_of(RefinementConfig, "estimator")
    device: Device = setting_of(RefinementConfig, "device")
    edge_band_px: int = setting_of(RefinementConfig, "edge_band_px")
    no_polish: bool = option("Skip the final polish (Newton's method at full resolution).", default=False)
    intrinsics: tuple[str, ...] = option(
        "Estimate these intrinsics together with the pose, such as `fx,fy,cx,cy` or `fx,fy,cx,cy,k1,k2`: entries of K "
        "and parameters of the lens. The estimates are kept only if held-out data agree better with them.",
        "--refine-intrinsics",
        type=Names(needed="names such as fx,fy,cx,cy"),
        default=(),
        metavar="NAMES",
        show_default=False,
        brief="Also estimate these intrinsics, such as fx,fy,cx,cy.",
    )
    intrinsics_sigma: tuple[float, float] | None = option(
        "How well the drive's intrinsics are known: standard deviations of the focal lengths, in percent, and of the "
        "principal point, in pixels. They widen the interval; 0 0 means exact.  [default: `intrinsics_sigma` of the "
        "drive, or 0.1 1; with --refine-intrinsics, 2 10]",
        type=FiniteRange(0.0, 1e3),
        nargs=2,
        metavar="PERCENT PX",
    )
    estimate_delay: bool = option(
        "Estimate the time offset (how much later images are than their stamps say) together with the pose. Needs "
        "`motion:` with poses or a twist, varying speeds, and turns.",
        default=False,
        brief="Also estimate by how much images are late; needs `motion:`.",
    )
    fix: tuple[str, ...] | None = option(
        "Keep these axes of the start transform, such as `rz,tx`: tx ty tz are the camera's position along its axes, "
        "rx ry rz its rotation about them (x right, y down, z forward).",
        type=Names(AXES),
        metavar="AXES",
    )
    prior_translation_m: tuple[float, ...] | None = option(
        "Prior for the camera's position in the LiDAR frame, with its standard deviation along each axis; 0 means "
        "exact.",
        type=NUMBERS_AND_SIGMA,
        metavar="X Y Z SIGMA",
    )
    prior_rotation_deg: tuple[float, ...] | None = option(
        "Prior for the camera's roll, pitch and yaw in the LiDAR frame (as in URDF: positive yaw turns left, positive "
        "pitch looks down), with its standard deviation about each axis; 0 means exact.",
        type=NUMBERS_AND_SIGMA,
        metavar="R P Y SIGMA",
    )

    def check_estimator(self) -> None:
        """Check that torch is installed if MINE is chosen.

        Raises:
            InputError: it is not installed.
        """
        if self.estimator == "mine":
            check_torch("--estimator mine")

    def known_cues(self, cues: tuple[CueName, ...]) -> tuple[CueName, ...]:
        """Return the cues to compare; MINE defaults to labels."""
        return LABELS if self.estimator == "mine" and cues == AUTO else cues

    @property
    def refinement(self) -> RefinementConfig:
        """Settings of the refinement.

        Raises:
            click.UsageError: intrinsics are to be estimated and are stated to be exact.
        """
        jointly = AdjustmentConfig(self.intrinsics, with_delay=self.estimate_delay)
        if self.intrinsics_sigma is not None:
            focal_percent, center_px = self.intrinsics_sigma
            if self.intrinsics and min(self.intrinsics_sigma) < MIN_SIGMA:
                raise click.UsageError(
                    f"--intrinsics-sigma: found {focal_percent:g} {center_px:g}, needed at least {MIN_SIGMA:g} for "
                    "both with --refine-intrinsics."
                )
            sigmas = 0.01 * focal_percent, center_px
            jointly = AdjustmentConfig(self.intrinsics, *sigmas, with_delay=self.estimate_delay)
        return RefinementConfig(
            self.estimator,
            self.device,
            not self.no_polish,
            self.max_baseline_m,
            self.edge_band_px,
            jointly,
        )

    @cached_property
    def priors(self) -> tuple[Prior, ...]:
        """Prior knowledge of the pose; exact knowledge comes last.

        Raises:
            click.UsageError: no axis is left to estimate.
            InputError: the prior puts the camera farther from the LiDAR than is allowed.
        """
        from semcal_cli.estimation.adjust.priors import EXACT, Prior
        from semcal_cli.geometry.poses import check_baseline, pose_from_mounting

        priors = []
        if self.prior_translation_m is not None:
            *center_m, sigma_m = self.prior_translation_m
            T = pose_from_mounting((0.0, 0.0, 0.0), center_m)
            check_baseline("--prior-translation-m", T, self.max_baseline_m)
            name = _name("--prior-translation-m", self.prior_translation_m)
            priors.append(Prior(name, T, (sigma_m,) * 3 + (UNKNOWN,) * 3))
        if self.prior_rotation_deg is not None:
            *rpy_deg, sigma_deg = self.prior_rotation_deg
            T = pose_from_mounting(rpy_deg, (0.0, 0.0, 0.0))
            name = _name("--prior-rotation-deg", self.prior_rotation_deg)
            priors.append(Prior(name, T, (UNKNOWN,) * 3 + (math.radians(sigma_deg),) * 3))
        if self.fix is not None:
            assert self.initial_pose is not None  # by a rule
            kept = tuple(0.0 if axis in self.fix else UNKNOWN for axis in AXES)
            priors.append(Prior(f"--fix {','.join(self.fix)}", self.initial_pose.T_camera_lidar, kept))
        if priors and all(
            min(sigmas) <= EXACT for sigmas in zip(*(prior.sigmas for prior in priors), strict=True)
        ):
            names = ", ".join(prior.name for prior in priors)
            raise click.UsageError(f"{names}: found all six axes known exactly, expected one that is not")
        return tuple(sorted(priors, key=lambda prior: min(prior.sigmas) <= EXACT))


def _name(option: str, values: tuple[float, ...]) -> str:
    return " ".join([option, *(f"{value:g}" for value in values)])
