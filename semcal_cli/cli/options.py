"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypeVar

import click

from semcal_cli.cli.settings import PATH as PATH
from semcal_cli.cli.settings import Names, argument, option, output_file, setting_of
from semcal_cli.config import AUTO, MAX_FRAMES, MAX_POINTS, CalibrationConfig, CueName, Limits
from semcal_cli.config.cues import PLUGINS
from semcal_cli.files.writing import descriptor

Command = TypeVar("Command", bound=Callable[..., Any])
Direction: TypeAlias = Literal["lidar-to-camera", "camera-to-lidar"]

MAX_THREADS = 1024
MAX_MAX_POINTS = 2**32 - 1
"""Largest limit of the points of a sweep."""
MAX_LIMIT = 1e6
"""Largest limit in metres or degrees: no two transforms are farther apart."""

KNOWN_TRANSFORMS = "a calibration, a drive with its reference, or any format that `convert --formats` lists"
CUES = Names(PLUGINS.taken, alone=("features", "auto"), plugins=PLUGINS)
MANY_POINTS = "Refuse sweeps of more than N points, and their files if they have more than 64 bytes a point."


def result_file(
    help: str = "File of the result: .yaml, .yml or .json. Standard output, as YAML, if it is - or not given.",
) -> Any:
    """Make the option -o for the file of a result; standard output, however it is named, is None."""

    def callback(ctx: click.Context, param: click.Parameter, path: Path | None) -> Path | None:
        return None if path is not None and descriptor(path) == 1 else path

    return output_file(help, "-o", "--output", callback=callback)


def json_flag() -> Any:
    """Make the option for JSON on standard output."""
    return option("Print JSON.", "--json", default=False)


def max_points() -> Any:
    """Make the option for the points of the largest sweep that is read."""
    return option(MANY_POINTS, default=MAX_POINTS, least=1, most=MAX_MAX_POINTS)


def limit(of: str, default: float, metavar: str, **least: float) -> Any:
    """Make the option for the largest allowed difference of transforms."""
    return option(
        f"Largest allowed offset of the {of}.", default=default, metavar=metavar, most=MAX_LIMIT, **least
    )


def inconclusive_choice() -> Any:
    """Make the option that says what an inconclusive verdict is for CI."""
    return option(
        "What it is when the data cannot decide: an error (exit code 4), a failure (3) or skipped (0).",
        default="error",
    )


def cue_list() -> Any:
    """Make the option for cues."""
    return option(
        "Cues to compare, alone or together: auto (the best that the files of DRIVE allow); labels of points and "
        "images; edges (steps along the scans against gradients of the images, without any labels, from a start "
        "that is known to 5 degrees and 0.3 m); segments (parts of the sweeps by their shape, against labels of "
        "images alone, which give edges a start); intensity (the LiDAR's against the image's grey values, without "
        "any labels); or features (vectors of points and pixels, alone, by `semcal calibrate --estimator mine`).  "
        "[default: auto: labels, or, if points have none, segments,edges or what the files allow of both]",
        "--cue",
        default=AUTO,
        type=CUES,
        metavar="CUE[,CUE]",
        show_default=False,
    )


@dataclass(frozen=True, kw_only=True)
class QuietSettings:
    """The option of every command that shows its progress."""

    quiet: bool = option("Print nothing but the result and errors.", "-q", "--quiet", default=False)


@dataclass(frozen=True, kw_only=True)
class ThreadSettings(QuietSettings):
    """Options of every command that computes."""

    threads: int | None = option(
        "Threads to work on; all cores if not given. The result does not depend on it.",
        least=1,
        most=MAX_THREADS,
    )


@dataclass(frozen=True, kw_only=True)
class DriveSettings(QuietSettings):
    """Argument and option of every command that reads a drive."""

    drive: Path = argument()
    max_points: int = max_points()


@dataclass(frozen=True, kw_only=True)
class RunSettings(DriveSettings, ThreadSettings):
    """Options of every command that computes something of a drive."""

    verbose: bool = False
    """Whether figures for experts are shown as well."""


@dataclass(frozen=True, kw_only=True)
class EstimateSettings(RunSettings):
    """Options of every command that compares points and pixels of a drive."""

    seed: int = setting_of(CalibrationConfig, "seed")
    max_frames: int = setting_of(CalibrationConfig, "max_frames")
    cues: tuple[CueName, ...] = cue_list()


@dataclass(frozen=True, kw_only=True)
class ResultSettings(EstimateSettings):
    """Options of every command that writes a calibration."""

    output: Path | None = result_file()
    as_json: bool = option("Print the result as JSON, also with -o.", "--json", default=False)
    verbose: bool = option(
        "Also print the figures of each stage for experts.", "-v", "--verbose", default=False
    )
    log: Path | None = output_file("Write times, host and threads to a JSON file.")


@dataclass(frozen=True, kw_only=True)
class LimitSettings:
    """Options for the largest allowed difference of transforms."""

    max_translation_m: float = limit("camera", Limits.translation_m, "M", above=0.0)
    max_rotation_deg: float = limit("rotation", Limits.rotation_deg, "DEG", above=0.0)


def number_option(
    *names: str, least: int = 1, most: int | None = None, default: int | None = None, help: str
) -> Callable[[Command], Command]:
    """Make an option for a whole number, whose help shows its default.

    Args:
        names: Names of the option, and of its parameter if that is another.
        least: Smallest number.
        most: Largest number; None for any.
        default: Number if the option is not given; None for none.
        help: Sentence of the help.
    """
    return click.option(
        *names,
        type=click.IntRange(least, most),
        default=default,
        show_default=default is not None,
        metavar="N",
        help=help,
    )


drive_argument = click.argument("drive", type=PATH)
max_frames_option = number_option(
    "--max-frames",
    default=MAX_FRAMES,
    help="Use at most N frames of a longer drive, those whose label images differ most.",
)
max_points_option = number_option("--max-points", most=MAX_MAX_POINTS, default=MAX_POINTS, help=MANY_POINTS)
