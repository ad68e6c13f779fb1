"""The parts of a drive whose camera moved."""

from __future__ import annotations

from itertools import accumulate, pairwise

from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.errors import InputError
from semcal_cli.result.calibration import Calibration


def split(data: LoadedDrive, calibration: Calibration) -> tuple[LoadedDrive, ...]:
    """Split a drive into the parts whose frames fit different poses, each a drive of its own.

    Args:
        data: The drive, as `load` returns it.
        calibration: Its calibration, which lists the parts.

    Returns:
        The parts, to be calibrated; none if no movement of the camera was found.

    Raises:
        InputError: the calibration belongs to other frames.
    """
    used, frames = [frame.points for frame in calibration.input.frames], data.drive.frames
    if used != [frame.points for frame in frames]:
        raise InputError(
            f"{data.drive.path}: found a calibration of {len(used)} other frames, needed one of the {len(frames)} "
            "loaded ones"
        )
    ends = [0, *accumulate(part.num_frames for part in calibration.parts)]
    return tuple(data.of_frames(range(first, last)) for first, last in pairwise(ends))
