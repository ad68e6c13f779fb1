"""One call each: calibrate, refine, assess and verify, on a drive or on arrays."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from typing_extensions import Unpack

from semcal_cli import pipeline
from semcal_cli.api.arguments import (
    Cues,
    DriveInput,
    GivenTransform,
    as_drive_input,
    as_initial_pose,
    in_terms_of_arguments,
    with_cue,
)
from semcal_cli.api.results import Calibration
from semcal_cli.config import CalibrationConfig, Limits
from semcal_cli.drive.document import Drive, read_drive
from semcal_cli.drive.held_arrays import ArrayInput
from semcal_cli.errors import InputError, NoStartError
from semcal_cli.estimation.adjust.priors import Prior
from semcal_cli.events import Listener, ignore
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.pipeline import verification
from semcal_cli.pipeline.from_transform import assess_given, refine_given
from semcal_cli.pipeline.verification import Verification, check_limits, load_as_stated
from semcal_cli.result.provenance import with_provenance


@in_terms_of_arguments
def calibrate(
    drive: DriveInput | None = None,
    config: CalibrationConfig | None = None,
    *,
    cue: Cues | None = None,
    initial_pose: GivenTransform | None = None,
    priors: Sequence[Prior] = (),
    relative_to: Path | str = ".",
    on_event: Listener | None = None,
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
        on_event: Called with each event; None ignores them.
        hashes: SHA-256 by the real paths of files; missing ones are added.
        **arrays: Arrays in place of a drive, as lists with one for each frame, or None where it has none: points (N, 3)
            or (N, 4) metres, LiDAR frame, with the intensity last; point_labels (N,) or (N, C); image_labels (H, W) or
            (H, W, C); images (H, W) or (H, W, 3); point_times (N,) seconds; point_features (N, C); image_features
            (H, W, C). For all frames: camera, a `Camera`; points_stamps and image_stamps, seconds; poses (M, 8). As in
            a drive.yaml: lidar, ignore, classes, motion, synchronization, time_offset_s, time_offset_sigma_s,
            T_camera_lidar, name. `ArrayInput` describes each.

    Raises:
        InputError: the drive, one of its files or an argument is missing or wrong.
        CalibrationError: the data give no answer.
    """
    given, config = as_drive_input(drive, arrays), with_cue(config, cue)
    start = None if initial_pose is None else as_initial_pose(initial_pose)
    data = load(given, config, on_event or ignore)
    try:
        calibration = pipeline.calibrate(
            data, config, initial_pose=start, priors=priors, on_event=on_event or ignore
        )
    except NoStartError as error:
        raise InputError(
            f"{error}; give initial_pose, or image_labels with cue=('segments', 'edges')"
        ) from None
    calibration = with_provenance(
        calibration,
        data,
        start=None if start is None else start.source,
        relative_to=Path(relative_to),
        hashes=hashes,
    )
    return Calibration.of(calibration, given.drive if isinstance(given, LoadedDrive) else given)


@in_terms_of_arguments
def refine(
    drive: DriveInput | None = None,
    transform: GivenTransform | None = None,
    config: CalibrationConfig | None = None,
    *,
    cue: Cues | None = None,
    priors: Sequence[Prior] = (),
    relative_to: Path | str = ".",
    on_event: Listener | None = None,
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
        on_event: Called with each event; None ignores them.
        **arrays: Arrays in place of a drive, as in `calibrate`.

    Raises:
        InputError: the drive, one of its files or an argument is missing or wrong.
        CalibrationError: the data give no answer.
    """
    config, start = with_cue(config, cue), as_initial_pose(transform)
    data = load(as_drive_input(drive, arrays), config, on_event or ignore)
    calibration = refine_given(data, start, config, priors, on_event or ignore)
    return Calibration.of(
        with_provenance(calibration, data, start=start.source, relative_to=Path(relative_to)), data.drive
    )


@in_terms_of_arguments
def assess(
    drive: DriveInput | None = None,
    transform: GivenTransform | None = None,
    config: CalibrationConfig | None = None,
    *,
    cue: Cues | None = None,
    relative_to: Path | str = ".",
    on_event: Listener | None = None,
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
        on_event: Called with each event; None ignores them.
        **arrays: Arrays in place of a drive, as in `calibrate`.

    Raises:
        InputError: the drive, one of its files or an argument is missing or wrong, or the cue is features.
        CalibrationError: the data give no answer.
    """
    config, given = with_cue(config, cue), as_initial_pose(transform)
    data = load(as_drive_input(drive, arrays), config, on_event or ignore)
    calibration = assess_given(data, given, config, on_event or ignore)
    return Calibration.of(
        with_provenance(calibration, data, start=given.source, relative_to=Path(relative_to)), data.drive
    )


@in_terms_of_arguments
def verify(
    drive: DriveInput | None = None,
    transform: GivenTransform | None = None,
    limits: Limits | None = None,
    config: CalibrationConfig | None = None,
    on_event: Listener | None = None,
    *,
    cue: Cues | None = None,
    **arrays: Unpack[ArrayInput],
) -> Verification:
    """Check whether a transform still holds on a drive or on arrays; see `semcal_cli.pipeline.verification.verify`.

    Intrinsics and a clock that a calibration estimated together with its transform replace the drive's. A loaded drive
    is then loaded again.

    Args:
        drive: A drive, its folder, its drive.yaml, or a drive loaded by `load`; None takes arrays.
        transform: T_camera_lidar (4, 4), p_camera = T_camera_lidar @ p_lidar, metres; a calibration; or a file of any
            known format.
        limits: Largest allowed errors; None takes the defaults.
        config: Seed, cues, number of frames, `refinement.max_baseline_m` and `refinement.edge_band_px`; None takes the
            defaults. The cues `auto` are those that the calibration of the transform compared, as far as the drive
            allows them.
        on_event: Called with each event of the run; None ignores them.
        cue: What points and pixels are compared by, in place of `config.cues`.
        **arrays: Arrays in place of a drive, as in `calibrate`.

    Raises:
        InputError: the drive, one of its files or an argument is missing or wrong, or the offset of the clock is
            limited without a direction of motion.
        CalibrationError: the data cannot be calibrated at all.
    """
    data, stated, config = as_drive_input(drive, arrays), as_initial_pose(transform), with_cue(config, cue)
    limits = Limits() if limits is None else limits
    # Limits are checked before the long work.
    check_limits(limits)
    data = data if isinstance(data, LoadedDrive | Drive) else read_drive(data)
    seen = load_as_stated(data, stated, config, on_event or ignore)
    return verification.verify(seen, stated, limits, config, on_event or ignore)
