"""`semcal batch`: one command on many drives."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from semcal_cli.cli import EXIT_STOPPED
from semcal_cli.cli.calibrate import calibrate
from semcal_cli.cli.calibrate_options import CalibrateSettings
from semcal_cli.cli.ci import EXIT_CODES, Case, CiReport
from semcal_cli.cli.options import MAX_THREADS, JobSettings
from semcal_cli.cli.rules import given, refuse
from semcal_cli.cli.settings import argument, option
from semcal_cli.cli.settings_command import SettingsCommand, command, without_option
from semcal_cli.cli.verify import VerifySettings, verify
from semcal_cli.errors import torch_import

if TYPE_CHECKING:
    from semcal_cli.many.batch.tasks import Outcome, Task
    from semcal_cli.pipeline.verdict import Verdict

COMMANDS: dict[str, SettingsCommand[Any]] = {"calibrate": calibrate, "verify": verify}
OURS = (
    *("-o", "--log", "--threads", "--quiet", "--report", "--overlay", "--json", "--junit", "--inconclusive"),
    *("--to", "--to-direction", "--to-frame", "--to-camera", "--to-lidar"),
)
"""Options of these commands that a batch sets itself, or that name a single file."""
REST = "semcal.rest"


class WithRest(SettingsCommand["BatchSettings"]):
    """A command that passes on the arguments after --."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments before --, and keep those after it."""
        if "--" in args:
            place = args.index("--")
            ctx.meta[REST] = args[place + 1 :]
            args = args[:place]
        return super().parse_args(ctx, args)

    def collect_usage_pieces(self, ctx: click.Context) -> list[str]:
        """Add the arguments after -- to the usage line."""
        return [*super().collect_usage_pieces(ctx), "[-- OPTIONS OF THE COMMAND]"]


@dataclass(frozen=True, kw_only=True)
class BatchSettings(JobSettings):
    """Settings of `batch`."""

    rules = [
        given("--command verify").requires("--calibration"),
        given("--calibration").requires("--command verify"),
        given("--dask").excludes("--jobs", because="the workers' threads set the number of jobs"),
    ]
    drives: tuple[str, ...] = argument()
    output: Path = option("Folder for the results.", "-o", "--output", required=True, metavar="DIR")
    command: Literal["calibrate", "verify"] = option("Command to run.", default="calibrate")
    calibration: Path | None = option("Transform to verify, with --command verify.", metavar="FILE")
    threads: int | None = option(
        "Threads per drive.  [default: cores / jobs; with --dask, 1]", minimum=1, maximum=MAX_THREADS
    )
    force: bool = option("Run finished drives again.", default=False)
    dask: str | None = option(
        "Run on this Dask cluster, tcp://HOST:PORT, with shared storage.", metavar="ADDRESS"
    )

    @property
    def num_threads(self) -> int:
        """Threads for each drive."""
        return self.threads or (1 if self.dask is not None else super().num_threads)


@command(BatchSettings, cls=WithRest)
def batch(settings: BatchSettings) -> None:
    """Calibrate many DRIVES, or verify one transform on them.

    DRIVES are drives, folders of drives, drive files, quoted patterns, text files (.txt) with one of these per line, or
    - for standard input. Everything after -- goes to the command: semcal batch drives -o results -- --estimator mine

    Results go to DIR. Each drive gets a folder with calibration.yaml (or verification.json), log.txt, times.json and
    record.json; summary.csv and summary.jsonl list all drives, including those that fail, crash or hang. A stopped
    batch resumes where it stopped. A drive is run again only if its files, the options or the version changed, or if
    the machine failed, for instance because the disk was full. DIR must be separate from the drives and hold no other
    results.

    Exits with the worst code of any drive (1, then 3, 4, 0).

    --calibration accepts {KNOWN_TRANSFORMS}.
    """
    from semcal_cli.cli.batch_progress import BatchProgress, print_end
    from semcal_cli.cli.worker import run_task
    from semcal_cli.many.batch.cluster import connect, execute_on
    from semcal_cli.many.batch.records import worst_exit_code
    from semcal_cli.many.batch.run import execute_here, run_batch

    tasks, num_jobs, folder = _make_tasks(settings), settings.jobs or 1, settings.output.absolute()
    with ExitStack() as stack:
        client = None if settings.dask is None else stack.enter_context(connect(settings.dask))
        show = stack.enter_context(BatchProgress(len(tasks), num_jobs, settings.quiet))
        if client is None:
            execute = execute_here(folder, num_jobs, run_task, show.begin)
        else:
            execute = execute_on(client, folder, run_task)
        try:
            outcomes = run_batch(tasks, folder, execute, force=settings.force, on_done=show.tell)
        except KeyboardInterrupt:
            stack.close()
            done = f"{show.num_done:,} of {len(tasks):,} drives are done"
            click.echo(f"semcal: stopped: {done}; run the same command again for the others", err=True)
            sys.exit(EXIT_STOPPED)
    print_end(show.console, outcomes, settings.output)
    _report(settings, outcomes).tell_github()
    sys.exit(worst_exit_code(outcome.exit_code for outcome in outcomes))


