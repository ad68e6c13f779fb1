"""`semcal calibrate`: the whole pipeline."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.convert import FormatName, format_options, open_options
from semcal_cli.cli.label import (
    IMAGE_RULES,
    ImageLabels,
    image_labels_of,
    image_options,
    label_on_the_way,
)
from semcal_cli.cli.options import (
    ResultOptions,
    asked,
    choice_option,
    drive_argument,
    number_option,
    overlay_option,
    report_option,
    result_options,
)
from semcal_cli.cli.paper import PAPER_RULES, make_paper, paper_options
from semcal_cli.cli.priors import PRIORS
from semcal_cli.cli.refinement import (
    REFINEMENT_RULES,
    check_estimator,
    make_refinement,
    refinement_options,
)
from semcal_cli.cli.rules import CheckedCommand, given
from semcal_cli.cli.search import SEARCH_RULES, STARTS, make_search, search_options
from semcal_cli.config import AUTO, LABELS, CalibrationConfig
from semcal_cli.files.writing import takes_several

if TYPE_CHECKING:
    from semcal_cli.assessment.priors import Prior
    from semcal_cli.cli.outputs import Outputs
    from semcal_cli.experiments.baselines.config import PaperConfig
    from semcal_cli.formats.format import FormatOptions
    from semcal_cli.initialization.initial_pose import InitialPose
    from semcal_cli.result.calibration import Calibration

BEYOND_LABELS = ("--cue segments", "--cue edges", "--cue intensity", "--cue features")
METHOD_RULES = (
    given(
        *("--search-deg", "--zoom", "--estimator", "--edge-band", "--no-polish", "--repeat", "--split"),
        *("--refine-intrinsics", "--intrinsics-sigma", "--estimate-delay", *PRIORS),
    ).requires("--method mi"),
    given("--seed", "--roll", "--device", *BEYOND_LABELS).requires("--method mi", "--method paper"),
    *PAPER_RULES,
    given(*BEYOND_LABELS).requires(*STARTS, where=["--method paper"], because="Alg. 2 is by labels"),
)
OUTPUT_RULES = (
    given("--to-direction", "--to-frame", "--to-camera", "--to-lidar").requires("--to"),
    given("--to").requires("-o", where=["--json"], because="both would write to standard output"),
    given("--split").requires("-o", because="it writes several files, which are named after that one"),
    given("--split").excludes("--to", because="it writes whole results"),
    given("--split").excludes(
        "--no-polish", "--cue features", because="frames are compared after the polish"
    ),
)
METHODS = ("mi", "paper", "soic")


@click.command(
    cls=CheckedCommand,
    rules=(*METHOD_RULES, *IMAGE_RULES, *SEARCH_RULES, *REFINEMENT_RULES, *OUTPUT_RULES),
)
@drive_argument
@image_options
@choice_option(
    "--method",
    METHODS,
    default="mi",
    help="Mutual information as semcal maximises it; the paper's method as published, without anything of semcal's "
    "own; or SOIC, a rival that needs the same class names on both sides. The last two are there to compare with, and "
    "do not estimate their uncertainty.",
)
@search_options
@refinement_options
@paper_options
@number_option(
    "--repeat",
    least=2,
    help="Calibrate with N seeds, and report their scatter beside the stated uncertainty.",
)
@click.option(
    "--split",
    is_flag=True,
    help="Where the camera was moved in mid-drive, also calibrate each part of the drive on its own, and write "
    "OUT_part_1.yaml, OUT_part_2.yaml and so on beside -o OUT.yaml, and the same for --log. The exit code is then "
    "that of the worst part; --report and --overlay show the whole drive.",
)
@click.option(
    "--to",
    type=FormatName(),
    metavar="FORMAT",
    help="Write only the transform, in a format that `convert --formats` lists.",
)
@open_options("to-", "what is written with --to")
@report_option("the result")
@overlay_option("Also write overlays of the points, before and after, for at most 20 frames.")
@result_options
def calibrate(
    drive: Path,
    **options: Any,
) -> None:
    """Calibrate the camera and the LiDAR of DRIVE, a folder with a drive.yaml or the file itself.

    Needs no start guess: all mounting directions are searched, then the best pose is refined. Exit code 3 means that
    an answer was written but is not trusted.

    DRIVE may be a rig.yaml, which names the drives of several cameras of one LiDAR: all are calibrated, and -o is a
    folder for the result of each and for rig_calibration.yaml, with each camera beside each other.
    """
    from semcal_cli.rig.document import find_rig

    check_estimator(options)
    settings = settings_of(options)
    common, config, initial_pose = settings.common, settings.config, settings.initial_pose
    run = partial(_by_method(settings), config=config, initial_pose=initial_pose)
    if (rig := find_rig(drive)) is not None:
        from semcal_cli.cli.rig import calibrate_rig

        sys.exit(calibrate_rig(rig, run, common, config))
    if settings.image_labels is not None:
        drive = _labelled(drive, settings.image_labels, common)
    if settings.is_split:
        from semcal_cli.cli.split import calibrate_parts

        sys.exit(calibrate_parts(drive, run, settings.outputs, common, config, initial_pose))
    sys.exit(_calibrate_drive(drive, run, settings.outputs, common, config, initial_pose))


@dataclass(frozen=True)
class Settings:
    """What the options of `calibrate` say, whatever the drive."""

    method: str
    """One of `METHODS`."""
    common: ResultOptions
    config: CalibrationConfig
    initial_pose: InitialPose | None
    priors: tuple[Prior, ...]
    paper: PaperConfig | None
    """Settings of the paper's method; None for another one."""
    outputs: Outputs
    is_split: bool
    """Whether each part of a drive is calibrated in which the camera was moved."""
    image_labels: ImageLabels | None
    """The network that labels pictures on the way; None if the drive has labels."""


