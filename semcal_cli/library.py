"""The command `convert` and the option `--split`, as functions of Python."""

from __future__ import annotations

from itertools import accumulate, pairwise
from pathlib import Path

from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.errors import InputError
from semcal_cli.formats import convert_file
from semcal_cli.formats.format import FormatOptions
from semcal_cli.result.calibration import Calibration


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
