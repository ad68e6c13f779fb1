"""`semcal report`, `overlay` and `inspect` of a rig: what they show of its cameras."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from semcal_cli.config import Cue
    from semcal_cli.drive.document import Drive
    from semcal_cli.geometry.poses import Pose
    from semcal_cli.report.overlay import Coloring
    from semcal_cli.rig.calibration import RigCalibration


def report_rig(
    rig_file: Path,
    result: Path,
    output: Path,
    against: Path | None,
    max_points: int,
    threads: int | None,
    quiet: bool,
) -> None:
    """Write a page about the calibration of a rig.

    Args:
        rig_file: The rig.yaml.
        result: Folder that `semcal calibrate` wrote, or its rig_calibration.yaml.
        output: File of the page.
        against: Another transform; it is of one camera, and so refused.
        max_points: Points of the largest sweep that is read.
        threads: Number of threads.
        quiet: Whether only errors are shown.

    Raises:
        click.UsageError: another transform is given.
        InputError: a file is missing or wrong, or the page cannot be written.
    """
    from semcal_cli.cli.outputs import check_outputs, check_page
    from semcal_cli.cli.terminal import make_console, progress_line
    from semcal_cli.files.writing import write_text
    from semcal_cli.rig.page import rig_page_html
    from semcal_cli.threads import set_num_threads

    check_page(output)
    found, drives, read = _read(rig_file, result, against, max_points)
    check_outputs(read, [output])
    set_num_threads(threads)
    console = make_console(quiet)
    with progress_line(console) as progress:
        write_text(rig_page_html(found, drives, (str(rig_file), str(read[-1])), progress), output)
    console.print(str(output), markup=False)


def overlay_rig(
    rig_file: Path,
    result: Path,
    output: Path,
    against: Path | None,
    by: Coloring | None,
    cues: tuple[Cue, ...],
    max_frames: int,
    max_points: int,
    quiet: bool,
) -> None:
    """Draw the points of a rig on the pictures of each camera, in a folder of its own.

    Args:
        rig_file: The rig.yaml.
        result: Folder that `semcal calibrate` wrote, or its rig_calibration.yaml.
        output: Folder of the cameras' folders.
        against: Another transform; it is of one camera, and so refused.
        by: Meaning of the colours; None takes what suits the drive of each camera.
        cues: Cues whose labels are shown.
        max_frames: Number of frames drawn of each camera.
        max_points: Points of the largest sweep that is read.
        quiet: Whether only errors are shown.

    Raises:
        click.UsageError: another transform is given.
        InputError: a file is missing or wrong, or a picture cannot be written.
    """
    from semcal_cli.cli.outputs import check_image_folder
    from semcal_cli.cli.terminal import make_console
    from semcal_cli.drive.frame_selection import evenly_spaced
    from semcal_cli.files.writing import make_folder

    found, drives, read = _read(rig_file, result, against, max_points)
    for name, drive in drives.items():
        frames = evenly_spaced(drive.frames, max_frames)
        check_image_folder(output / name, len(frames), read)
        drives[name] = drive.model_copy(update={"frames": tuple(frames)})
    console = make_console(quiet)
    make_folder(output)
    for name, camera in found.cameras.items():
        for path in _draw(drives[name], name, camera.pose, output / name, by, cues):
            console.print(str(path), markup=False)
    for name, reason in found.failures.items():
        console.print(f"{name}: has no transform to draw with: {reason}", markup=False)


def _draw(
    drive: Drive, name: str, T_camera_lidar: Pose, folder: Path, by: Coloring | None, cues: tuple[Cue, ...]
) -> list[Path]:
    """Draw the frames of one camera, and give the paths of the pictures."""
    from semcal_cli.cli.overlay import observe
    from semcal_cli.report.overlay import Overlays

    by, observations = observe(drive, by, cues, "class")
    return list(Overlays(drive, observations, {name: T_camera_lidar}, by).write_all(folder))


def inspect_rig(rig_file: Path, with_frames: bool, as_json: bool, max_points: int) -> None:
    """Show what the drive of each camera holds, and first what looks wrong with any.

    Args:
        rig_file: The rig.yaml.
        with_frames: Whether a row for each frame is printed.
        as_json: Whether JSON is printed, a document by camera.
        max_points: Points of the largest sweep that is read.

    Raises:
        InputError: a file is missing or wrong.
    """
    from dataclasses import asdict

    from semcal_cli.assessment.inspection import inspect
    from semcal_cli.cli.inspect import findings, make_printer, print_content, print_labelled
    from semcal_cli.cli.terminal import make_console, progress_line
    from semcal_cli.rig.document import read_rig

    drives = read_rig(rig_file).read_drives(max_points)
    reports = {}
    with progress_line(make_console(quiet=as_json)) as progress:
        for name, drive in drives.items():
            progress(f"looking through {drive.path}")
            reports[name] = inspect(drive)
    if as_json:
        click.echo(json.dumps({name: asdict(report) for name, report in reports.items()}, indent=2))
        return
    console = make_printer()
    of_all = [(name, label, line) for name, report in reports.items() for label, line in findings(report)]
    if all(label != "suspicious" for _, label, _ in of_all):
        print_labelled(console, "suspicious", "nothing")
    for name, label, line in sorted(of_all, key=lambda row: row[1] != "suspicious"):
        print_labelled(console, label, f"{name}: {line}")
    for name, report in reports.items():
        console.print(f"\n[{name}]", markup=False)
        print_content(console, report, with_frames=with_frames)


def _read(
    rig_file: Path, result: Path, against: Path | None, max_points: int
) -> tuple[RigCalibration, dict[str, Drive], list[Path]]:
    """Read the result of a rig.

    Returns:
        The result, the drive of each camera as its result sees it, and all files that no output may replace, the
        result's own last.
    """
    from semcal_cli.result.applied import apply_result
    from semcal_cli.rig.document import read_rig
    from semcal_cli.rig.result import read_rig_result, result_file

    if against is not None:
        raise click.UsageError(f"--against: is of one camera, and {rig_file} is a rig")
    rig, file = read_rig(rig_file), result_file(result)
    drives = rig.read_drives(max_points)
    found = read_rig_result(rig, drives, file)
    for name, record in found.cameras.items():
        drives[name] = apply_result(record, drives[name], name).drive
    read = [path for drive in drives.values() for path in (drive.path, *map(drive.resolve, drive.files()))]
    calibrations = [file.with_name(f"{name}.yaml") for name in found.cameras]
    return found, drives, [*read, rig.path, *calibrations, file]
