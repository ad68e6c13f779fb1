"""The forms in which a program may give a drive, a transform and cues."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import TypeAlias, TypeVar

import numpy.typing as npt
from typing_extensions import ParamSpec

from semcal_cli.config import CalibrationConfig, CueName
from semcal_cli.drive.document import Drive, drive_file
from semcal_cli.drive.held_arrays import ArrayInput
from semcal_cli.errors import CalibrationError, InputError, one_of
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.formats import WITHOUT_OPTIONS, read_extrinsic
from semcal_cli.geometry.poses import as_transform
from semcal_cli.importing.recognition import recognise
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.result.calibration_document import CalibrationDocument

Given = ParamSpec("Given")
Returned = TypeVar("Returned")
DriveInput: TypeAlias = LoadedDrive | Drive | Path | str
"""A drive, its folder, its drive.yaml, or a drive loaded by `load`."""
GivenTransform: TypeAlias = InitialPose | CalibrationDocument | Path | str | npt.ArrayLike
"""T_camera_lidar (4, 4), p_camera = T_camera_lidar @ p_lidar, metres; a calibration; or a file of any known format."""
Cues: TypeAlias = CueName | Sequence[CueName]
"""A cue, or several that are compared together."""
ARGUMENTS = ("config", "cue", "initial_pose", "transform", "priors", "limits", "on_event")
"""Arguments of the calls beside a drive or arrays, for the message about an unknown one."""

OPTIONS = {
    "--max-baseline-m": "config.refinement.max_baseline_m",
    "--refine-intrinsics": "config.refinement.jointly.intrinsics",
    "--estimate-delay": "config.refinement.jointly.with_delay",
    "--estimator exact": 'config.refinement.estimator="exact"',
    "--estimator mine": 'config.refinement.estimator="mine"',
    "--device cuda": 'config.refinement.device="cuda"',
    "--search-deg": "config.initialization.search_deg",
    "--cross-validate": "config.num_folds",
    "--max-delay-ms": "limits.delay_s",
    "--cue edges": 'cue="edges"',
    "--init": "initial_pose",
}
"""What programs write in place of the options that errors of the pipeline name."""
AN_OPTION = re.compile(rf"({'|'.join(map(re.escape, OPTIONS))})(?![\w-])")


def in_terms_of_arguments(call: Callable[Given, Returned]) -> Callable[Given, Returned]:
    """Let the errors of a call speak of its arguments, where those of the command line speak of options."""

    @wraps(call)
    def worded(*args: Given.args, **kwargs: Given.kwargs) -> Returned:
        try:
            return call(*args, **kwargs)
        except (InputError, CalibrationError) as error:
            text = AN_OPTION.sub(lambda option: OPTIONS[option[0]], str(error))
            if text == str(error):
                raise
            kind = InputError if isinstance(error, InputError) else CalibrationError
            raise kind(text) from None

    return worded


def as_drive_input(drive: DriveInput | None, arrays: ArrayInput) -> DriveInput:
    """Return the drive, or make one from arrays.

    Raises:
        InputError: there is no drive, or one beside arrays, an argument is unknown, or an array is wrong.
    """
    for name in arrays.keys() - ArrayInput.__annotations__.keys():
        known = (*ARGUMENTS, *ArrayInput.__annotations__)
        needed = " or ".join(other for other in known if other.startswith(name)) or one_of(name, known)
        raise InputError(f"{name}: found an unknown argument, expected {needed}")
    if drive is None and not arrays:
        raise InputError(
            "drive: found nothing, expected a drive, or arrays: points, camera and the data that the cue compares"
        )
    if drive is not None and arrays:
        raise InputError(f"{min(arrays)}: found arrays and a drive, expected only one of the two")
    if drive is None:
        return Drive.from_arrays(**arrays)
    if isinstance(drive, Path | str) and (source := recognise(Path(drive))) is not None:
        raise InputError(source.advice(Path(drive)))
    if not isinstance(drive, LoadedDrive | Drive | Path | str):
        raise InputError(
            f"drive: found {type(drive).__name__}, expected a drive or its path; arrays have names"
        )
    return drive


def as_initial_pose(transform: GivenTransform | None) -> InitialPose:
    """Convert a transform from any of its forms.

    Raises:
        InputError: there is none, it is not rigid, or its file is wrong.
    """
    if transform is None:
        raise InputError("transform: found nothing, expected T_camera_lidar (4, 4), a calibration or a file")
    if isinstance(transform, InitialPose):
        return transform
    if isinstance(transform, CalibrationDocument):
        return InitialPose(transform.T_camera_lidar, "calibration", record=transform)
    if isinstance(transform, Path | str):
        extrinsic = read_extrinsic(transform, options=WITHOUT_OPTIONS)
        return InitialPose(
            extrinsic.T_camera_lidar, str(transform), drive_file(Path(transform)), record=extrinsic.record
        )
    return InitialPose(as_transform(transform, "transform"), "transform")


def with_cue(config: CalibrationConfig | None, cue: Cues | None) -> CalibrationConfig:
    """Put the cues into the settings.

    Raises:
        InputError: the cue is neither a name nor a list of names.
    """
    config = CalibrationConfig() if config is None else config
    if cue is None:
        return config
    if isinstance(cue, bytes) or not isinstance(cue, Sequence):
        raise InputError(f"cue: found {cue!r}, expected a name or a list of names")
    return replace(config, cues=(cue,) if isinstance(cue, str) else tuple(cue))
