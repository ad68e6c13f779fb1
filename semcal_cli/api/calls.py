"""One call each: calibrate, refine, assess and verify, on a drive or on arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy.typing as npt
from typing_extensions import Unpack

from semcal_cli import pipeline
from semcal_cli.api.calibration import Calibration
from semcal_cli.config import CalibrationConfig, CueName, Limits
from semcal_cli.drive.document import Drive
from semcal_cli.drive.held_arrays import ArrayInput
from semcal_cli.errors import InputError
from semcal_cli.estimation.adjust.priors import Prior
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.events import Listener, ignore
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.pipeline import verification
from semcal_cli.pipeline.from_transform import as_initial_pose, assess_given, refine_given
from semcal_cli.pipeline.verification import Verification
from semcal_cli.result.calibration_document import Calibration as Document

Data: TypeAlias = LoadedDrive | Drive | Path | str
"""A drive, its folder, its drive.yaml, or a drive loaded by `load`."""
Transform: TypeAlias = InitialPose | Document | Path | str | npt.ArrayLike
"""T_camera_lidar (4, 4), p_camera = T_camera_lidar @ p_lidar, metres; a calibration; or a file of any known format."""
Cues: TypeAlias = CueName | Sequence[CueName]
"""A cue, or several that are compared together."""


def calibrate(
    drive: Data | None = None,
    config: CalibrationConfig | None = None,
    *,
    cue: Cues | None = None,
    initial_pose: Transform | None = None,
    priors: Sequence[Prior] = (),
    relative_to: Path = Path(),
    on_event: Listener = ignore,
    hashes: dict[str, str] | None = None,
    **arrays: Unpack[ArrayInput],
) -> Calibration:
    """Calibrate the camera and the LiDAR of a drive or of arrays.

    Args:
        drive: A drive, its folder, its drive.yaml, or the result of `load` with the same settings; None takes arrays.
        config: All settings; the defaults if not given.
        cue: What points and pixels are compared by, in place of `config.cues`.
        initial_pose: Pose to search around or to start from; see `pipeline.initialize`.
        priors: Known axes of the pose.
        relative_to: Folder of the result, which names the drive relative to it.
        on_event: Called with each event.
        hashes: SHA-256 by the real paths of files; missing ones are added.
        arrays: Arrays in place of a drive: see `Drive.from_arrays`.

    Raises:
        InputError: the drive, one of its files or an argument is missing or wrong.
        CalibrationError: the data give no answer.
    """
    data = _data(drive, arrays)
    found = pipeline.calibrate(
        data,
        _with_cue(config, cue),
        initial_pose=None if initial_pose is None else as_initial_pose(initial_pose),
        priors=priors,
        relative_to=relative_to,
        on_event=on_event,
        hashes=hashes,
    )
    return Calibration.of(found, data.drive if isinstance(data, LoadedDrive) else data)


def refine(
    drive: Data | None = None,
    transform: Transform | None = None,
    config: CalibrationConfig | None = None,
    *,
    cue: Cues | None = None,
    priors: Sequence[Prior] = (),
    relative_to: Path = Path(),
    on_event: Listener = ignore,
    **arrays: Unpack[ArrayInput],
) -> Calibration:
    """Refine a transform that is known to about 20 degrees (by labels), or to 5 degrees and 0.3 m (by edges).

    Nothing is searched; the pose is polished and assessed as in `calibrate`.

    Args:
        drive: A drive, its folder, its drive.yaml, or a drive loaded by `load`; None takes arrays.
        transform: T_camera_lidar (4, 4), p_camera = T_camera_lidar @ p_lidar, metres; a calibration; or a file of any
            known format.
        config: All settings; the defaults if not given.
        cue: What points and pixels are compared by, in place of `config.cues`.
        priors: Known axes of the pose.
        relative_to: Folder of the result, which names the drive relative to it.
        on_event: Called with each event.
        arrays: Arrays in place of a drive: see `Drive.from_arrays`.

    Raises:
        InputError: the drive, one of its files or an argument is missing or wrong.
        CalibrationError: the data give no answer.
    """
    config, start = _with_cue(config, cue), _given(transform)
    data = load(_data(drive, arrays), config, on_event)
    return Calibration.of(refine_given(data, start, config, priors, on_event, relative_to), data.drive)


def assess(
    drive: Data | None = None,
    transform: Transform | None = None,
    config: CalibrationConfig | None = None,
    *,
    cue: Cues | None = None,
    relative_to: Path = Path(),
    on_event: Listener = ignore,
    **arrays: Unpack[ArrayInput],
) -> Calibration:
    """Assess a transform that is right to about a pixel: its interval, and all that speaks against it.

    It is only polished first, because an interval belongs to a maximum of the mutual information. `verify` decides
    whether a transform still holds, wherever the maximum is.

    Args:
        drive: A drive, its folder, its drive.yaml, or a drive loaded by `load`; None takes arrays.
        transform: T_camera_lidar (4, 4), p_camera = T_camera_lidar @ p_lidar, metres; a calibration; or a file of any
            known format.
        config: All settings; the defaults if not given.
        cue: What points and pixels are compared by, in place of `config.cues`.
        relative_to: Folder of the result, which names the drive relative to it.
        on_event: Called with each event.
        arrays: Arrays in place of a drive: see `Drive.from_arrays`.

    Raises:
        InputError: the drive, one of its files or an argument is missing or wrong, or the cue is features.
        CalibrationError: the data give no answer.
    """
    config, given = _with_cue(config, cue), _given(transform)
    data = load(_data(drive, arrays), config, on_event)
    return Calibration.of(assess_given(data, given, config, on_event, relative_to), data.drive)


def verify(
    drive: Data | None = None,
    transform: Transform | None = None,
    limits: Limits | None = None,
    config: CalibrationConfig | None = None,
    on_event: Listener = ignore,
    *,
    cue: Cues | None = None,
    **arrays: Unpack[ArrayInput],
) -> Verification:
    """Check whether a transform still holds on a drive or on arrays; see `semcal_cli.pipeline.verification.verify`.

    Args:
        drive: A drive, its folder, its drive.yaml, or a drive loaded by `load`; None takes arrays.
        transform: T_camera_lidar (4, 4), p_camera = T_camera_lidar @ p_lidar, metres; a calibration; or a file of any
            known format.
        limits: Largest allowed errors; None takes the defaults.
        config: Seed, cues, number of frames, `refinement.max_baseline_m` and `refinement.edge_band_px`; None takes the
            defaults.
        on_event: Called with each event of the run.
        cue: What points and pixels are compared by, in place of `config.cues`.
        arrays: Arrays in place of a drive: see `Drive.from_arrays`.

    Raises:
        InputError: the drive, one of its files or an argument is missing or wrong, or the offset of the clock is
            limited without a direction of motion.
        CalibrationError: the data cannot be calibrated at all.
    """
    return verification.verify(
        _data(drive, arrays), _given(transform), limits, _with_cue(config, cue), on_event
    )


def _data(drive: Data | None, arrays: ArrayInput) -> Data:
    """Return the drive, or make one from the arrays."""
    if drive is None and not arrays:
        raise InputError(
            "drive: found nothing, needed a drive, or arrays: points, camera and the data that the cue compares"
        )
    if drive is not None and arrays:
        raise InputError(f"{min(arrays)}: found arrays and a drive, needed only one of the two")
    if drive is None:
        return Drive.from_arrays(**arrays)
    if not isinstance(drive, LoadedDrive | Drive | Path | str):
        raise InputError(
            f"drive: found {type(drive).__name__}, needed a drive or its path; arrays have names"
        )
    return drive


def _given(transform: Transform | None) -> InitialPose:
    if transform is None:
        raise InputError("transform: found nothing, needed T_camera_lidar (4, 4), a calibration or a file")
    return as_initial_pose(transform)


def _with_cue(config: CalibrationConfig | None, cue: Cues | None) -> CalibrationConfig:
    """Put the cues into the settings."""
    config = CalibrationConfig() if config is None else config
    if cue is None:
        return config
    if isinstance(cue, bytes) or not isinstance(cue, Sequence):
        raise InputError(f"cue: found {cue!r}, needed a name or a list of names")
    return replace(config, cues=(cue,) if isinstance(cue, str) else tuple(cue))
