"""Where a calibration starts: a transform that is given, that of the drive, labels, or the turns of the motion."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from semcal_cli.config import MAX_BASELINE_M
from semcal_cli.errors import InputError, NoStartError, shell
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.estimation.search.start_by_motion import no_start
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.geometry.poses import camera_center
from semcal_cli.observations.cues.cue_table import choose_cues, policy_of

if TYPE_CHECKING:
    from semcal_cli.cli.calibrate_options import CalibrateSettings
    from semcal_cli.drive.document import Drive

IGNORES = "--from-nothing ignores it"


class Start(NamedTuple):
    """Where the calibration of a drive starts."""

    settings: CalibrateSettings
    """The settings of the calibration, with the start."""
    sentence: str
    """What is used, in a line."""


def choose_start(settings: CalibrateSettings, drive: Drive) -> Start:
    """Choose the first start that there is.

    These are, in this order: the one that is given; none, where labels in the drive's files find the mounting; the
    transform of the drive, if its direction is beyond doubt; the labels of networks; the turns of the motion.

    Raises:
        NoStartError: there is none.
    """
    if (given := settings.initial_pose) is not None:
        return Start(settings, given.name if given.source is None else f"--init {given.name}")
    config = settings.config
    policy = policy_of(choose_cues(config.cues, drive, SweepCache()))
    if policy.can_find_mounting:
        return Start(settings, f"none: {' and '.join(policy.cues)} find the mounting")
    if not settings.is_from_nothing and _has_certain_transform(drive, settings.max_baseline_m):
        name = drive.argument
        return Start(replace(settings, init=name), f"the transform in {name}; {IGNORES}")
    if settings.image_model:
        return Start(settings, f"image labels by {' and '.join(settings.image_model)}")
    if drive.motion is None:
        raise no_start(drive, policy.near_only, "the drive gives no motion")
    return Start(settings, "the turns of the motion")


def _has_certain_transform(drive: Drive, max_baseline_m: float) -> bool:
    """Whether a drive states a transform whose direction and axes are beyond doubt."""
    if drive.T_camera_lidar is None:
        return False
    pose = _own_pose(drive)
    distance_m = float(np.linalg.norm(camera_center(pose.T_camera_lidar)))
    return not pose.looks_along_z and distance_m <= max_baseline_m


def _own_pose(drive: Drive) -> InitialPose:
    return InitialPose(np.array(drive.T_camera_lidar), str(drive.argument))


def after_import(drive: Drive, *, is_inspected: bool = False) -> str | None:
    """Write the command that follows the import of a drive. The user fills in a start that is not certain.

    A drive without images is only inspected; None if it already is.
    """
    first = drive.frames[0]
    if first.image_labels is None and first.image is None:
        return None if is_inspected else shell("inspect", drive.argument)
    command = shell("calibrate", drive.argument, "-o", "calibration.yaml")
    has_start = first.image_labels is not None or _has_certain_transform(drive, MAX_BASELINE_M)
    return command if has_start else f"{command} --init-rpy-xyz R P Y X Y Z"


def advised(error: NoStartError, drive: Drive) -> InputError:
    """List the commands that give a drive a start, in the error of a calibration without one."""
    name = drive.argument
    commands = [
        f"`{shell('calibrate', name, '--init-rpy-xyz')} R P Y X Y Z`, a mounting that is measured by hand",
        f"`{shell('view', name, '-o', 'init.yaml')}`, one that is adjusted by hand, then `--init init.yaml`",
        f"`{shell('calibrate', name, '--image-model', 'cityscapes')}`, image labels by a network",
    ]
    if drive.T_camera_lidar is not None:
        doubt = ", in which the camera looks up or down" if _own_pose(drive).looks_along_z else ""
        commands.insert(
            0, f"`{shell('calibrate', name, '--init', name)}`, the transform in this drive{doubt}"
        )
    if any(frame.image_labels is not None for frame in drive.frames):
        commands[-1] = f"`{shell('calibrate', name, '--cue', 'segments,edges')}`, by its image labels"
    if drive.motion is None and all(frame.points_stamp is not None for frame in drive.frames):
        command = shell("odometry", name, "-o", drive.root / "poses.txt")
        commands.append(f"`{command}`, if its sweeps follow one another and it turns")
    listed = "; ".join(f"({letter}) {text}" for letter, text in zip("abcdef", commands, strict=False))
    return InputError(f"{error}. Choose one: {listed}")
