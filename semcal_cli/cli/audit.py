"""`semcal audit`: whether the calibrations that a data set delivers hold, camera by camera, and since when not."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, NamedTuple

import click

from semcal_cli.cli.ci import Case, CiReport
from semcal_cli.cli.options import JobSettings, LimitSettings, cue_list, json_flag
from semcal_cli.cli.settings import argument, option, output_file
from semcal_cli.cli.settings_command import command
from semcal_cli.config import CalibrationConfig, CueName, Limits
from semcal_cli.errors import InputError

if TYPE_CHECKING:
    from semcal_cli.drive.document import Drive
    from semcal_cli.many.audit.audited_drives import Audit, AuditedDrive
    from semcal_cli.many.batch.tasks import Outcome, Task


@dataclass(frozen=True, kw_only=True)
class AuditSettings(LimitSettings, JobSettings):
    """Settings of `audit`."""

    drives: tuple[str, ...] = argument(metavar="DRIVES|RIGS...")
    output: Path = output_file("File for the page: .html.", "-o", "--output", required=True)
    as_json: bool = json_flag()
    junit: Path | None = output_file("Also write a JUnit XML file, with a case for each drive.")
    results: Path | None = option(
        "Keep the verification and the log of each drive in this folder, as a batch does: an audit that was stopped "
        "goes on from there.",
        metavar="DIR",
    )
    cues: tuple[CueName, ...] = cue_list()

    @property
    def arguments(self) -> tuple[str, ...]:
        """Options of `verify` for each drive."""
        limits = ("--max-translation-m", self.max_translation_m, "--max-rotation-deg", self.max_rotation_deg)
        return ("--cue", ",".join(self.cues), *map(str, limits))


@command(AuditSettings)
def audit(settings: AuditSettings) -> None:
    """Verify the calibrations that a data set delivers, and write one page about them.

    DRIVES are drives, folders of drives, drive files, quoted patterns, text files (.txt) with one of these per line,
    or - for standard input. RIGS are rig.yaml files or their folders, all of whose cameras are verified.

    Each drive is verified against its own T_camera_lidar, as by `semcal verify DRIVE`. The page groups the drives by
    camera, in the order of their recording, states which axis is off since when and by how much, and shows the points
    at the delivered and at the found pose.

    Exits with the worst code of any drive (1, then 3, 4, 0).
    """
    from semcal_cli.cli.output_checks import check_outputs, check_page, files_read
    from semcal_cli.drive.document import drive_file
    from semcal_cli.files.output_files import write_text
    from semcal_cli.many.audit.audit_page import audit_page_html
    from semcal_cli.many.audit.audited_drives import group_by_camera
    from semcal_cli.many.batch.records import worst_exit_code

    check_page(settings.output)
    names, rigs, broken = _find_drives(settings.drives)
    documents = _read(names)
    # An argument may be a list of drives. A drive that is wrong is read, too.
    read = [*map(Path, settings.drives), *rigs, *(drive_file(Path(drive)) for drive in names)]
    read += chain.from_iterable(map(files_read, documents.values()))
    check_outputs(read, settings.output, settings.junit)
    with _folder(settings.results) as folder:
        outcomes = [*broken, *_verify(_tasks(names, folder, settings), folder, settings)]
        drives = [_audited(outcome, folder) for outcome in outcomes]
    audited = group_by_camera(drives, documents, {drive: name for drive, name in names.items() if name})
    report = _report(settings, audited)
    if settings.junit is not None:
        write_text(report.junit(), settings.junit)
    if settings.as_json:
        click.echo(json.dumps(audited.document, allow_nan=False))
    else:
        _print(audited)
    terminal, limits = settings.terminal(), Limits(settings.max_rotation_deg, settings.max_translation_m)
    with terminal:
        config = CalibrationConfig(cues=settings.cues)
        write_text(audit_page_html(audited, documents, limits, config, terminal.show), settings.output)
    terminal.print_path("report", settings.output)
    report.tell_github()
    sys.exit(worst_exit_code(outcome.exit_code for outcome in outcomes))


class _Chosen(NamedTuple):
    """Drives to audit, each once."""

    names: dict[str, str]
    """Name of the camera of each drive; empty for a drive of no rig."""
    rigs: list[Path]
    """Files of the rigs."""
    broken: list[Outcome]
    """Outcomes of the rigs that are wrong."""


def _find_drives(arguments: tuple[str, ...]) -> _Chosen:
    """Find the drives, also those of rigs.

    Raises:
        InputError: there is no drive.
    """
    from semcal_cli.drive.document import RIG_FILE, drive_file
    from semcal_cli.files.input_files import is_folder
    from semcal_cli.many.batch.tasks import Outcome, find_drives
    from semcal_cli.many.rig.rig_document import find_rig

    by_file: dict[str, tuple[str, str]] = {}
    rigs, broken = list[Path](), list[Outcome]()
    for name in find_drives(arguments, sys.stdin):
        # What cannot be read becomes a line of the page.
        try:
            rig = find_rig(Path(name)) if os.access(name, os.R_OK) else None
        except InputError as error:
            rigs.append(Path(name) / RIG_FILE if is_folder(Path(name)) else Path(name))
            broken.append(Outcome(drive=name, status="failed", exit_code=1, reasons=(str(error),)))
            continue
        cameras = {"": name}
        if rig is not None:
            rigs.append(rig.path)
            cameras = {
                name: os.path.normpath(rig.path.parent / view.drive) for name, view in rig.views.items()
            }
        for camera, drive in cameras.items():
            file = os.path.realpath(drive_file(Path(drive)))
            first, named = by_file.get(file, (drive, ""))
            by_file[file] = first, named or camera
    return _Chosen(dict(by_file.values()), rigs, broken)


def _read(names: dict[str, str]) -> dict[str, Drive]:
    """Read what is written in the drives; the verification of a drive that is wrong says why."""
    from semcal_cli.drive.document import read_drive

    documents = {}
    for drive in names:
        with suppress(InputError):
            documents[drive] = read_drive(Path(drive))
    return documents


@contextmanager
def _folder(results: Path | None) -> Iterator[Path]:
    """Choose the folder of the results, which is removed at the end unless the user names it."""
    if results is not None:
        yield results.absolute()
        return
    with TemporaryDirectory(prefix="semcal-audit-") as folder:
        yield Path(folder).resolve()


def _tasks(names: dict[str, str], folder: Path, settings: AuditSettings) -> list[Task]:
    """List the tasks, to verify each drive.

    Raises:
        InputError: results cannot go to the folder.
    """
    from semcal_cli.many.batch.folders import check_folders
    from semcal_cli.many.batch.tasks import Task, folder_of

    tasks = [
        Task(
            drive,
            path=str(Path(drive).absolute()),
            folder=str(folder / folder_of(drive)),
            command="verify",
            arguments=settings.arguments,
            num_threads=settings.num_threads,
            timeout_s=settings.timeout_s,
        )
        for drive in names
    ]
    check_folders(tasks, folder, settings.results or folder)
    return tasks


def _verify(tasks: list[Task], folder: Path, settings: AuditSettings) -> list[Outcome]:
    """Verify the drives in processes, those that have no result yet."""
    from semcal_cli.cli.batch_progress import BatchProgress
    from semcal_cli.cli.worker import run_task
    from semcal_cli.many.batch.run import execute_here, run_batch

    num_jobs = settings.jobs or 1
    with BatchProgress(len(tasks), num_jobs, settings.quiet) as show:
        return run_batch(
            tasks, folder, execute_here(folder, num_jobs, run_task, show.begin), on_done=show.tell
        )


def _audited(outcome: Outcome, folder: Path) -> AuditedDrive:
    """Read the verification of a drive."""
    from semcal_cli.files.documents import read_document
    from semcal_cli.many.audit.audited_drives import AuditedDrive
    from semcal_cli.pipeline.verification import Verification

    if outcome.result is None:
        return AuditedDrive(outcome, None)
    return AuditedDrive(outcome, Verification.of_document(read_document(folder / outcome.result)))


def _report(settings: AuditSettings, audited: Audit) -> CiReport:
    """Make a test case of each drive; one that could not be verified counts as failed."""
    cases = [
        Case(drive.name, "fail" if drive.verification is None else drive.verdict, _figures(drive))
        for drive in audited.drives
    ]
    return CiReport("audit", str(settings.output), audited.verdict, cases)


def _figures(drive: AuditedDrive) -> str:
    """Describe what decides the verdict on a drive."""
    from semcal_cli.pipeline.verdict import overall_offsets

    if drive.verification is not None and drive.has_figures:
        return overall_offsets(drive.verification.checks)[0]
    return "; ".join(drive.outcome.reasons[:1])


def _print(audited: Audit) -> None:
    """Print the verdict, and then what is known of each camera and its drives."""
    from semcal_cli.cli.tables import verdict_line, wrapped
    from semcal_cli.cli.terminal import COLORS, make_console
    from semcal_cli.readable import for_people

    console = make_console(stderr=False)
    console.print(verdict_line(audited.verdict, audited.title), style=COLORS[audited.verdict], markup=False)
    for camera in audited.cameras:
        rows = [(camera.verdict, camera.name), *(("", sentence) for sentence in camera.sentences)]
        rows += [(f"  {drive.word}", f"{drive.name}: {_figures(drive)}") for drive in camera.drives]
        for row in rows:
            console.print(*map(for_people, wrapped(*row)), sep="\n", markup=False)