def settings_of(values: Mapping[str, Any]) -> Settings:
    """Check all that can be said about the options without the drive, and make settings of them.

    Args:
        values: Values of the command's parameters, by their names.

    Raises:
        click.UsageError: options do not go together that no rule is about.
        InputError: the file of `--init` is not a transform, or a pose puts the camera too far from the LiDAR.
    """
    from semcal_cli.cli.outputs import Outputs

    options = dict(values)
    is_paper = options["method"] == "paper"
    if options["method"] != "mi" and options["cues"] == AUTO:
        options["cues"] = LABELS
    image_labels = image_labels_of(options)
    search_config, initial_pose = make_search(options)
    to, opened = options["to"], format_options(options, "to_")
    max_baseline_m = search_config.alignment.max_baseline_m
    paper = make_paper(options, search_config) if is_paper else None
    options["estimator"] = "mine" if is_paper else options["estimator"]
    refinement, priors = make_refinement(options, max_baseline_m, initial_pose)
    common = asked(ResultOptions, options)
    config = CalibrationConfig(
        common.seed,
        common.cues,
        common.max_frames,
        search_config,
        refinement,
        options["repeat"] or 1,
        is_raw=is_paper,
    )
    formatted = None if to is None else _formatted(to, opened)
    page, images = options["page"], options["images"]
    outputs = Outputs(common.output, common.log, formatted, page, images, common.as_json)
    if options["split"] and outputs.output is not None and takes_several(outputs.output):
        raise click.UsageError(f"--split: found {outputs.output}, needed -o with a file: it writes several.")
    return Settings(
        options["method"],
        common,
        config,
        initial_pose,
        priors,
        paper,
        outputs,
        options["split"],
        image_labels,
    )


def _formatted(to: str, options: Mapping[str, Any]) -> tuple[str, FormatOptions]:
    from semcal_cli.formats.format import FormatOptions

    return to, FormatOptions(**options)


def _by_method(settings: Settings) -> Callable[..., Calibration]:
    """Choose the calibration function of a method."""
    if settings.method == "soic":
        from semcal_cli.experiments.baselines.soic import calibrate_by_soic

        return calibrate_by_soic
    if settings.paper is not None:
        from semcal_cli.experiments.baselines.paper import calibrate_as_published

        return partial(calibrate_as_published, paper=settings.paper)
    from semcal_cli.pipeline import calibrate

    return partial(calibrate, priors=settings.priors)


def _labelled(drive: Path, labels: ImageLabels, common: ResultOptions) -> Path:
    """Label the pictures of a drive on the way, and return the labelled drive."""
    from semcal_cli.cli.terminal import Terminal

    with Terminal(quiet=common.quiet, verbose=common.verbose) as terminal:
        return label_on_the_way(drive, labels, common.max_frames, common.max_points, terminal)


def _calibrate_drive(
    drive: Path,
    run: Callable[..., Calibration],
    outputs: Outputs,
    common: ResultOptions,
    config: CalibrationConfig,
    initial_pose: InitialPose | None,
) -> int:
    """Calibrate one camera, write the result, and return the exit code."""
    from semcal_cli.cli.drive import loaded_drive

    with loaded_drive(drive, config, outputs, common, initial_pose) as (data, terminal):
        calibration = run(data, relative_to=outputs.folder, on_event=terminal.on_event)
    return outputs.write(calibration, terminal, common.threads, data.drive)
