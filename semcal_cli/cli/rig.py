"""`semcal calibrate rig.yaml`: several cameras of one LiDAR in one run."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.options import ResultOptions
from semcal_cli.cli.outputs import EXIT_NOT_TRUSTED, Outputs, check_outputs, check_page
from semcal_cli.cli.rules import Options, refuse
from semcal_cli.cli.tables import labelled, matrix_lines
from semcal_cli.cli.terminal import Terminal
from semcal_cli.drive.loading import load
from semcal_cli.errors import CalibrationError, InputError, SemcalError
from semcal_cli.files.documents import document_text
from semcal_cli.files.point_clouds import Sweeps
from semcal_cli.files.reading import is_folder
from semcal_cli.files.writing import make_folder, write_text
from semcal_cli.result.calibration import Calibration
from semcal_cli.result.intervals import intervals
from semcal_cli.result.provenance import hash_files
from semcal_cli.rig.calibration import RigCalibration, combine, describe_rig
from semcal_cli.rig.document import RESULT, Rig, read_rig
from semcal_cli.threads import set_num_threads

if TYPE_CHECKING:
    from semcal_cli.config import CalibrationConfig
    from semcal_cli.drive.document import Drive
    from semcal_cli.rig.pairs import Pair

OF_ONE_CAMERA = (
    *("--init", "--init-rpy-xyz", "--search-deg", "--fix", "--prior-translation-m", "--prior-rotation-deg"),
    *("--to", "--overlay", "--split", "--json", "--image-model"),
)
"""Options of `calibrate` that would have another meaning for each camera."""
SUFFIXES = (".yaml", ".yml", ".json")


def calibrate_rig(
    path: Path, calibrate: Callable[..., Calibration], options: ResultOptions, config: CalibrationConfig
) -> int:
    """Calibrate the cameras of a rig one after another, reading each sweep once, and write the results.

    Args:
        path: File of the rig, rig.yaml.
        calibrate: Function that calibrates the camera of a drive: `pipeline.calibrate` with its settings.
        options: Options of every command that computes a calibration; the output is a folder.
        config: All settings of a calibration.

    Returns:
        The exit code.

    Raises:
        click.UsageError: an option that concerns a single camera is given.
        InputError: the rig, a drive or the output is wrong.
        CalibrationError: a camera has no answer; the results of the others are written.
    """
    folder, page = _places(path, options.output)
    rig = read_rig(path)
    drives = rig.read_drives(options.max_points)
    outputs = {name: Outputs(folder / f"{name}.yaml") for name in drives}
    with _made(folder):
        _check_outputs(rig, drives, outputs, folder / f"{RESULT}.yaml", options.log, page)
    set_num_threads(options.threads)
    sweeps, hashes = Sweeps(), dict[str, str]()
    terminals = {name: Terminal(quiet=options.quiet, verbose=options.verbose) for name in drives}

    def run(name: str, terminal: Terminal) -> tuple[Calibration, int]:
        data = load(drives[name], config, terminal.on_event, sweeps)
        found = calibrate(data, relative_to=folder, on_event=terminal.on_event, hashes=hashes)
        return found, len(data.drive.frames)

    cameras, failures, num_frames = _calibrate_each(run, terminals, outputs, options.threads)
    if not cameras:
        raise CalibrationError(_sentence(failures, len(drives)))
    rig_calibration = combine(rig, drives, cameras, failures, sweeps.num_different)
    _write(rig_calibration, rig, drives, folder, hashes)
    if options.log is not None:
        logs = {name: terminal.log_document(options.threads) for name, terminal in terminals.items()}
        write_text(json.dumps(logs, indent=2) + "\n", options.log)
    terminal = Terminal(quiet=options.quiet)
    terminal.print(*_lines(rig_calibration, num_frames, folder))
    if page is not None:
        _write_page(rig_calibration, drives, (str(path), str(folder / f"{RESULT}.yaml")), page, terminal)
    _print_verdict(rig_calibration, terminal)
    if failures:
        raise CalibrationError(_sentence(failures, len(drives)))
    return EXIT_NOT_TRUSTED if rig_calibration.status == "not_trusted" else 0


def _places(path: Path, output: Path | None) -> tuple[Path, Path | None]:
    """Check that no option is of a single camera, and give the folder of the results and the file of the page.

    Raises:
        click.UsageError: an option is of a single camera, or there is no folder.
    """
    given = Options(click.get_current_context())
    refuse(given, OF_ONE_CAMERA, f"is of one camera, and {path} is a rig")
    if output is None:
        raise click.UsageError(
            f"-o: {path} is a rig, whose results are several files: give a folder for them"
        )
    return output, given.value("--report")


def _calibrate_each(
    run: Callable[[str, Terminal], tuple[Calibration, int]],
    terminals: Mapping[str, Terminal],
    outputs: Mapping[str, Outputs],
    num_threads: int | None,
) -> tuple[dict[str, Calibration], dict[str, str], int]:
    """Calibrate the cameras one after another, and write and show the result of each.

    Args:
        run: Function that calibrates a camera, and tells how many frames it used.
        terminals: Where each camera is shown.
        outputs: Outputs of each camera.
        num_threads: Number of threads that was asked for.

    Returns:
        Calibrations of the cameras that have one, errors of the others, and the number of frames that were used.
    """
    cameras, failures, num_frames = dict[str, Calibration](), dict[str, str](), 0
    for name, terminal in terminals.items():
        terminal.print(f"[{name}]")
        try:
            with terminal:
                cameras[name], num_used = run(name, terminal)
            outputs[name].write(cameras[name], terminal, num_threads)
            num_frames += num_used
        except SemcalError as error:
            cameras.pop(name, None)
            failures[name] = " ".join(str(error).splitlines())
            terminal.print(labelled("failed", failures[name]))
    return cameras, failures, num_frames


def _write(
    found: RigCalibration, rig: Rig, drives: Mapping[str, Drive], folder: Path, hashes: dict[str, str]
) -> None:
    """Write the result of the whole rig."""
    files = {name: f"{name}.yaml" for name in drives}
    read = [rig.path, *(drive.path for drive in drives.values())]
    source = os.path.relpath(rig.path, folder)
    document = describe_rig(found, files, source, hash_files(read, folder, hashes))
    write_text(document_text(document, "yaml"), folder / f"{RESULT}.yaml")


def _lines(found: RigCalibration, num_frames: int, folder: Path) -> list[str]:
    """Describe the result of the whole rig, of which `num_frames` frames were used."""
    return [
        *(line for pair in found.pairs for line in _pair_lines(pair)),
        labelled("sweeps", f"{found.num_sweeps:,} for {num_frames:,} frames"),
        *(labelled("note", note) for note in found.notes),
        labelled("written to", str(folder / f"{RESULT}.yaml")),
    ]


def _print_verdict(found: RigCalibration, terminal: Terminal) -> None:
    """Print the verdict on a rig with the cameras that it is due to."""
    if found.status == "trusted":
        terminal.print_verdict(labelled("rig", "trusted"), "trusted")
        return
    worst = found.failures or [name for name, each in found.cameras.items() if each.status == found.status]
    line = labelled("rig", f"{found.status.replace('_', ' ')}: {', '.join(worst)}")
    terminal.print_verdict(line, "not_trusted" if found.status == "failed" else found.status)


def _write_page(
    found: RigCalibration, drives: Mapping[str, Drive], given: tuple[str, str], page: Path, terminal: Terminal
) -> None:
    """Write the page about a rig."""
    from semcal_cli.cli.terminal import progress_line
    from semcal_cli.result.applied import apply_result
    from semcal_cli.rig.page import rig_page_html

    seen = {name: apply_result(found.cameras.get(name), drive, name).drive for name, drive in drives.items()}
    with progress_line(terminal.console) as progress:
        write_text(rig_page_html(found, seen, given, progress), page)
    terminal.print(labelled("report", str(page)))


def _sentence(failures: Mapping[str, str], num_cameras: int) -> str:
    first, reason = next(iter(failures.items()))
    return f"{len(failures)} of {num_cameras} cameras failed; {first}: {reason}"


@contextmanager
def _made(folder: Path) -> Iterator[None]:
    """Create the folder of results, and remove it again if the work in it fails."""
    if folder.suffix.lower() in SUFFIXES and not is_folder(folder):
        raise InputError(
            f"{folder}: found suffix {folder.suffix!r}, needed a folder: a rig has several results"
        )
    was_there = is_folder(folder)
    make_folder(folder)
    if not os.access(folder, os.W_OK):
        raise InputError(f"{folder}: cannot be written to, needed a folder for a rig's results")
    try:
        yield
    except SemcalError:
        if not was_there:
            with suppress(OSError):
                folder.rmdir()
        raise


def _check_outputs(
    rig: Rig, drives: Mapping[str, Drive], outputs: Mapping[str, Outputs], *others: Path | None
) -> None:
    """Check that no result, the last of which is the page, overwrites a file that is read for any camera."""
    if others[-1] is not None:
        check_page(others[-1])
    read = [rig.path, *(drive.path for drive in drives.values())]
    read += [drive.resolve(name) for drive in drives.values() for name in drive.files()]
    written = [*(each.output for each in outputs.values()), *others]
    check_outputs(read, [path for path in written if path is not None])
    for name, drive in drives.items():
        outputs[name].check(drive)


def _pair_lines(pair: Pair) -> list[str]:
    """Describe a pair of cameras as lines of text."""
    lines = [f"T_{pair.a}_{pair.b}", *(labelled("", line) for line in matrix_lines(pair.T_a_b))]
    if pair.believed_uncertainty is not None:
        center, rotation = intervals(pair.believed_uncertainty.half_widths)
        lines += [labelled("95 % interval", center), labelled("", rotation)]
    if pair.distance:
        lines.append(labelled("reference", pair.distance))
    if pair.is_explained is not None:
        lines.append(
            labelled("", "within the uncertainty" if pair.is_explained else "more than chance explains")
        )
    return lines
