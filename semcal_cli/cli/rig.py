"""`semcal calibrate rig.yaml`: several cameras and LiDARs in one run."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.jobs import Job, calibrate_each, failure_sentence
from semcal_cli.cli.output_checks import check_outputs, check_page, files_read
from semcal_cli.cli.outputs import Outputs, exit_code
from semcal_cli.cli.rig_tables import rig_lines
from semcal_cli.cli.rules import FOR_ONE_CAMERA, refuse
from semcal_cli.cli.start import choose_start
from semcal_cli.cli.tables import labelled, verdict_line, wrapped
from semcal_cli.errors import CalibrationError, InputError, NoStartError, SemcalError, counted
from semcal_cli.events import Listener
from semcal_cli.files.documents import FORMATS, document_text
from semcal_cli.files.input_files import is_folder
from semcal_cli.files.output_files import make_folder, write_text
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.many.rig.adjusted_calibration import STAGE
from semcal_cli.many.rig.rig_calibration import RigCalibration, combine, describe_rig
from semcal_cli.many.rig.rig_data import RigData
from semcal_cli.many.rig.rig_document import RESULT, Rig
from semcal_cli.many.rig.rig_page import rig_page_html
from semcal_cli.many.rig.rig_result import check_one_each, transforms_of
from semcal_cli.many.rig.rig_search import RigImages
from semcal_cli.many.rig.sweep_registration import check_registration
from semcal_cli.result.applied import apply_result
from semcal_cli.result.calibration_document import CalibrationDocument, write_calibration
from semcal_cli.result.provenance import hash_files
from semcal_cli.threads import set_num_threads

if TYPE_CHECKING:
    from semcal_cli.cli.calibrate_options import CalibrateSettings
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.drive.document import Drive
    from semcal_cli.many.rig.rig_result import RigTransforms

OF_ONE_CAMERA = (
    *("--init-rpy-xyz", "--search-deg", "--fix", "--prior-translation-m", "--prior-rotation-deg"),
    *("--frames", "--exclude", "--to", "--overlay", "--json", "--image-model"),
)
"""Options of `calibrate` that make sense for a single camera only."""


@dataclass(frozen=True, kw_only=True)
class RigRun:
    """What the calibration of a rig works with, once it is checked. Mappings are by the names of the results."""

    settings: CalibrateSettings
    folder: Path
    """Folder of the results."""
    data: RigData
    starts: Mapping[str, CalibrateSettings | NoStartError]
    """Settings of each camera with its start, or why it has none."""
    outputs: Mapping[str, Outputs]
    terminals: Mapping[str, Terminal]
    hashes: dict[str, str] = field(default_factory=dict)
    """SHA-256 by the real paths of files; those of files that are read are added."""

    @property
    def result(self) -> Path:
        """File of the result of the whole rig."""
        return self.folder / f"{RESULT}.yaml"

    def job(self, name: str, calibrate: Callable[[str, Listener], CalibrationDocument]) -> Job:
        """Make the job that calibrates a camera by a function of its name."""
        return Job(name, partial(calibrate, name), self.outputs[name], self.terminals[name])

    def calibrate(self, name: str, on_event: Listener) -> CalibrationDocument:
        """Calibrate a camera.

        Raises:
            NoStartError: it has no start.
            InputError: a file is missing or wrong.
            CalibrationError: there is no answer.
        """
        started = self.starts[name]
        if isinstance(started, NoStartError):
            raise started
        loaded = self.data.load(name, on_event=on_event)
        calibration = started.calibration()(loaded, on_event=on_event)
        return self.outputs[name].with_provenance(calibration, loaded, started.initial_pose, self.hashes)

    def write_camera(self, name: str, calibration: CalibrationDocument) -> None:
        """Write the calibration of a camera again."""
        write_calibration(calibration, self.folder / f"{name}.yaml")

    def failure(self, failures: Mapping[str, str]) -> CalibrationError:
        """Make the error about cameras without an answer."""
        data = self.data
        return CalibrationError(failure_sentence(failures, len(data.drives), of_lidars=bool(data.rig.lidars)))


def calibrate_rig(rig: Rig, settings: CalibrateSettings) -> int:
    """Calibrate the cameras of a rig one after another, reading each sweep once, and write the results.

    Args:
        rig: The rig.
        settings: Settings of the command; the output is a folder.

    Returns:
        The exit code.

    Raises:
        click.UsageError: an option for a single camera is given, or there is no output folder.
        InputError: the rig, a drive or the output is wrong.
        CalibrationError: a camera has no answer; the results of the others are written.
    """
    run = _prepare(rig, settings)
    calibration, matched_files = _calibrate(run)
    _write(run, calibration, matched_files)
    _show(run, calibration)
    if calibration.failures:
        raise run.failure(calibration.failures)
    return exit_code(calibration)


def _prepare(rig: Rig, settings: CalibrateSettings) -> RigRun:
    """Check the options, the rig and the outputs, and choose the start of each camera.

    Raises:
        click.UsageError: an option for a single camera is given, or there is no output folder.
        InputError: the rig, a drive or the output is wrong.
    """
    refuse(click.get_current_context(), OF_ONE_CAMERA, FOR_ONE_CAMERA.format(rig.path))
    if (folder := settings.output) is None:
        raise click.UsageError(
            f"-o: {rig.path} is a rig, whose results are several files; give a folder for them"
        )
    for name, lidar in rig.lidars.items():
        if lidar.is_registered:
            check_registration(f"{rig.path}: lidars.{name}.register")
    drives = rig.read_drives(settings.max_points)
    data = RigData(rig, drives, settings.config, SweepCache())
    if rig.match_images:
        RigImages.check(data)
    given = None if settings.init is None else transforms_of(rig, drives, settings.init)
    outputs = {name: Outputs(folder / f"{name}.yaml") for name in drives}
    with _made(folder):
        check_page(settings.page)
        read = [rig.path, *(file for drive in drives.values() for file in files_read(drive))]
        read += [] if given is None else given.paths
        results = [*(camera.output for camera in outputs.values()), folder / f"{RESULT}.yaml"]
        check_outputs(read, *results, settings.log, settings.page)
        for name, drive in drives.items():
            outputs[name].check(drive)
        starts = _choose_starts(rig, drives, settings, given)
    set_num_threads(settings.threads)
    return RigRun(
        settings=settings,
        folder=folder,
        data=data,
        starts=starts,
        outputs=outputs,
        terminals={name: settings.terminal() for name in drives},
    )


def _calibrate(run: RigRun) -> tuple[RigCalibration, Sequence[Path]]:
    """Calibrate each camera alone, and then all sensors together where images, constraints or LiDARs tie them.

    Returns:
        The calibration of the rig, and the files of the frames whose images were matched.

    Raises:
        InputError: a file is missing or wrong.
        CalibrationError: no camera has an answer.
    """
    data, rig = run.data, run.data.rig
    jobs = [run.job(name, run.calibrate) for name in data.drives]
    cameras, failures = calibrate_each(jobs, run.settings.threads)
    if not cameras:
        raise run.failure(failures)
    images = _match_images(run, cameras) if rig.match_images else None
    shown = None if images is None else images.settle(cameras)
    adjustment, lidars = data.adjusted(cameras)
    matched_files, notes = ((), ()) if images is None else (images.matched.files, images.matched.notes)
    num_sweeps = data.sweeps.num_different
    calibration = combine(rig, data.drives, cameras, failures, num_sweeps, adjustment, lidars, shown, notes)
    return calibration, matched_files


def _match_images(run: RigRun, cameras: dict[str, CalibrationDocument]) -> RigImages:
    """Match the images of cameras, and calibrate cameras that these contradict again.

    Args:
        run: The rig.
        cameras: Calibration of each camera that has one. Those made again are replaced; one that fails gets a note.

    Raises:
        InputError: a file is missing or wrong.
    """
    settings = run.settings
    with settings.terminal() as terminal:
        terminal.show("matching images")
        images = RigImages(run.data, cameras)
        placed = images.elsewhere()

    def calibrate(name: str, on_event: Listener) -> CalibrationDocument:
        loaded = images.load_near(name, on_event)
        calibration = images.judged(name, settings.calibration(placed[name])(loaded, on_event=on_event))
        return run.outputs[name].with_provenance(calibration, loaded, placed[name], run.hashes)

    again = [run.job(name, calibrate) for name in run.data.drives if name in placed]
    calibrated, failures = calibrate_each(again, settings.threads)
    cameras |= calibrated
    for name, failure in failures.items():
        note = f"it could not be calibrated again from {placed[name].name}: {failure}"
        cameras[name] = cameras[name].model_copy(update={"notes": (*cameras[name].notes, note)})
        run.write_camera(name, cameras[name])
    return images


def _write(run: RigRun, calibration: RigCalibration, matched_files: Sequence[Path]) -> None:
    """Write the result of the rig, the calibrations of the cameras that it moved, and the log if it is requested."""
    for name, camera in calibration.cameras.items():
        if STAGE in camera.stages:
            run.write_camera(name, camera)
    rig, drives = run.data.rig, run.data.drives
    read = [rig.path, *(drive.path for drive in drives.values()), *matched_files]
    files = {name: f"{name}.yaml" for name in drives}
    source = os.path.relpath(rig.path, run.folder)
    document = describe_rig(calibration, files, source, hash_files(read, run.folder, run.hashes))
    write_text(document_text(document, "yaml"), run.result)
    if (log := run.settings.log) is not None:
        threads = run.settings.threads
        logs = {name: terminal.log_document(threads) for name, terminal in run.terminals.items()}
        write_text(json.dumps(logs, indent=2) + "\n", log)


def _show(run: RigRun, calibration: RigCalibration) -> None:
    """Print the result of the rig, write its page if it is requested, and print the verdict."""
    rig, result, page, terminal = run.data.rig, run.result, run.settings.page, run.settings.terminal()
    terminal.print(*rig_lines(calibration, result))
    if page is not None:
        used = {
            name: apply_result(calibration.cameras.get(name), drive, name).drive
            for name, drive in run.data.drives.items()
        }
        with terminal:
            write_text(rig_page_html(calibration, used, (str(rig.path), str(result)), terminal.show), page)
        terminal.print_path("report", page)
    _print_verdict(calibration, terminal)


def _choose_starts(
    rig: Rig, drives: Mapping[str, Drive], settings: CalibrateSettings, given: RigTransforms | None
) -> dict[str, CalibrateSettings | NoStartError]:
    """Choose the start of each camera, and print it.

    Raises:
        InputError: no camera has one, or a given one is wrong or that of two cameras.
    """
    starts: dict[str, CalibrateSettings | NoStartError] = {}
    terminal = settings.terminal()
    files = {} if given is None else given.files
    cameras = {
        name: replace(settings, drive=drive.path, init=files.get(name)) for name, drive in drives.items()
    }
    if given is not None:
        poses = {name: camera.initial_pose for name, camera in cameras.items()}
        check_one_each(rig, given, {name: pose.T_camera_lidar for name, pose in poses.items() if pose})
    for name, drive in drives.items():
        try:
            starts[name], sentence = choose_start(cameras[name], drive)
            terminal.print(labelled("start", f"{name}: {sentence}"))
        except NoStartError as error:
            starts[name] = error
    if all(isinstance(start, NoStartError) for start in starts.values()):
        raise InputError(
            f"{rig.path}: {', '.join(starts)} have no labels and no motion, so each needs a start within 5 degrees and "
            "0.3 m: add --init with a file of all mountings, such as a URDF, state T_camera_lidar in its drive.yaml "
            "(`semcal view DRIVE -o FILE` makes one by hand), or label its images (`semcal label DRIVE --image-model "
            "cityscapes -o DRIVE`)"
        )
    return starts


@contextmanager
def _made(folder: Path) -> Iterator[None]:
    """Create the results folder, and remove it again if the work in it fails."""
    if folder.suffix.lower() in FORMATS and not is_folder(folder):
        raise InputError(
            f"{folder}: found suffix {folder.suffix!r}, expected a folder: a rig has several results"
        )
    was_there = is_folder(folder)
    make_folder(folder)
    if not os.access(folder, os.W_OK):
        raise InputError(f"{folder}: cannot be written to, expected a folder for a rig's results")
    try:
        yield
    except SemcalError:
        if not was_there:
            with suppress(OSError):
                folder.rmdir()
        raise


def _print_verdict(calibration: RigCalibration, terminal: Terminal) -> None:
    """Print the verdict on a rig, with the cameras or constraints that caused it."""
    for doubt in calibration.doubts:
        terminal.print(*wrapped("doubt", doubt))
    if calibration.status == "trusted":
        cameras = counted(len(calibration.cameras), "camera")
        if calibration.lidars:
            cameras = f"{len(calibration.cameras)} calibrations of {len(calibration.lidars) + 1} LiDARs"
        terminal.print_verdict(verdict_line("trusted", cameras), "trusted")
        return
    worst = calibration.failures or [
        *(name for name, camera in calibration.cameras.items() if camera.status == calibration.status),
        *(lidar.name for lidar in calibration.lidars if lidar.status == calibration.status),
        *(contradiction.name for contradiction in calibration.contradictions),
        *(f"{shown.to} beside {shown.source}" for shown in calibration.contradicted_images),
    ]
    terminal.print_verdict(
        verdict_line(calibration.status, ", ".join(worst)),
        "not_trusted" if calibration.status == "failed" else calibration.status,
    )
