"""`semcal calibrate rig.yaml`: several cameras and LiDARs in one run."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.jobs import Job, calibrate_each, failure_sentence
from semcal_cli.cli.outputs import Outputs, check_outputs, check_page, exit_code, files_read
from semcal_cli.cli.rules import FOR_ONE_CAMERA, refuse
from semcal_cli.cli.start import choose_start
from semcal_cli.cli.tables import labelled, matrix_lines, verdict_line, wrapped
from semcal_cli.errors import CalibrationError, InputError, NoStartError, SemcalError, counted
from semcal_cli.events import Listener
from semcal_cli.files.documents import FORMATS, document_text
from semcal_cli.files.input_files import is_folder
from semcal_cli.files.output_files import make_folder, write_text
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.many.rig.adjusted_calibration import STAGE
from semcal_cli.many.rig.further_lidar import LidarCalibration
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
from semcal_cli.result.uncertainty import intervals
from semcal_cli.threads import set_num_threads

if TYPE_CHECKING:
    from semcal_cli.cli.calibrate_options import CalibrateSettings
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.drive.document import Drive
    from semcal_cli.many.rig.rig_pair import RigPair
    from semcal_cli.many.rig.rig_result import RigTransforms

OF_ONE_CAMERA = (
    *("--init-rpy-xyz", "--search-deg", "--fix", "--prior-translation-m", "--prior-rotation-deg"),
    *("--frames", "--exclude", "--to", "--overlay", "--json", "--image-model"),
)
"""Options of `calibrate` that make sense for a single camera only."""


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
    refuse(click.get_current_context(), OF_ONE_CAMERA, FOR_ONE_CAMERA.format(rig.path))
    if (folder := settings.output) is None:
        raise click.UsageError(
            f"-o: {rig.path} is a rig, whose results are several files; give a folder for them"
        )
    for name, lidar in rig.lidars.items():
        if lidar.is_registered:
            check_registration(f"{rig.path}: lidars.{name}.register")
    page, result = settings.page, folder / f"{RESULT}.yaml"
    drives = rig.read_drives(settings.max_points)
    data = RigData(rig, drives, settings.config, SweepCache())
    if rig.match_images:
        RigImages.check(data)
    outputs = {name: Outputs(folder / f"{name}.yaml") for name in drives}
    given = None if settings.init is None else transforms_of(rig, drives, settings.init)
    with _made(folder):
        check_page(page)
        read = [rig.path, *(file for drive in drives.values() for file in files_read(drive))]
        read += [] if given is None else given.paths
        check_outputs(read, *(camera.output for camera in outputs.values()), result, settings.log, page)
        for name, drive in drives.items():
            outputs[name].check(drive)
        starts = _choose_starts(rig, drives, settings, given)
    set_num_threads(settings.threads)
    hashes = dict[str, str]()

    def run(name: str, on_event: Listener) -> CalibrationDocument:
        started = starts[name]
        if isinstance(started, NoStartError):
            raise started
        loaded = data.load(name, on_event=on_event)
        calibration = started.calibration()(loaded, on_event=on_event)
        return outputs[name].with_provenance(calibration, loaded, started.initial_pose, hashes)

    jobs = [Job(name, partial(run, name), outputs[name], settings.terminal()) for name in drives]
    cameras, failures = calibrate_each(jobs, settings.threads)
    if not cameras:
        raise CalibrationError(failure_sentence(failures, len(drives), of_lidars=bool(rig.lidars)))
    images = _match_images(data, cameras, settings, jobs, folder, hashes) if rig.match_images else None
    shown = None if images is None else images.settle(cameras)
    adjustment, lidars = data.adjusted(cameras)
    for name in cameras:
        if STAGE in cameras[name].stages:
            write_calibration(cameras[name], folder / f"{name}.yaml")
    result_of_rig = combine(
        rig,
        drives,
        cameras,
        failures,
        data.sweeps.num_different,
        adjustment,
        lidars,
        shown,
        () if images is None else images.matched.notes,
    )
    read = [rig.path, *(drive.path for drive in drives.values()), *(images.matched.files if images else ())]
    _write(result_of_rig, rig, drives, result, hash_files(read, result.parent, hashes))
    if settings.log is not None:
        logs = {job.name: job.terminal.log_document(settings.threads) for job in jobs}
        write_text(json.dumps(logs, indent=2) + "\n", settings.log)
    terminal = settings.terminal()
    terminal.print(*_lines(result_of_rig, result))
    if page is not None:
        used = {name: apply_result(cameras.get(name), drive, name).drive for name, drive in drives.items()}
        with terminal:
            write_text(rig_page_html(result_of_rig, used, (str(rig.path), str(result)), terminal.show), page)
        terminal.print_path("report", page)
    _print_verdict(result_of_rig, terminal)
    if failures:
        raise CalibrationError(failure_sentence(failures, len(drives), of_lidars=bool(rig.lidars)))
    return exit_code(result_of_rig)


def _match_images(
    data: RigData,
    cameras: dict[str, CalibrationDocument],
    settings: CalibrateSettings,
    jobs: Sequence[Job],
    folder: Path,
    hashes: dict[str, str],
) -> RigImages:
    """Match the images of cameras, and calibrate cameras that these contradict again.

    Args:
        data: The rig.
        cameras: Calibration of each camera that has one. Those made again are replaced; one that fails gets a note.
        settings: Settings of the command.
        jobs: Job of each camera.
        folder: Folder of the results.
        hashes: SHA-256 by the real paths of files; new ones are added.

    Raises:
        InputError: a file is missing or wrong.
    """
    with settings.terminal() as terminal:
        terminal.show("matching images")
        images = RigImages(data, cameras)
        placed = images.elsewhere()
    outputs = {job.name: job.outputs for job in jobs}

    def run(name: str, on_event: Listener) -> CalibrationDocument:
        loaded = images.load_near(name, on_event)
        calibration = images.judged(name, settings.calibration(placed[name])(loaded, on_event=on_event))
        return outputs[name].with_provenance(calibration, loaded, placed[name], hashes)

    again = [
        Job(job.name, partial(run, job.name), job.outputs, job.terminal) for job in jobs if job.name in placed
    ]
    calibrated, failures = calibrate_each(again, settings.threads)
    cameras |= calibrated
    for name, failure in failures.items():
        note = f"it could not be calibrated again from {placed[name].name}: {failure}"
        cameras[name] = cameras[name].model_copy(update={"notes": (*cameras[name].notes, note)})
        write_calibration(cameras[name], folder / f"{name}.yaml")
    return images


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


def _write(
    calibration: RigCalibration,
    rig: Rig,
    drives: Mapping[str, Drive],
    result: Path,
    hashes: Mapping[str, str],
) -> None:
    files = {name: f"{name}.yaml" for name in drives}
    document = describe_rig(calibration, files, os.path.relpath(rig.path, result.parent), hashes)
    write_text(document_text(document, "yaml"), result)


def _lines(calibration: RigCalibration, result: Path) -> list[str]:
    """Describe the result of the whole rig."""
    num_frames = sum(len(camera.input.frames) for camera in calibration.cameras.values())
    adjustment = calibration.adjustment
    constraints = (
        []
        if adjustment is None
        else [
            each.sentence
            for each in adjustment.constraints
            if each.is_explained and each.kind == "constraint"
        ]
    )
    return [
        *(line for sentence in constraints for line in wrapped("constraint", sentence)),
        *(line for name in calibration.cameras for line in _adjusted_lines(name, calibration)),
        *(line for pair in calibration.pairs for line in _pair_lines(pair)),
        *(line for lidar in calibration.lidars for line in _lidar_lines(lidar)),
        *(line for loop in calibration.loops for line in wrapped("loop", loop.sentence)),
        *(line for shown in calibration.images or () for line in wrapped("images", shown.sentence)),
        labelled("sweeps", f"{calibration.num_sweeps:,} for {num_frames:,} frames"),
        *(line for note in calibration.notes for line in wrapped("note", note)),
        labelled("written to", str(result)),
    ]


def _adjusted_lines(name: str, calibration: RigCalibration) -> list[str]:
    """Describe how constraints or images moved a camera, and how well it is known since."""
    camera = calibration.cameras[name]
    if STAGE not in camera.stages:
        return []
    moved = wrapped(name, camera.notes[-1])
    if camera.believed_uncertainty is None:
        return moved
    center, rotation = intervals(camera.believed_uncertainty.half_widths)
    return [*moved, labelled("95 % interval", center), labelled("", rotation)]


def _pair_lines(pair: RigPair) -> list[str]:
    lines = [f"T_{pair.a}_{pair.b}", *(labelled("", line) for line in matrix_lines(pair.T_a_b))]
    center, rotation = pair.intervals
    if center:
        lines += [labelled("95 % interval", center), labelled("", rotation)]
    if pair.distance:
        lines.append(labelled("reference", pair.distance))
    if pair.is_explained is not None:
        explained = "within the uncertainty" if pair.is_explained else "more than chance explains"
        lines.append(labelled("", explained))
    return lines


def _lidar_lines(lidar: LidarCalibration) -> list[str]:
    """Describe a further LiDAR, its verdict first."""
    lines = wrapped(f"LiDAR {lidar.name}", f"{lidar.status.replace('_', ' ')}: {lidar.verdict}")
    if (registration := lidar.registration) is not None:
        left_out = f", {registration.num_left_out} left out" if registration.num_left_out else ""
        lines += wrapped("registered", f"{counted(registration.num_pairs, 'pair')} of sweeps{left_out}")
    if lidar.pair is not None:
        lines += _pair_lines(lidar.pair)
    return [*lines, *(line for camera in lidar.own_cameras for line in _pair_lines(camera))]


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
