"""`semcal export`: drives and calibrations for other programs to look at."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.options import DriveSettings, reference_direction
from semcal_cli.cli.settings import KNOWN_TRANSFORMS, argument, option
from semcal_cli.cli.settings_command import command
from semcal_cli.config.directions import Direction
from semcal_cli.errors import InputError, check_installed, counted, one_of

if TYPE_CHECKING:
    from semcal_cli.cli.terminal import Terminal
    from semcal_cli.drive.document import Drive
    from semcal_cli.formats.semcal import Extrinsic


@click.group()
def export() -> None:
    """Export a drive or a rig to other programs. `semcal convert` writes transforms for other tools."""


@dataclass(frozen=True, kw_only=True)
class RerunSettings(DriveSettings):
    """Settings of `export rerun`."""

    calibration: Path | None = argument()
    output: Path = option("File to write, .rrd.", "-o", "--output", required=True, metavar="FILE")
    reference_direction: Direction | None = reference_direction()
    max_frames: int = option("Write at most N evenly spaced frames.", default=20, minimum=1)
    spawn: bool = option("Also open the file in the Rerun viewer.", default=False)


@command(
    RerunSettings,
    export,
    help="Write DRIVE for the Rerun viewer: sweeps and images with their labels over time, and a camera at each pose "
    "of CALIBRATION (hypotheses, stages and result), or at the single pose of another file. CALIBRATION is "
    f"{KNOWN_TRANSFORMS}. Open the file with `rerun FILE.rrd`.",
    short_help="To the Rerun viewer, .rrd.",
)
def rerun(settings: RerunSettings) -> None:
    """Write a recording of Rerun."""
    import numpy as np

    from semcal_cli.cli.output_checks import check_outputs, files_read
    from semcal_cli.cli.tables import wrapped
    from semcal_cli.drive.document import read_drive
    from semcal_cli.observations.frame_selection import with_few_frames

    check_installed("semcal export rerun", "rerun", "view")
    from semcal_cli.formats import read_reference
    from semcal_cli.report.rerun_file import cameras_of, write_rerun
    from semcal_cli.result.applied import apply_result, as_begun

    whole, calibration = read_drive(settings.drive, settings.max_points), settings.calibration
    check_outputs(files_read(whole, calibration), settings.output)
    cameras = {}
    if whole.T_camera_lidar is not None:
        cameras["reference"] = np.array(whole.T_camera_lidar), whole.camera
    terminal = settings.terminal()
    if calibration is not None:
        extrinsic = read_reference(calibration, settings.reference_direction)
        applied = apply_result(extrinsic.record, whole, str(calibration))
        terminal.print_changes(applied.changes)
        cameras |= cameras_of(extrinsic, as_begun(extrinsic.record, whole).camera, applied.drive.camera)
        whole = applied.drive
    spec = with_few_frames(whole, settings.max_frames)
    with terminal:
        terminal.show("reading frames")
        write_rerun(spec, cameras, settings.output)
    names = f", cameras {', '.join(cameras)}" if cameras else ""
    terminal.print(
        *wrapped("", f"wrote {settings.output}: {counted(len(spec.frames), 'frame')}{names}", indent=0)
    )
    if settings.spawn:
        viewer = [sys.executable, "-m", "rerun", str(settings.output)]
        subprocess.Popen(viewer, stdin=subprocess.DEVNULL, start_new_session=True)


@dataclass(frozen=True, kw_only=True)
class McapSettings(DriveSettings):
    """Settings of `export mcap`."""

    calibration: Path = argument()
    output: Path = option("File to write, .mcap.", "-o", "--output", required=True, metavar="FILE")
    reference_direction: Direction | None = reference_direction()
    max_frames: int | None = option("Write at most N evenly spaced frames; all if not given.", minimum=1)


@command(
    McapSettings,
    export,
    help="Write DRIVE as a recording of ROS 2, for Foxglove: sweeps, images, camera_info, and the transform in "
    f"CALIBRATION in /tf_static. CALIBRATION is {KNOWN_TRANSFORMS}. In Foxglove, open the file, add an Image panel of "
    "/camera/image_raw/compressed with the calibration /camera/camera_info, and show /points in it.",
    short_help="A ROS 2 recording for Foxglove, .mcap.",
)
def mcap(settings: McapSettings) -> None:
    """Write a recording of ROS 2."""
    from semcal_cli.cli.output_checks import check_outputs
    from semcal_cli.cli.tables import wrapped

    for package in ("rosbags", "mcap"):
        check_installed("semcal export mcap", package, "bag")
    from semcal_cli.formats.ros2_recording import has_stamps, write_recording

    terminal, output = settings.terminal(), settings.output
    drive, extrinsic = _read_with_transform(settings, terminal, lambda read: check_outputs(read, output))
    with terminal:
        terminal.show("reading frames")
        write_recording(drive, extrinsic.T_camera_lidar, output)
    if not has_stamps(drive):
        unknown = "the drive states no times of all sweeps and images: frames are a second apart"
        terminal.print(*wrapped("note:", unknown, indent=6))
    terminal.print(*wrapped("", f"wrote {output}: {counted(len(drive.frames), 'frame')}", indent=0))
    terminal.print(*extrinsic.warnings)


def _read_with_transform(
    settings: McapSettings | NerfstudioSettings | PlySettings,
    terminal: Terminal,
    check_output: Callable[[Sequence[Path]], None],
) -> tuple[Drive, Extrinsic]:
    """Read the frames to write, as the camera of a transform sees them, and the transform.

    Args:
        settings: The drive, the transform and the number of frames.
        terminal: Where to print how the camera of the transform differs.
        check_output: Checks, before the transform is read, that the output replaces none of the files that are read.

    Raises:
        InputError: the drive, the transform or the output is wrong.
    """
    from semcal_cli.cli.output_checks import files_read
    from semcal_cli.drive.document import read_drive
    from semcal_cli.formats import read_reference
    from semcal_cli.observations.frame_selection import with_few_frames
    from semcal_cli.result.applied import apply_result

    whole = read_drive(settings.drive, settings.max_points)
    check_output(files_read(whole, settings.calibration))
    extrinsic = read_reference(settings.calibration, settings.reference_direction)
    applied = apply_result(extrinsic.record, whole, str(settings.calibration))
    terminal.print_changes(applied.changes)
    return with_few_frames(applied.drive, settings.max_frames or len(whole.frames)), extrinsic


@dataclass(frozen=True, kw_only=True)
class NerfstudioSettings(DriveSettings):
    """Settings of `export nerfstudio`."""

    calibration: Path = argument()
    output: Path = option("File to write, transforms.json.", "-o", "--output", required=True, metavar="FILE")
    reference_direction: Direction | None = reference_direction()
    max_frames: int | None = option("Write at most N evenly spaced frames; all if not given.", minimum=1)


@command(
    NerfstudioSettings,
    export,
    help="Write the images of DRIVE with their poses for nerfstudio: those of the LiDAR in `motion:`, with the "
    f"transform in CALIBRATION. CALIBRATION is {KNOWN_TRANSFORMS}. The world is the LiDAR's frame at the first image. "
    "The images stay where they are.",
    short_help="Images with poses for nerfstudio, transforms.json.",
)
def nerfstudio(settings: NerfstudioSettings) -> None:
    """Write a transforms.json."""
    from semcal_cli.cli.output_checks import check_outputs
    from semcal_cli.files.output_files import check_suffix, write_bytes
    from semcal_cli.formats.nerfstudio import transforms_json

    check_suffix(settings.output, ".json")
    terminal, output = settings.terminal(), settings.output
    drive, extrinsic = _read_with_transform(settings, terminal, lambda read: check_outputs(read, output))
    write_bytes(transforms_json(drive, extrinsic.T_camera_lidar, output), output)
    terminal.print(f"wrote {output}: {counted(len(drive.frames), 'image')}", *extrinsic.warnings)


@dataclass(frozen=True, kw_only=True)
class ColmapSettings(DriveSettings):
    """Settings of `export colmap`."""

    drive: Path = argument(metavar="RIG")
    results: Path = argument()
    output: Path = option("File to write, rig_config.json.", "-o", "--output", required=True, metavar="FILE")
    reference: str | None = option(
        "Camera that is the frame of COLMAP's rig; the first with a transform if not given.", metavar="CAMERA"
    )


@command(
    ColmapSettings,
    export,
    help="Write the cameras of RIG, a rig.yaml, as a rig of COLMAP 3.12 or later, with their intrinsics. RESULTS is "
    "the folder that semcal calibrate wrote. COLMAP knows no LiDAR, so one camera is the frame of its rig; each entry "
    "also has T_camera_lidar, which COLMAP ignores. COLMAP expects the images of each camera in a folder of its name.",
    short_help="A rig of cameras for COLMAP, rig_config.json.",
)
def colmap(settings: ColmapSettings) -> None:
    """Write a rig_config.json."""
    from semcal_cli.cli.output_checks import check_outputs
    from semcal_cli.cli.tables import wrapped
    from semcal_cli.drive.document import read_drive
    from semcal_cli.files.output_files import check_suffix, write_bytes
    from semcal_cli.formats.colmap import RigCamera, rig_config
    from semcal_cli.many.rig.rig_document import find_rig
    from semcal_cli.many.rig.rig_result import read_rig_files

    check_suffix(settings.output, ".json")
    rig, terminal = find_rig(settings.drive), settings.terminal()
    if rig is None:
        # What is wrong with a file that is no drive either comes first.
        read_drive(settings.drive, settings.max_points)
        raise InputError(
            f"{settings.drive}: found a drive, expected a rig.yaml, whose cameras are a rig of COLMAP"
        )
    result, drives, read = read_rig_files(rig, settings.results, settings.max_points)
    check_outputs(read, settings.output)
    cameras = {
        name: RigCamera(record.pose, drives[name].camera) for name, record in result.first_cameras.items()
    }
    camera_names = {name: camera for name, (camera, _) in result.further_views.items()}
    lenses = {camera_names.get(name, name): drive.camera for name, drive in drives.items()}
    cameras |= {name: RigCamera(pair.T_a_b, lenses[name]) for name, pair in result.own_cameras.items()}
    notes = [
        f"{name}: left out, {error}"
        for name, error in result.failures.items()
        if camera_names.get(name, name) not in cameras
    ]
    if not cameras:
        raise InputError(f"{settings.results}: found no camera with a transform; {notes[0]}")
    reference = settings.reference or next(iter(cameras))
    if reference not in cameras:
        raise InputError(f"--reference: found {reference!r}, expected {one_of(reference, cameras)}")
    notes += [
        f"{name}: not trusted, see its reasons"
        for name, record in result.first_cameras.items()
        if record.status == "not_trusted"
    ]
    notes += [
        f"{name}: not trusted, see those of its LiDAR"
        for name, pair in result.own_cameras.items()
        if pair.is_doubted
    ]
    write_bytes(rig_config(cameras, reference, notes.append), settings.output)
    terminal.print(*(line for note in notes for line in wrapped("note", note)))
    terminal.print(f"wrote {settings.output}: {counted(len(cameras), 'camera')}, in the frame of {reference}")


@dataclass(frozen=True, kw_only=True)
class PlySettings(DriveSettings):
    """Settings of `export ply`."""

    calibration: Path = argument()
    output: Path = option(
        "Folder for the files, each named after its frame.", "-o", "--output", required=True, metavar="DIR"
    )
    reference_direction: Direction | None = reference_direction()
    max_frames: int = option("Write at most N evenly spaced frames.", default=20, minimum=1)


@command(
    PlySettings,
    export,
    help="Write the points of each frame of DRIVE that the camera sees at the transform in CALIBRATION, with the "
    f"colours of the image, as .ply. CALIBRATION is {KNOWN_TRANSFORMS}. Points are in the LiDAR frame, in metres.",
    short_help="Coloured points, .ply.",
)
def ply(settings: PlySettings) -> None:
    """Write coloured sweeps."""
    from semcal_cli.cli.output_checks import check_image_folder
    from semcal_cli.observations.reading import load_points
    from semcal_cli.report.ply import write_ply

    terminal, folder = settings.terminal(), settings.output
    drive, extrinsic = _read_with_transform(
        settings, terminal, lambda read: check_image_folder(folder, read, ".ply")
    )
    paths = write_ply(drive, load_points(drive), extrinsic.T_camera_lidar, folder)
    terminal.print(*map(str, paths))
