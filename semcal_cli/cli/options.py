"""Options that several commands share."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any, TypeVar, get_args

import click

from semcal_cli.config import (
    AUTO,
    MAX_POINTS,
    CalibrationConfig,
    CueName,
    Limits,
    RefinementConfig,
)
from semcal_cli.config.setting import settings_of
from semcal_cli.files.writing import STANDARD_INPUT, STANDARD_OUTPUT, descriptor


class _Finite(click.ParamType[float]):
    """A number that is neither NaN nor infinity."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Parse the number, and check that it is finite."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{number} is not a finite number.", param, ctx)
        return number


class FiniteNumber(_Finite, click.types.FloatParamType):
    """A finite number: NaN and infinity are refused."""


class FiniteRange(_Finite, click.FloatRange):
    """A range of finite numbers: NaN and infinity are refused."""


Command = TypeVar("Command", bound=Callable[..., Any])
AnyOptions = TypeVar("AnyOptions", bound="RunOptions")


class InputFile(click.Path):
    """A file to read; `-` is standard input."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Make the path."""
        return STANDARD_INPUT if value == "-" else super().convert(value, param, ctx)


class OutputFile(click.Path):
    """A file to write; `-` is standard output."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Make the path."""
        return STANDARD_OUTPUT if value == "-" else super().convert(value, param, ctx)


PATH = click.Path(path_type=Path)
INPUT_FILE = InputFile(path_type=Path)
OUTPUT_FILE = OutputFile(path_type=Path)

MAX_THREADS = 1024
MAX_MAX_POINTS = 2**32 - 1
"""Largest limit of the points of a sweep."""
MAX_LIMIT = 1e6
"""Largest limit in metres or degrees: no two transforms are farther apart."""

KNOWN_TRANSFORMS = "a calibration, a drive with its reference, or any format that `convert --formats` lists"


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


def choice_option(
    name: str, choices: Sequence[str], *, default: str, help: str
) -> Callable[[Command], Command]:
    """Make an option for one of some words, whose help shows its default.

    Args:
        name: Name of the option.
        choices: The words.
        default: Word if the option is not given.
        help: Sentence of the help.
    """
    return click.option(name, type=click.Choice(choices), default=default, show_default=True, help=help)


def setting_option(
    config: type, name: str, *, help: str = "{}", is_open: bool = False
) -> Callable[[Command], Command]:
    """Make the option of a setting: its name, type, limits, default and help stand in the configuration.

    Args:
        config: Class of the configuration.
        name: Field of the setting, and name of the parameter.
        help: Sentence of the help, around that of the setting.
        is_open: Whether the value is None if the option is not given, as something else may be its default.
    """
    found = settings_of(config)[name]
    kind: click.ParamType[Any] = click.Choice(found.choices)
    if not found.choices and found.kind is int:
        kind = click.IntRange(found.least, found.most)  # type: ignore[arg-type]
    elif not found.choices:
        least, most = (
            x if y is None else y for x, y in ((found.least, found.above), (found.most, found.below))
        )
        kind = FiniteRange(least, most, min_open=found.above is not None, max_open=found.below is not None)
    told = f"  [default: {found.default}]" if is_open else ""
    return click.option(
        found.option or f"--{name.replace('_', '-')}",
        name,
        type=kind,
        default=None if is_open else found.default,
        show_default=not is_open and found.default is not None,
        metavar=None if found.choices else found.metavar,
        help=help.format(found.help) + told,
    )


def with_options(command: Command, options: Sequence[Callable[[Command], Command]]) -> Command:
    """Add options to a command, whose help shows them in this order."""
    for option in reversed(options):
        command = option(command)
    return command


drive_argument = click.argument("drive", type=PATH)


def file_or_stdout(help: str) -> Callable[[Command], Command]:
    """Make the option -o for the file of a result; standard output, however it is named, is None."""

    def callback(ctx: click.Context, param: click.Parameter, path: Path | None) -> Path | None:
        return None if path is not None and descriptor(path) == 1 else path

    return click.option("-o", "--output", type=OUTPUT_FILE, callback=callback, metavar="FILE", help=help)