def _report(settings: BatchSettings, outcomes: Sequence[Outcome]) -> CiReport:
    """Make a test case of each drive; a drive with an error counts as failed."""
    from semcal_cli.pipeline.verdict import together

    verdicts: dict[int, Verdict] = {code: verdict for verdict, code in EXIT_CODES.items()}
    drive_verdicts = [verdicts.get(run.exit_code, "fail") for run in outcomes]
    cases = [
        Case(run.drive, verdict, "; ".join([run.status, *run.reasons[:1]]))
        for run, verdict in zip(outcomes, drive_verdicts, strict=True)
    ]
    return CiReport(f"batch {settings.command}", str(settings.output), together(drive_verdicts), cases)


def _make_tasks(settings: BatchSettings) -> list[Task]:
    """List the tasks: the command on each drive, with a results folder each."""
    from semcal_cli.many.batch.folders import check_folders
    from semcal_cli.many.batch.tasks import find_drives, folder_of

    make = _task_maker(settings)
    drives, folder = find_drives(settings.drives, sys.stdin), settings.output.absolute()
    tasks: list[Task] = [
        make(drive, path=str(Path(drive).absolute()), folder=str(folder / folder_of(drive)))
        for drive in drives
    ]
    check_folders(tasks, folder, settings.output)
    return tasks


def _task_maker(settings: BatchSettings) -> partial[Task]:
    """Check what goes to the command, once for all drives, and make tasks that only lack the drive.

    Files are named by absolute paths, because other machines have other working folders.
    """
    from semcal_cli.drive.document import drive_file
    from semcal_cli.many.batch.tasks import Task

    rest: list[str] = click.get_current_context().meta.get(REST, [])
    calibration, command_settings = settings.calibration, _parse_rest(settings, rest)
    files = [] if calibration is None else [calibration]
    named = dict[str, list[Path | str]]()
    if command_settings.options_file is not None:
        named["--config"] = [command_settings.options_file.absolute()]
    if isinstance(command_settings, CalibrateSettings):
        if settings.dask is None:
            command_settings.check_estimator()
            if command_settings.device == "cuda":
                with torch_import():
                    from semcal_cli.estimation.refine.mine import check_device

                check_device("cuda")
        named |= _files(settings, command_settings)
    for name, values in named.items():
        files += [value for value in values if isinstance(value, Path)]
        rest = [*without_option(rest, name), *(word for value in values for word in (name, str(value)))]
    if calibration is not None:
        rest = [str(calibration.absolute()), *rest]
    return partial(
        Task,
        command=settings.command,
        arguments=tuple(rest),
        other_files=tuple(str(drive_file(path).absolute()) for path in files),
        num_threads=settings.num_threads,
        max_points=command_settings.max_points,
        timeout_s=settings.timeout_s,
    )


def _files(settings: BatchSettings, command_settings: CalibrateSettings) -> dict[str, list[Path | str]]:
    """List the files of each option, by absolute paths.

    Networks of the hub are fetched once for all drives; Dask's workers fetch them by name, into their own caches.
    """
    from semcal_cli.labelling.hub import find_model, is_hub_name

    files: dict[str, list[Path | str]] = {"--image-model": []}
    with settings.terminal() as terminal:
        for name in command_settings.image_model:
            if settings.dask is not None and is_hub_name(name):
                files["--image-model"].append(name)
            else:
                path = find_model(name, command_settings.max_download_mb, terminal.on_event)
                files["--image-model"].append(path.absolute())
    if command_settings.init is not None:
        files["--init"] = [command_settings.init.absolute()]
    if (
        command_settings.image_model
        and command_settings.image_card is not None
        and Path(command_settings.image_card).exists()
    ):
        files["--image-card"] = [Path(command_settings.image_card).absolute()]
    return files


def _parse_rest(settings: BatchSettings, rest: list[str]) -> CalibrateSettings | VerifySettings:
    """Parse the options that go to the command, and check everything that can be checked without a drive."""
    if "--" in rest:
        raise click.UsageError("-- --: found a second --, expected options of the command")
    name, run = settings.command, COMMANDS[settings.command]
    arguments = ["DRIVE"] if settings.calibration is None else ["DRIVE", str(settings.calibration)]
    root = click.get_current_context().parent
    with run.make_context(name, [*arguments, *rest], root) as context:
        refuse(context, OURS, "cannot be used with many drives")
        command_settings: CalibrateSettings | VerifySettings = run.settings_in(context)
        try:
            command_settings.check()
        except click.UsageError as error:
            error.ctx = context
            raise
    return command_settings
