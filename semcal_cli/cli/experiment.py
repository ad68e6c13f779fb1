"""`semcal experiment`: accuracy and speed, measured on synthetic drives on this machine."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import click

from semcal_cli.cli.experiment_options import (
    measures,
    number_option,
    out_options,
    print_table,
    rows_option,
    seeds_options,
)
from semcal_cli.cli.options import MANY_POINTS, MAX_MAX_POINTS
from semcal_cli.cli.settings import KNOWN_TRANSFORMS, PATH
from semcal_cli.config import MAX_FRAMES, MAX_POINTS, CalibrationConfig, Estimator
from semcal_cli.config.setting import settings_of
from semcal_cli.errors import check_torch

if TYPE_CHECKING:
    from semcal_cli.experiments.experiment import Experiment
    from semcal_cli.experiments.page_tables import Place

ESTIMATORS = get_args(Estimator)
PARTS = ("good", "bad", "spoiled", "subtle", "verify")
"""Parts of the experiment on trust; MINE runs on the good drives."""


@click.group()
def experiment() -> None:
    """Measure the figures in the documentation, on synthetic drives."""


@experiment.command()
@seeds_options(20, "Number of drives per row.", first_seed=10_000)
@click.option(
    "--estimator",
    "estimators",
    type=click.Choice(ESTIMATORS),
    multiple=True,
    default=ESTIMATORS,
    show_default=True,
    help="Estimator to compare; may be given twice.",
)
@rows_option("accuracy", "network-like labels")
@click.option("--edge-band", type=click.IntRange(0), metavar="PX", help="As in `calibrate`.")
@measures
def accuracy(
    out: Path, seeds: range, estimators: tuple[str, ...], rows: tuple[str, ...], edge_band: int | None
) -> Experiment[Any, Any]:
    """Compare calibrations with the truth.

    The rows of the table are sensors, lenses, labels and starts. Takes about two minutes per seed. Writes results.csv,
    summary.json and table.md to a folder in DIR, and keeps its drives in a pool next to it, about 45 MB each. A stopped
    run resumes where it stopped.
    """
    from semcal_cli.experiments import accuracy

    if "mine" in estimators:
        check_torch("semcal experiment accuracy --estimator mine")
    return accuracy.experiment(out, seeds, rows, estimators, edge_band)


@experiment.command()
@seeds_options(20, "Number of drives per row.", first_seed=80_000)
@rows_option("jointly", "intrinsics wrong")
@measures
def jointly(out: Path, seeds: range, rows: tuple[str, ...]) -> Experiment[Any, Any]:
    """Compare joint estimates of intrinsics and clocks with the truth.

    Takes about two minutes per seed. Writes results.csv, summary.json and table.md to a folder in DIR; a stopped run
    resumes where it stopped.
    """
    from semcal_cli.experiments import jointly

    return jointly.experiment(out, seeds, rows)


@experiment.command()
@seeds_options(
    60,
    "Number of drives. Each takes six calibrations unchanged, two with the same classes wrong in all frames, five of "
    "impossible variants, and 15 verifications.",
    first_seed=20_000,
)
@click.option(
    "--only",
    "parts",
    type=click.Choice(PARTS),
    multiple=True,
    default=PARTS,
    help="Run only this part; may be repeated. Together with others, `spoiled` and `subtle` spoil only every fifth "
    "drive.",
)
@click.option(
    "--limits",
    "with_limits",
    is_flag=True,
    help="Instead, compare what each check finds on good and on bad drives with its limit. Takes 19 calibrations per "
    "drive.",
)
@measures
def trust(out: Path, seeds: range, parts: tuple[str, ...], with_limits: bool) -> Experiment[Any, Any]:
    """Count how often intervals and verdicts are right.

    Counts how often intervals contain the truth, verdicts are right, and `verify` detects offsets. Drives are also
    spoiled the way real recordings are, and given subtle faults: no result should be trusted and wrong. Takes about two
    minutes per drive, and seven per spoiled drive. Writes the same files as `accuracy`; a stopped run resumes where it
    was.
    """
    from semcal_cli.experiments import limits, trust_table

    if with_limits:
        if parts != PARTS:
            raise click.UsageError("--limits has no parts: leave out --only")
        return limits.experiment(out, seeds)
    if "good" in parts:  # every fifth drive is also calibrated with MINE
        check_torch("semcal experiment trust --only good")
    return trust_table.experiment(out, seeds, parts)


def _compares(declare: Callable[..., Experiment[Any, Any]]) -> click.Command:
    """Make a command from a function that declares an experiment which compares methods."""
    unmended = click.option(
        "--unmended",
        is_flag=True,
        help="Leave isolated wrong pixels as they are for every method; the paper's method always does. Results go to "
        "a separate folder.",
    )
    drives = seeds_options(20, "Number of drives, each with one run per table cell.", first_seed=50_000)
    return experiment.command()(drives(unmended(measures(declare))))


def _rivals(name: str, out: Path, seeds: range, unmended: bool) -> Experiment[Any, Any]:
    from semcal_cli.experiments import rivals

    check_torch(f"semcal experiment {name}")
    return rivals.experiment(out, seeds, name, is_mended=not unmended)


@_compares
def pairs(**options: Any) -> Experiment[Any, Any]:
    """Compare methods over the number of pairs.

    The numbers are 1, 2, 5, 10, 20, 50 and 70. semcal, the paper's method, SOIC and PMI start from the same pose, 2
    degrees and 0.2 m off; the paper's method also runs from its own start, without an initial guess. Writes the same
    files as `accuracy`, and plot.png; a stopped run resumes where it stopped.
    """
    return _rivals("pairs", **options)


@_compares
def noise(**options: Any) -> Experiment[Any, Any]:
    """Compare methods over the share of wrong labels.

    The share is 0 to 50 % on both sides, with 20 pairs. Otherwise as `pairs`; PMI does not use labels.
    """
    return _rivals("noise", **options)


@experiment.command()
@seeds_options(20, "Number of drives, each with one run per optimiser.", first_seed=55_000)
@measures
def gradient(out: Path, seeds: range) -> Experiment[Any, Any]:
    """Compare gradient ascent with Powell's method.

    Both maximise the same mutual information, and start 2 degrees and 0.2 m off, with five pairs. Writes results.csv,
    summary.json and table.md to a folder in DIR; a stopped run resumes where it stopped.
    """
    from semcal_cli.experiments import gradient

    return gradient.experiment(out, seeds)


@experiment.command()
@click.argument("drive", type=PATH)
@click.option(
    "--reference",
    type=PATH,
    metavar="FILE|DRIVE",
    help=f"Reference: {KNOWN_TRANSFORMS}.  [default: the drive's own]",
)
@click.option(
    "--init",
    type=PATH,
    metavar="FILE|DRIVE",
    help="Start of all methods.  [default: semcal's initial calibration]",
)
@number_option(
    "--frame",
    least=0,
    default=0,
    help="Frame that the images show, counted from 0 among the frames used.",
)
@number_option("--max-frames", default=MAX_FRAMES, help=settings_of(CalibrationConfig)["max_frames"].help)
@number_option("--max-points", most=MAX_MAX_POINTS, default=MAX_POINTS, help=MANY_POINTS)
@out_options
def table(
    drive: Path,
    reference: Path | None,
    init: Path | None,
    frame: int,
    max_frames: int,
    max_points: int,
    out: Path,
    into: Place | None,
) -> None:
    """Compare methods on DRIVE with its reference.

    All methods start from the same pose. Writes results.csv, summary.json, table.md and the images (a) to (d) to the
    drive's folder in DIR: the points at the reference, and where SOIC, PMI and semcal put them. If the reference is
    within 1 degree and 10 cm of that of RELLIS-3D or KITTI-360, the poses that the paper reports are listed below it,
    measured on the same frames.
    """
    from semcal_cli.cli.outputs import check_outputs
    from semcal_cli.cli.stages import read_initial_pose
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.config import MAX_BASELINE_M
    from semcal_cli.drive.document import drive_file, read_drive
    from semcal_cli.drive.loading import load
    from semcal_cli.experiments.experiment import prepare_folder
    from semcal_cli.experiments.table import FILES, compare, write_table
    from semcal_cli.formats import read_transform

    check_torch("semcal experiment table")
    spec = read_drive(drive, max_points)
    T_reference = read_transform(reference or drive)
    initial_pose = None if init is None else read_initial_pose(init)
    if initial_pose is not None:
        initial_pose.check_distance(MAX_BASELINE_M)
    folder = out / f"table_{spec.root.resolve().name}"
    prepare_folder(folder)
    transforms = [drive_file(path) for path in (reference, init) if path is not None]
    check_outputs(
        [spec.path, *map(spec.resolve, spec.files()), *transforms], *(folder / name for name in FILES)
    )
    with Terminal(quiet=False) as terminal:
        terminal.show("reading frames")
        data = load(spec, CalibrationConfig(max_frames=max_frames))
        found = compare(data, T_reference, initial_pose, frame, terminal.show)
    print_table(write_table(found, frame, folder), folder, into)


@experiment.command()
@number_option("--repeats", default=3, help="Number of runs of each process.")
@click.option(
    "--plain-torch",
    type=PATH,
    metavar="FILE",
    help="Compare with this script: tests/benchmarks/plain_torch.py in a clone.",
)
@click.option(
    "--only",
    type=click.Choice(["calibrate", "refine"]),
    help="Time only this command; the script is compared with refine.",
)
@number_option(
    "--frames",
    default=70,
    help="Number of frames to render, which is also the largest number of pairs besides 1,000.",
)
@number_option("--width", least=64, default=1280, help="Columns of the images.")
@number_option("--height", least=48, default=720, help="Rows of the images.")
@measures
def speed(
    out: Path, repeats: int, plain_torch: Path | None, only: str | None, frames: int, width: int, height: int
) -> Experiment[Any, Any]:
    """Time whole processes, and the refinement against plain torch.

    Needs an idle machine, and takes about three minutes per repeat. Writes the same files as `accuracy`; a stopped run
    resumes where it stopped.
    """
    from dataclasses import replace

    from semcal_cli.experiments import speed

    check_torch("semcal experiment speed")
    street = replace(speed.STREET, num_frames=frames, width=width, height=height)
    commands = speed.COMMANDS if only is None else (only,)
    return speed.experiment(out, repeats, street, plain_torch, commands)
