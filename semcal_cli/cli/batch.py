"""`semcal batch`: one command on many drives."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import click

from semcal_cli.cli.calibrate import calibrate
from semcal_cli.cli.calibrate import settings_of as settings_of_calibrate
from semcal_cli.cli.ci import EXIT_CODES, Case, CiReport
from semcal_cli.cli.options import (
    KNOWN_TRANSFORMS,
    MAX_THREADS,
    PATH,
    FiniteRange,
    choice_option,
    number_option,
    quiet_option,
)
from semcal_cli.cli.refinement import check_estimator
from semcal_cli.cli.rules import CheckedCommand, Options, given, refuse
from semcal_cli.cli.verify import settings_of as settings_of_verify
from semcal_cli.cli.verify import verify
from semcal_cli.errors import torch_import

if TYPE_CHECKING:
    from semcal_cli.assessment.limits import Verdict
    from semcal_cli.batch.tasks import Outcome, Task

EXIT_STOPPED = 130
Check: TypeAlias = Callable[[Mapping[str, Any]], object]
"""Checks the values of a command's parameters without a drive."""
COMMANDS: dict[str, tuple[click.Command, Check]] = {
    "calibrate": (calibrate, settings_of_calibrate),
    "verify": (verify, settings_of_verify),
}
"""The commands, each with the function that checks its options without a drive."""
OURS = (
    *("-o", "--log", "--threads", "--quiet", "--report", "--overlay", "--json", "--junit", "--inconclusive"),
    *("--to", "--to-direction", "--to-frame", "--to-camera", "--to-lidar"),
)
"""Options of these commands that a batch sets itself, or that name one file although there are many drives."""
REST = "semcal.rest"


class WithRest(CheckedCommand):
    """A command that passes the arguments after -- on."""

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


