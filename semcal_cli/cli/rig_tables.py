"""What is printed about the result of a rig."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from semcal_cli.cli.tables import labelled, matrix_lines, wrapped
from semcal_cli.errors import counted
from semcal_cli.many.rig.adjusted_calibration import STAGE
from semcal_cli.result.uncertainty import intervals

if TYPE_CHECKING:
    from semcal_cli.many.rig.further_lidar import LidarCalibration
    from semcal_cli.many.rig.rig_calibration import RigCalibration
    from semcal_cli.many.rig.rig_pair import RigPair


def rig_lines(calibration: RigCalibration, result: Path) -> list[str]:
    """Describe the result of the whole rig."""
    num_frames = sum(len(camera.input.frames) for camera in calibration.cameras.values())
    adjustment = calibration.adjustment
    constraints = (
        []
        if adjustment is None
        else [
            constraint.sentence
            for constraint in adjustment.constraints
            if constraint.is_explained and constraint.kind == "constraint"
        ]
    )
    return [
        *(line for sentence in constraints for line in wrapped("constraint", sentence)),
        *(line for name in calibration.cameras for line in _adjusted_lines(name, calibration)),
        *(line for pair in calibration.pairs for line in _pair_lines(pair)),
        *(line for lidar in calibration.lidars for line in _lidar_lines(lidar)),
        *(line for loop in calibration.loops for line in wrapped("loop", loop.sentence)),
        *(line for shown in calibration.images or () for line in wrapped("images", shown.sentence)),
        labelled("sweeps", f"{calibration.num_sweeps:,} for {num_frames:,} frames"),
        *(line for note in calibration.notes for line in wrapped("note", note)),
        labelled("written to", str(result)),
    ]


def _adjusted_lines(name: str, calibration: RigCalibration) -> list[str]:
    """Describe how constraints or images moved a camera, and how well it is known since."""
    camera = calibration.cameras[name]
    if STAGE not in camera.stages:
        return []
    moved = wrapped(name, camera.notes[-1])
    if camera.believed_uncertainty is None:
        return moved
    center, rotation = intervals(camera.believed_uncertainty.half_widths)
    return [*moved, labelled("95 % interval", center), labelled("", rotation)]


def _pair_lines(pair: RigPair) -> list[str]:
    """Describe the transform between two cameras, and how it compares with its reference."""
    lines = [f"T_{pair.a}_{pair.b}", *(labelled("", line) for line in matrix_lines(pair.T_a_b))]
    center, rotation = pair.intervals
    if center:
        lines += [labelled("95 % interval", center), labelled("", rotation)]
    if pair.distance:
        lines.append(labelled("reference", pair.distance))
    if pair.is_explained is not None:
        explained = "within the uncertainty" if pair.is_explained else "more than chance explains"
        lines.append(labelled("", explained))
    return lines


def _lidar_lines(lidar: LidarCalibration) -> list[str]:
    """Describe a further LiDAR, its verdict first."""
    lines = wrapped(f"LiDAR {lidar.name}", f"{lidar.status.replace('_', ' ')}: {lidar.verdict}")
    if (registration := lidar.registration) is not None:
        left_out = f", {registration.num_left_out} left out" if registration.num_left_out else ""
        lines += wrapped("registered", f"{counted(registration.num_pairs, 'pair')} of sweeps{left_out}")
    if lidar.pair is not None:
        lines += _pair_lines(lidar.pair)
    return [*lines, *(line for camera in lidar.own_cameras for line in _pair_lines(camera))]
