"""Options that several commands share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.parameter_types import Names
from semcal_cli.cli.settings import argument, option, output_file, setting_of
from semcal_cli.config import AUTO, MAX_POINTS, CalibrationConfig, CueName, Limits
from semcal_cli.config.cues import PLUGINS
from semcal_cli.files.output_files import descriptor

if TYPE_CHECKING:
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.drive.document import Drive

MAX_THREADS = 1024
MAX_MAX_POINTS = 2**32 - 1
"""Largest value of --max-points."""
MAX_LIMIT = 1e6
"""Largest limit in metres, degrees or milliseconds: no two transforms are farther apart."""


class FrameSlice(click.ParamType):  # type: ignore[type-arg]
    """START:STOP:STEP as in Python."""

    name = "START:STOP:STEP"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> slice:
        """Parse the slice."""
        if isinstance(value, slice):
            return value
        try:
            parts = [int(part) if part else None for part in str(value).split(":")]
        except ValueError:
            parts = []
        if len(parts) not in (2, 3) or (len(parts) == 3 and parts[2] is not None and parts[2] < 1):
            needed = "START:STOP or START:STOP:STEP, with a step of at least 1"
            self.fail(f"found {str(value)[:40]!r}, expected {needed}.", param, ctx)
        return slice(*parts)


CUES = Names(PLUGINS.own_names, alone=("features", "auto"), plugins=PLUGINS)
MANY_POINTS = "Largest sweep to accept, in points."


def result_file(
    help: str = "File for the result: .yaml, .yml or .json. If it is - or not given, YAML goes to standard output.",
    default: Path | None = None,
    **about: Any,
) -> Any:
    """Make the option -o for the result file; standard output is None, however it is named."""

    def callback(ctx: click.Context, param: click.Parameter, path: Path | None) -> Path | None:
        return None if path is not None and descriptor(path) == 1 else path

    return output_file(help, "-o", "--output", callback=callback, default=default, **about)


def json_flag() -> Any:
    """Make the option for JSON on standard output."""
    return option("Print JSON.", "--json", default=False)


def max_points() -> Any:
    """Make the option for the size of the largest sweep that is read."""
    return option(MANY_POINTS, default=MAX_POINTS, minimum=1, maximum=MAX_MAX_POINTS)


def limit(of: str, default: float, metavar: str, **minimum: float) -> Any:
    """Make the option for the largest allowed difference between transforms."""
    return option(
        f"Largest allowed offset of the {of}.", default=default, metavar=metavar, maximum=MAX_LIMIT, **minimum
    )


def reference_direction() -> Any:
    """Make the option for the direction of transforms whose files do not state it."""
    return option(
        "Direction of a matrix whose file does not state it: p_camera = T p_lidar, or p_lidar = T p_camera."
    )


def inconclusive_choice() -> Any:
    """Make the option for how CI counts an inconclusive verdict."""
    return option(
        "How to count an inconclusive verdict: as an error (exit code 4), a failure (3) or skipped (0).",
        default="error",
    )


def cue_list() -> Any:
    """Make the option for cues."""
    return option(
        "What to compare points and pixels by: labels (of both), segments (of sweeps, with image labels), edges "
        "(without labels, from a start within 5 degrees and 0.3 m), intensity, features (vectors, by `semcal "
        "calibrate --estimator mine`), or several, such as segments,edges.  "
        "[default: auto, the best that the files of DRIVE allow]",
        "--cue",
        default=AUTO,
        type=CUES,
        metavar="CUE[,CUE]",
        show_default=False,
        brief="What to compare: labels, segments, edges, intensity, features, or several, such as segments,edges.  "
        "[default: auto, the best that the files allow]",
    )


@dataclass(frozen=True, kw_only=True)
class QuietSettings:
    """The option of every command that shows its progress."""

    quiet: bool = option(
        "Print only errors and the verdict or result, if there is one.", "-q", "--quiet", default=False
    )
    verbose: bool = False
    """Whether to show expert figures, too."""

    def terminal(self) -> Terminal:
        """Make the terminal that shows what the command does."""
        from semcal_cli.cli.terminal import Terminal

        return Terminal(quiet=self.quiet, verbose=self.verbose)


@dataclass(frozen=True, kw_only=True)
class ThreadSettings(QuietSettings):
    """Options of every command that computes."""

    threads: int | None = option(
        "Number of threads; all cores if not given. It does not affect the result.",
        minimum=1,
        maximum=MAX_THREADS,
    )


@dataclass(frozen=True, kw_only=True)
class JobSettings(QuietSettings):
    """Options of every command that runs another one on many drives."""

    jobs: int | None = option("Number of drives to run in parallel.  [default: 1]", minimum=1)
    threads: int | None = option(
        "Threads per drive.  [default: cores / jobs]", minimum=1, maximum=MAX_THREADS
    )
    timeout_s: float | None = option("Time limit per drive, in seconds.", "--timeout", above=0.0, metavar="S")

    @property
    def num_threads(self) -> int:
        """Threads for each drive."""
        from semcal_cli.threads import num_cores

        return self.threads or max(num_cores() // (self.jobs or 1), 1)


@dataclass(frozen=True, kw_only=True)
class DriveSettings(QuietSettings):
    """Argument and options of every command that reads a drive."""

    drive: Path = argument()
    max_points: int = max_points()


@dataclass(frozen=True, kw_only=True)
class RunSettings(DriveSettings, ThreadSettings):
    """Options of every command that computes something from a drive."""

    def read_drive(self) -> Drive:
        """Read the drive.

        Raises:
            InputError: the drive is wrong.
        """
        from semcal_cli.drive.document import read_drive

        return read_drive(self.drive, self.max_points)


@dataclass(frozen=True, kw_only=True)
class EstimateSettings(RunSettings):
    """Options of every command that compares points and pixels of a drive."""

    seed: int = setting_of(CalibrationConfig, "seed")
    max_frames: int = setting_of(CalibrationConfig, "max_frames")
    frames: slice | None = option(
        "Use these frames alone, counted from 0, such as 0:100:10.", type=FrameSlice()
    )
    exclude: tuple[str, ...] = option(
        "Leave out a frame, by the name of its cloud without folder and suffix, as messages state it. Give the option "
        "again for each frame.",
        brief="Leave out a frame, by its name; give it again for others.",
        metavar="FRAME",
        multiple=True,
        default=(),
    )
    cues: tuple[CueName, ...] = cue_list()
    options_file: Path | None = option(
        "Take options from a YAML file, too. What is typed comes first.", "--config", metavar="FILE"
    )

    def read_drive(self) -> Drive:
        """Read the drive, with the chosen frames.

        Raises:
            InputError: the drive is wrong, there is no such frame, or none is left.
        """
        from semcal_cli.observations.frame_selection import chosen_frames

        return chosen_frames(super().read_drive(), self.frames, self.exclude)


@dataclass(frozen=True, kw_only=True)
class ResultSettings(EstimateSettings):
    """Options of every command that writes a calibration."""

    output: Path | None = result_file()
    as_json: bool = option("Print the result as JSON, even with -o.", "--json", default=False)
    verbose: bool = option("Also print detailed figures of each stage.", "-v", "--verbose", default=False)
    log: Path | None = output_file("Write timings, host and number of threads to a JSON file.")


@dataclass(frozen=True, kw_only=True)
class LimitSettings:
    """Options for the largest allowed difference between transforms."""

    max_translation_m: float = limit("camera", Limits.translation_m, "M", above=0.0)
    max_rotation_deg: float = limit("rotation", Limits.rotation_deg, "DEG", above=0.0)


@dataclass(frozen=True, kw_only=True)
class RecordingSettings:
    """Options for a recording or a data set in the place of a drive."""

    section = "Recordings and data sets"
    points: str | None = option(
        "Topic of a recording's sweeps; needed if there are several.", metavar="TOPIC"
    )
    image: str | None = option("Topic of a recording's images; needed if there are several.", metavar="TOPIC")
    camera_file: Path | None = option(
        "Take a recording's intrinsics from a file: a ROS camera_info, a Kalibr camchain or an OpenCV FileStorage.",
        "--intrinsics",
        metavar="FILE",
    )
    sequence: str | None = option(
        "Name of a data set's sequence; needed if there are several.", metavar="NAME"
    )
    camera: str | None = option("Name of a data set's camera.", metavar="NAME")
