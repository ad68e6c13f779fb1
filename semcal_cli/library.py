"""The commands `verify` and `convert`, and the option `--split`, as functions of Python."""

from __future__ import annotations

from itertools import accumulate, pairwise
from pathlib import Path

import numpy.typing as npt

from semcal_cli.config import CalibrationConfig, Limits
from semcal_cli.config_checks import check_limits
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.loading import LoadedDrive, load
from semcal_cli.errors import InputError
from semcal_cli.events import Listener, ignore
from semcal_cli.formats import convert_file, read_extrinsic
from semcal_cli.formats.format import FormatOptions
from semcal_cli.geometry.poses import as_transform
from semcal_cli.initialization.initial_pose import InitialPose
from semcal_cli.result.applied import apply_result
from semcal_cli.result.calibration import Calibration
from semcal_cli.verification import Verification
from semcal_cli.verification import verify as verify_loaded


def verify(
    drive: LoadedDrive | Drive | Path | str,
    transform: Path | str | npt.ArrayLike,
    limits: Limits | None = None,
    config: CalibrationConfig | None = None,
    on_event: Listener = ignore,
) -> Verification:
    """Check whether a transform still holds on a drive.

    The camera and the clock that a calibration estimated together with its transform take the place of the drive's. A
    drive that is loaded is loaded again then.

    Args:
        drive: A drive, its folder, its drive.yaml, or a drive loaded by `load`.
        transform: T_camera_lidar (4, 4), p_camera = T_camera_lidar @ p_lidar, metres; or a file of any known format.
        limits: Largest allowed errors; None takes the defaults.
        config: Seed, cues, number of frames and `refinement.max_baseline_m`; None takes the defaults.
        on_event: Called with each event of the run.

    Raises:
        InputError: the drive, one of its files or the transform is wrong.
        CalibrationError: the drive cannot be calibrated at all.
    """
    config = config or CalibrationConfig()
    initial_pose = _initial_pose(transform)
    limits = limits or Limits()
    check_limits(limits)
    if initial_pose.record is not None:
        drive = _as_result_sees(drive, initial_pose.record, initial_pose.name)
    data = load(drive, config, on_event)
    max_baseline_m = config.refinement.max_baseline_m
    return verify_loaded(data, initial_pose, limits, config.seed, on_event, max_baseline_m=max_baseline_m)


def _as_result_sees(
    drive: LoadedDrive | Drive | Path | str, record: Calibration, name: str
) -> LoadedDrive | Drive:
    """Give a drive the camera and the clock of a result; a loaded one stays as it is if that changes nothing."""
    if isinstance(drive, LoadedDrive):
        applied = apply_result(record, drive.drive, name).drive
        return drive if applied == drive.drive else applied
    return apply_result(record, drive if isinstance(drive, Drive) else read_drive(drive), name).drive


def _initial_pose(transform: Path | str | npt.ArrayLike) -> InitialPose:
    if isinstance(transform, Path | str):
        found = read_extrinsic(transform)
        return InitialPose(found.T_camera_lidar, str(transform), Path(transform), record=found.record)
    return InitialPose(as_transform(transform, "transform"), "transform")


def split(data: LoadedDrive, calibration: Calibration) -> tuple[LoadedDrive, ...]:
    """Take the parts of a drive whose frames fit different poses, each as a drive of its own.

    Args:
        data: The drive, as `load` returns it.
        calibration: Its calibration, which tells the parts.

    Returns:
        The parts, to be calibrated; none if no movement of the camera was found.

    Raises:
        InputError: the calibration is not of these frames.
    """
    used, frames = [frame.points for frame in calibration.input.frames], data.drive.frames
    if used != [frame.points for frame in frames]:
        raise InputError(
            f"{data.drive.path}: found a calibration of {len(used)} other frames, needed one of the {len(frames)} "
            "loaded ones"
        )
    ends = [0, *accumulate(part.num_frames for part in calibration.parts)]
    return tuple(data.of_frames(range(first, last)) for first, last in pairwise(ends))


def convert(
    source: Path | str,
    to: str,
    output: Path | str | None = None,
    *,
    from_format: str | None = None,
    read_options: FormatOptions | None = None,
    write_options: FormatOptions | None = None,
) -> bytes:
    """Convert the transform of a file into another format, with the intrinsics of its camera where that holds them.

    Args:
        source: A file of any known format, or a drive with a reference. Calibrations and drives have a camera, too.
        to: Name of the format to write: see `semcal convert --formats`.
        output: File to write; None writes no file.
        from_format: Name of the source's format; None recognises it by its content.
        read_options: Options for what the source leaves open, such as its direction.
        write_options: Options for what the written format leaves open.

    Returns:
        The content of the file.

    Raises:
        InputError: a format is not known, the source is wrong or leaves something open, or the file cannot be written.
    """
    path = None if output is None else Path(output)
    return convert_file(Path(source), to, path, from_format, read_options, write_options)