output_option = file_or_stdout(
    "File of the result: .yaml, .yml or .json. Standard output, as YAML, if it is - or not given."
)
log_option = click.option(
    "--log", type=OUTPUT_FILE, metavar="FILE", help="Write times, host and threads to a JSON file."
)
verbose_option = click.option(
    "-v", "--verbose", is_flag=True, help="Also print the figures of each stage for experts."
)
json_only_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
junit_option = click.option("--junit", type=OUTPUT_FILE, metavar="FILE", help="Also write a JUnit XML file.")
json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON, also with -o.")
quiet_option = click.option("-q", "--quiet", is_flag=True, help="Print nothing but the result and errors.")
seed_option = setting_option(CalibrationConfig, "seed")
threads_option = number_option(
    "--threads",
    most=MAX_THREADS,
    help="Threads to work on; all cores if not given. The result does not depend on it.",
)
max_frames_option = setting_option(CalibrationConfig, "max_frames")
max_points_option = number_option(
    "--max-points",
    most=MAX_MAX_POINTS,
    default=MAX_POINTS,
    help="Refuse sweeps of more than N points, and their files if they have more than 64 bytes a point.",
)


def report_option(about: str) -> Callable[[Command], Command]:
    """Make the option for a page about something."""
    return click.option(
        "--report",
        "page",
        type=OUTPUT_FILE,
        metavar="FILE",
        help=f"Also write a page about {about}: .html.",
    )


def overlay_option(help: str) -> Callable[[Command], Command]:
    """Make the option for a folder of pictures."""
    return click.option("--overlay", "images", type=PATH, metavar="DIR", help=help)


def limit_options(*, may_be_zero: bool) -> Callable[[Command], Command]:
    """Add the options for the largest allowed difference of transforms."""
    limit = partial(
        click.option, type=FiniteRange(0.0, MAX_LIMIT, min_open=not may_be_zero), show_default=True
    )
    translation = limit(
        "--max-translation-m",
        default=Limits.translation_m,
        metavar="M",
        help="Largest allowed offset of the camera.",
    )
    rotation = limit(
        "--max-rotation-deg",
        default=Limits.rotation_deg,
        metavar="DEG",
        help="Largest allowed offset of the rotation.",
    )
    return lambda command: rotation(translation(command))


max_baseline_option = setting_option(RefinementConfig, "max_baseline_m")


class CueList(click.ParamType[tuple[str, ...]]):
    """Names of cues, separated by commas."""

    name = "cues"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, ...]:
        """Parse the names."""
        if isinstance(value, tuple):
            return value
        names = tuple(str(value).split(","))
        if not set(names) <= set(CUES):
            self.fail(f"found {value!r}, needed some of {', '.join(CUES)}.", param, ctx)
        if len(set(names)) < len(names):
            self.fail(f"found {value!r}, needed each cue once.", param, ctx)
        if "features" in names and len(names) > 1:
            self.fail(f"found {value!r}, but features go alone.", param, ctx)
        if "auto" in names and len(names) > 1:
            self.fail(f"found {value!r}, but auto goes alone.", param, ctx)
        return tuple(name for name in CUES if name in names)


CUES = get_args(CueName)

cue_option = click.option(
    "--cue",
    "cues",
    type=CueList(),
    default=AUTO,
    metavar="CUE[,CUE]",
    help="Cues to compare, alone or together: auto (the best that the files of DRIVE allow); labels of points and "
    "pictures; edges (steps along the scans against gradients of the pictures, without any labels, from a start that "
    "is known to 5 degrees and 0.3 m); segments (parts of the sweeps by their shape, against labels of pictures alone, "
    "which give edges a start); intensity (the LiDAR's against the picture's grey values, without any labels); or "
    "features (vectors of points and pixels, alone, by `semcal calibrate --estimator mine`).  [default: auto: labels, "
    "or, if points have none, segments,edges or what the files allow of both]",
)


@dataclass(frozen=True)
class RunOptions:
    """Options of every command that loads a drive."""

    threads: int | None
    """Number of threads of the Rust stages; None takes all."""
    quiet: bool
    """Whether only errors are shown."""
    max_points: int = MAX_POINTS
    """Points of the largest sweep that is read."""
    verbose: bool = False
    """Whether figures for experts are shown as well."""


@dataclass(frozen=True, kw_only=True)
class ResultOptions(RunOptions):
    """Options of every command that computes a calibration."""

    output: Path | None
    log: Path | None
    seed: int
    max_frames: int
    cues: tuple[CueName, ...]
    as_json: bool = False
    """Whether the result is printed as JSON, whatever else it is written to."""


def asked(kind: type[AnyOptions], values: Mapping[str, Any]) -> AnyOptions:
    """Make an object of those options of a command that have the names of its fields."""
    return kind(**{each.name: values[each.name] for each in fields(kind) if each.name in values})


def result_options(command: Command) -> Command:
    """Add the options of every command that computes a calibration."""
    for option in (
        cue_option,
        max_points_option,
        max_frames_option,
        log_option,
        quiet_option,
        verbose_option,
        threads_option,
        seed_option,
        json_option,
        output_option,
    ):
        command = option(command)
    return command