@click.command(
    cls=WithRest,
    rules=[
        given("--command verify").requires("--calibration"),
        given("--calibration").requires("--command verify"),
        given("--dask").excludes("--jobs", because="the cluster has as many as its workers' threads"),
    ],
    help=f"""Calibrate many DRIVES, or verify one transform on them.

    DRIVES are folders, drive files, patterns in quotes, text files (.txt) with one of these a line, or - for standard
    input. Whatever follows -- goes to the command, as in: semcal batch 'drives/*' -o results -- --estimator mine

    Results go to DIR: of each drive a folder with calibration.yaml (or verification.json), log.txt, times.json and
    record.json, and of all summary.csv and summary.jsonl. A drive that fails, crashes or hangs is a line there.
    A batch that was stopped goes on where it was; a drive is done again only if its files, the options or the version
    changed, or if the machine failed, as with a full disk. DIR must be apart from the
    drives and hold no other results. Exit code: the worst of all drives, 1 over 3 over 4 over 0.

    FILE is {KNOWN_TRANSFORMS}.
    """,
)
@click.argument("drives", nargs=-1, required=True)
@click.option("-o", "--output", type=PATH, required=True, metavar="DIR", help="Folder of the results.")
@choice_option("--command", list(COMMANDS), default="calibrate", help="Command to run.")
@click.option("--calibration", type=PATH, metavar="FILE", help="Transform to verify, with --command verify.")
@number_option("--jobs", help="Number of drives at a time.  [default: 1]")
@number_option(
    "--threads", most=MAX_THREADS, help="Threads for each drive.  [default: cores by jobs; with --dask, 1]"
)
@click.option(
    "--timeout",
    "timeout_s",
    type=FiniteRange(0.0, min_open=True),
    metavar="S",
    help="Longest time for one drive.",
)
@click.option("--force", is_flag=True, help="Run finished drives again.")
@click.option(
    "--dask",
    "address",
    metavar="ADDRESS",
    help="Run on this Dask cluster, tcp://HOST:PORT, on shared storage.",
)
@quiet_option
def batch(
    drives: tuple[str, ...],
    output: Path,
    command: str,
    calibration: Path | None,
    jobs: int | None,
    threads: int | None,
    timeout_s: float | None,
    force: bool,
    address: str | None,
    quiet: bool,
) -> None:
    """Run a command on many drives."""
    from semcal_cli.batch.cluster import connect, execute_on
    from semcal_cli.batch.records import worst
    from semcal_cli.batch.run import execute_here, run_batch
    from semcal_cli.cli.batch_end import print_end
    from semcal_cli.cli.batch_progress import BatchProgress
    from semcal_cli.cli.worker import run_task
    from semcal_cli.threads import num_cores

    num_jobs = jobs or 1
    num_threads = threads or (1 if address is not None else max(num_cores() // num_jobs, 1))
    tasks = _make_tasks(drives, output, command, calibration, num_threads, timeout_s, address is None)
    folder = output.absolute()
    with ExitStack() as stack:
        client = None if address is None else stack.enter_context(connect(address))
        show = stack.enter_context(BatchProgress(len(tasks), num_jobs, quiet))
        if client is None:
            execute = execute_here(folder, num_jobs, run_task, show.begin)
        else:
            execute = execute_on(client, folder, run_task)
        try:
            outcomes = run_batch(tasks, folder, execute, force=force, on_done=show.tell)
        except KeyboardInterrupt:
            stack.close()
            done = f"{show.num_done:,} of {len(tasks):,} drives are done"
            click.echo(f"semcal: stopped: {done}; the same command does the others", err=True)
            sys.exit(EXIT_STOPPED)
    print_end(show.console, outcomes, output)
    _report(command, output, outcomes).tell_github()
    sys.exit(worst(outcome.exit_code for outcome in outcomes))


def _report(command: str, output: Path, outcomes: Sequence[Outcome]) -> CiReport:
    """Make a case of each drive; one that failed fails, too."""
    from semcal_cli.assessment.limits import together

    verdicts: dict[int, Verdict] = {code: verdict for verdict, code in EXIT_CODES.items()}
    cases = [
        Case(each.drive, verdicts.get(each.exit_code, "fail"), "; ".join([each.status, *each.reasons[:1]]))
        for each in outcomes
    ]
    worst = together(case.verdict for case in cases)
    return CiReport(f"batch {command}", str(output), worst, cases)


def _make_tasks(
    drives: tuple[str, ...],
    output: Path,
    command: str,
    calibration: Path | None,
    num_threads: int,
    timeout_s: float | None,
    is_here: bool,
) -> list[Task]:
    """List the tasks: the command on each drive, with its results below the folder.

    Raises:
        click.UsageError: the command has no such option, or the batch sets it.
        InputError: there are no drives, a transform is invalid, or the results would lie among files that are not
            theirs.
    """
    from semcal_cli.batch.folders import check_apart, check_distinct_folders, check_made_by_batch
    from semcal_cli.batch.tasks import Task, find_drives, folder_of

    rest, also, max_points = _take_rest(command, calibration, is_here)
    found = find_drives(drives, sys.stdin)
    check_distinct_folders(found)
    check_apart(found, output)
    folder = output.absolute()
    tasks = [
        Task(
            drive,
            path=str(Path(drive).absolute()),
            folder=str(folder / folder_of(drive)),
            command=command,
            arguments=tuple(rest),
            also=tuple(also),
            num_threads=num_threads,
            max_points=max_points,
            timeout_s=timeout_s,
        )
        for drive in found
    ]
    check_made_by_batch(tasks, folder, output)
    return tasks


def _take_rest(command: str, calibration: Path | None, is_here: bool) -> tuple[list[str], list[str], int]:
    """Check the options that go to the command, once for all drives.

    Returns:
        The options with absolute paths, their files, and the points of the largest sweep that they allow.

    Raises:
        click.UsageError: the command has no such option, options exclude one another, or the batch sets one.
        InputError: a transform is invalid, or this machine, where the drives are to run, lacks torch or the
            device.
    """
    from semcal_cli.drive.document import drive_file

    rest: list[str] = click.get_current_context().meta.get(REST, [])
    values = _checked_parameters(command, calibration, rest)
    if is_here:
        check_estimator(values)
    if is_here and values.get("device") == "cuda":
        with torch_import():
            from semcal_cli.refinement.mine import check_device

        check_device("cuda")
    init: Path | None = values.get("init")
    named = [path for path in (calibration, init) if path is not None]
    if init is not None:
        # Other machines have other working folders; the last value of a repeated option counts.
        rest = [*rest, "--init", str(init.absolute())]
    if (model := values.get("image_model")) is not None:
        named.append(model)
        rest = [*rest, "--image-model", str(model.absolute())]
        if (card := values["image_card"]) is not None and Path(card).exists():
            named.append(Path(card))
            rest = [*rest, "--image-card", str(Path(card).absolute())]
    if calibration is not None:
        rest = [str(calibration.absolute()), *rest]
    return rest, [str(drive_file(path).absolute()) for path in named], values["max_points"]


def _checked_parameters(command: str, calibration: Path | None, rest: list[str]) -> dict[str, Any]:
    """Parse the options that go to the command, and check all that can be said about them without a drive.

    Raises:
        click.UsageError: the command has no such option, options exclude one another, or the batch sets one.
        InputError: a transform is invalid.
    """
    from semcal_cli.batch.tasks import RESULTS

    if "--" in rest:
        raise click.UsageError("-- --: found -- once more, needed options of the command")
    arguments = ["DRIVE"] if calibration is None else ["DRIVE", str(calibration)]
    run, check = COMMANDS[command]
    root = click.get_current_context().parent
    result = {"output": RESULTS[command]}
    with run.make_context(command, [*arguments, *rest], root, default_map=result) as context:
        refuse(Options(context), OURS, "is not for many drives")
        try:
            check(context.params)
        except click.UsageError as error:
            error.ctx = context
            raise
    return context.params
