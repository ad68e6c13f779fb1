"""`semcal experiment`: accuracy and speed, measured on synthetic drives on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, get_args

import click

from semcal_cli.cli.experiment_options import into_option, out_option, print_table, seeds_options
from semcal_cli.cli.experiment_trust import trust
from semcal_cli.cli.options import (
    KNOWN_TRANSFORMS,
    PATH,
    drive_argument,
    max_frames_option,
    max_points_option,
    number_option,
)
from semcal_cli.extras import check_torch

if TYPE_CHECKING:
    from semcal_cli.experiments.page_tables import Place

ESTIMATORS = ("exact", "mine")


@click.group()
def experiment() -> None:
    """Measure the figures of the documentation, on synthetic drives."""


@experiment.command()
@seeds_options(20, "Drives for each row.", first_seed=10_000)
@click.option(
    "--estimator",
    "estimators",
    type=click.Choice(ESTIMATORS),
    multiple=True,
    default=ESTIMATORS,
    show_default=True,
    help="Estimator to compare; may be given twice.",
)
@click.option(
    "--row",
    "rows",
    multiple=True,
    metavar="NAME",
    help="Only this row of the table, as 'network-like labels'; may be given again.",
)
@click.option("--edge-band", type=click.IntRange(0), metavar="PX", help="As in `calibrate`.")
@out_option
@into_option
def accuracy(
    seeds: int,
    first_seed: int,
    jobs: int,
    estimators: tuple[str, ...],
    rows: tuple[str, ...],
    edge_band: int | None,
    out: Path,
    into: Place | None,
) -> None:
    """Compare calibrations with the truth, over sensors, lenses, labels and starts.

    Takes about two minutes for each seed. Writes results.csv, summary.json, table.md and plot.png into a folder of DIR,
    and keeps its drives in a pool beside it, about 45 MB each. A stopped run resumes where it was.
    """
    from semcal_cli.cli.experiment_progress import experiment_progress
    from semcal_cli.config import EDGE_BAND_PX, Estimator
    from semcal_cli.experiments import accuracy, runner
    from semcal_cli.experiments.pool import Pool

    if "mine" in estimators:
        check_torch("semcal experiment accuracy --estimator mine")
    for row in rows:
        if row not in accuracy.ROWS:
            raise click.BadParameter(
                f"found {row!r}, needed one of: {', '.join(accuracy.ROWS)}", param_hint="--row"
            )
    band = EDGE_BAND_PX if edge_band is None else edge_band
    chosen: tuple[Estimator, ...] = tuple(name for name in get_args(Estimator) if name in estimators)
    # Runs with other settings resume where they were, each in its own folder.
    name = "_".join(
        ["accuracy", *(chosen if len(chosen) == 1 else ()), *(() if edge_band is None else (f"band{band}",))]
    )
    folder = runner.make_folder(out, name)
    cases = accuracy.cases(range(first_seed, first_seed + seeds), rows or tuple(accuracy.ROWS))
    run = accuracy.Experiment(Pool(out / "pool"), chosen, band)
    with experiment_progress(jobs) as watcher:
        results = runner.run_cases(cases, run, accuracy.Result, folder, jobs, watcher)
    print_table(accuracy.write_accuracy(results, jobs, folder), folder, into)


@experiment.command()
@seeds_options(20, "Drives for each row.", first_seed=80_000)
@click.option(
    "--row",
    "rows",
    multiple=True,
    metavar="NAME",
    help="Only this row of the table, as 'intrinsics wrong'; may be given again.",
)
@out_option
@into_option
def jointly(
    seeds: int, first_seed: int, jobs: int, rows: tuple[str, ...], out: Path, into: Place | None
) -> None:
    """Compare intrinsics and clocks that are estimated with the pose with the truth.

    Takes about two minutes for each seed. Writes results.csv, summary.json and table.md into a folder of DIR; a stopped
    run resumes where it was.
    """
    from semcal_cli.cli.experiment_progress import experiment_progress
    from semcal_cli.experiments import jointly, runner
    from semcal_cli.experiments.pool import Pool

    for row in rows:
        if row not in jointly.ROWS:
            raise click.BadParameter(
                f"found {row!r}, needed one of: {', '.join(jointly.ROWS)}", param_hint="--row"
            )
    folder = runner.make_folder(out, "jointly")
    chosen = jointly.cases(range(first_seed, first_seed + seeds), rows or tuple(jointly.ROWS))
    with experiment_progress(jobs) as watcher:
        run = jointly.Experiment(Pool(out / "pool"))
        results = runner.run_cases(chosen, run, jointly.Result, folder, jobs, watcher)
    print_table(jointly.write_jointly(results, jobs, folder), folder, into)


experiment.add_command(trust)


def _rivals_command(name: str, help: str) -> None:
    """Add a command that compares methods."""

    @experiment.command(name, help=help)
    @seeds_options(20, "Drives, a run in every box each.", first_seed=50_000)
    @click.option(
        "--unmended",
        is_flag=True,
        help="Leave isolated wrong pixels as they are for every method, as the paper's always does. Results go to a "
        "folder of their own.",
    )
    @out_option
    @into_option
    def compare(
        seeds: int, first_seed: int, jobs: int, unmended: bool, out: Path, into: Place | None
    ) -> None:
        from shutil import rmtree

        from semcal_cli.cli.experiment_progress import experiment_progress
        from semcal_cli.experiments import rivals, runner
        from semcal_cli.experiments.pool import Pool
        from semcal_cli.experiments.rivals_results import write_rivals

        check_torch(f"semcal experiment {name}")
        settings = rivals.EXPERIMENTS[name]
        folder = runner.make_folder(out, f"{name}_unmended" if unmended else name)
        scratch = folder / "drives"
        with experiment_progress(jobs) as watcher:
            findings = runner.run_cases(
                rivals.cases(settings, range(first_seed, first_seed + seeds)),
                rivals.Experiment(settings, Pool(scratch, has_pictures=True), not unmended),
                rivals.Finding,
                folder,
                jobs,
                watcher,
            )
        rmtree(scratch, ignore_errors=True)
        found = rivals.complete(findings, settings)
        print_table(write_rivals(name, found, jobs, folder, is_mended=not unmended), folder, into)


_rivals_command(
    "pairs",
    """Compare methods over the number of pairs: 1, 2, 5, 10, 20, 50 and 70.

    semcal, the paper's method, SOIC and PMI start at the same pose, 2 degrees and 0.2 m off; the paper's also at its
    own start, from nothing. Writes the same files as `accuracy`; a stopped run resumes where it was.
    """,
)
_rivals_command(
    "noise",
    """Compare methods over the share of wrong labels on both sides, 0 to 50 %, with 20 pairs.

    Otherwise as `pairs`; PMI does not look at labels.
    """,
)


@experiment.command()
@seeds_options(20, "Drives, a run of each optimiser on each.", first_seed=55_000)
@out_option
@into_option
def gradient(seeds: int, first_seed: int, jobs: int, out: Path, into: Place | None) -> None:
    """Compare gradient ascent with Powell's method on the same mutual information.

    Both start 2 degrees and 0.2 m off, with five pairs. Writes results.csv, summary.json and table.md into a folder of
    DIR; a stopped run resumes where it was.
    """
    from shutil import rmtree

    from semcal_cli.cli.experiment_progress import experiment_progress
    from semcal_cli.experiments import gradient, runner
    from semcal_cli.experiments.pool import Pool

    folder = runner.make_folder(out, "gradient")
    with experiment_progress(jobs) as watcher:
        findings = runner.run_cases(
            gradient.cases(range(first_seed, first_seed + seeds)),
            gradient.Experiment(Pool(folder / "drives")),
            gradient.Finding,
            folder,
            jobs,
            watcher,
        )
    rmtree(folder / "drives", ignore_errors=True)
    print_table(gradient.write_gradient(findings, jobs, folder), folder, into)


@experiment.command()
@drive_argument
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
    help="Frame that the pictures show, numbered from 0 among those used.",
)
@max_frames_option
@max_points_option
@out_option
@into_option
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
    """Compare methods on DRIVE, from the same start, with its reference.

    Writes results.csv, summary.json, table.md and the pictures (a) to (d) into the drive's folder of DIR: points at
    the reference, and where SOIC, PMI and semcal put them. If the reference is that of RELLIS-3D or KITTI-360, within 1
    degree and 10 cm, what the paper prints of it stands below it, measured on the same frames.
    """
    from semcal_cli.cli.outputs import check_outputs
    from semcal_cli.cli.search import read_initial_pose
    from semcal_cli.cli.terminal import make_console, progress_line
    from semcal_cli.config import MAX_BASELINE_M, CalibrationConfig
    from semcal_cli.drive.document import drive_file, read_drive
    from semcal_cli.drive.loading import load
    from semcal_cli.experiments import runner
    from semcal_cli.experiments.table import FILES, compare, write_table
    from semcal_cli.formats import read_transform

    check_torch("semcal experiment table")
    spec = read_drive(drive, max_points)
    T_reference = read_transform(reference or drive)
    initial_pose = None if init is None else read_initial_pose(init)
    if initial_pose is not None:
        initial_pose.check_distance(MAX_BASELINE_M)
    folder = runner.make_folder(out, f"table_{spec.root.resolve().name}")
    transforms = [drive_file(path) for path in (reference, init) if path is not None]
    check_outputs(
        [spec.path, *map(spec.resolve, spec.files()), *transforms], [folder / name for name in FILES]
    )
    with progress_line(make_console(quiet=False)) as progress:
        progress("reading frames")
        data = load(spec, CalibrationConfig(max_frames=max_frames))
        found = compare(data, T_reference, initial_pose, frame, progress)
    print_table(write_table(found, frame, folder), folder, into)


@experiment.command()
@number_option("--repeats", default=3, help="Number of runs of each process.")
@click.option(
    "--plain-torch",
    type=PATH,
    metavar="FILE",
    help="Compare with this script: tests/benchmarks/plain_torch.py of a clone.",
)
@click.option(
    "--only",
    type=click.Choice(["calibrate", "refine"]),
    help="Time only this command; the script is compared with refine.",
)
@number_option(
    "--frames", default=70, help="Number of frames that are rendered; the most pairs but for 1,000."
)
@click.option(
    "--width", type=click.IntRange(64), default=1280, show_default=True, help="Columns of the pictures."
)
@click.option(
    "--height", type=click.IntRange(48), default=720, show_default=True, help="Rows of the pictures."
)
@out_option
@into_option
def speed(
    repeats: int,
    plain_torch: Path | None,
    only: str | None,
    frames: int,
    width: int,
    height: int,
    out: Path,
    into: Place | None,
) -> None:
    """Time whole processes, and compare the refinement with the same in plain torch.

    Needs an idle machine, and takes about three minutes for each repeat. Writes the same files
    as `accuracy`; a stopped run resumes where it was.
    """
    from dataclasses import replace

    from semcal_cli.cli.experiment_progress import experiment_progress
    from semcal_cli.errors import InputError
    from semcal_cli.experiments import runner, speed

    check_torch("semcal experiment speed")
    if plain_torch is not None and not plain_torch.is_file():
        raise InputError(f"{plain_torch}: found no such file, needed the script to compare with")
    street = replace(speed.STREET, num_frames=frames, width=width, height=height)
    of_size = "" if street == speed.STREET else f"_{frames}_{width}x{height}"
    folder = runner.make_folder(out, f"speed{of_size}")
    commands = speed.COMMANDS if only is None else (only,)
    experiment = speed.Experiment(folder, plain_torch and plain_torch.resolve(), street, commands)
    with experiment_progress(1) as watcher:
        timings = runner.run_cases(
            experiment.cases(repeats),
            experiment,
            speed.Timing,
            folder,
            1,
            watcher,
        )
    print_table(speed.markdown(speed.write_speed(timings, folder)), folder, into)
