"""Further LiDARs of a rig: what ties them to the first one, how well they are known, and whether they can be used."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from semcal_cli.drive.document import Drive
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.geometry.poses import inverse
from semcal_cli.many.rig.adjustment import adjust
from semcal_cli.many.rig.adjustment_document import Adjustment
from semcal_cli.many.rig.rig_document import FIRST_LIDAR, Rig
from semcal_cli.many.rig.rig_pair import Reference, RigPair, from_first_lidar
from semcal_cli.many.rig.rig_uncertainty import AdjustedSensor
from semcal_cli.many.rig.sweep_registration import (
    NotRegistered,
    Registration,
    read_sweep_pairs,
    register_sweeps,
)
from semcal_cli.many.rig.ties import Tie
from semcal_cli.readable import lengths
from semcal_cli.result.calibration_document import CalibrationDocument
from semcal_cli.result.uncertainty import widest

UNCONFIRMED = "no loop confirms its transform: a single measurement is all that ties it to the first LiDAR"
NOT_REGISTERED = "its sweeps were not registered"
LidarStatus: TypeAlias = Literal["trusted", "not_trusted", "not_assessed"]
MAX_HALF_WIDTH_M, MAX_HALF_WIDTH_DEG = 0.1, 0.5
"""Half widths of the 95 % interval beyond which a transform between LiDARs is not trusted: a wall at 10 m may then be
seen twice, 10 cm apart."""


@dataclass(frozen=True)
class LidarCalibration:
    """What is known of a further LiDAR."""

    name: str
    views: Mapping[str, str]
    """Name of the result of each camera with this LiDAR."""
    status: LidarStatus
    """Verdict: by its loops and by its interval."""
    reasons: tuple[str, ...] = ()
    """What speaks against the transform."""
    notes: tuple[str, ...] = ()
    """Sentences that do not affect the verdict."""
    pair: RigPair | None = None
    """Transform T_lidar_further; None if nothing that is trusted ties the LiDAR to the first one."""
    own_cameras: tuple[RigPair, ...] = ()
    """Transforms T_camera_lidar from the first LiDAR to the cameras that have no calibration with it."""
    registration: Registration | None = None
    """Registration of its sweeps with those of the first LiDAR, if there is one."""

    @property
    def verdict(self) -> str:
        """Describe how well the transform is known, or why it is not trusted."""
        if self.pair is None or (uncertainty := self.pair.believed_uncertainty) is None:
            return "; ".join(self.reasons)
        return widest(uncertainty.half_widths)


@dataclass(frozen=True)
class LidarTies:
    """What is measured of the further LiDARs of a rig."""

    ties: tuple[Tie, ...]
    registrations: Mapping[str, Registration]
    """Registration of each LiDAR that has one."""
    notes: Mapping[str, str]
    """Why a LiDAR was not registered, where that was asked for."""


def measure_lidars(
    rig: Rig,
    cameras: Mapping[str, CalibrationDocument],
    drives: Mapping[str, Drive],
    sweeps: SweepCache | None = None,
) -> LidarTies:
    """Collect the ties of the further LiDARs: calibrations, and registrations where the rig asks for them.

    A registration starts where the cameras and constraints place the LiDAR, or else at the reference.

    Args:
        rig: The rig.
        cameras: Calibration of each view that has one.
        drives: Drive of each view.
        sweeps: Sweeps that were read before.

    Raises:
        InputError: a sweep is missing or wrong.
    """
    views = {name: view for name, view in rig.views.items() if view.lidar != FIRST_LIDAR and name in cameras}
    ties = [Tie.of_calibration(view.camera, view.lidar, cameras[name]) for name, view in views.items()]
    calibrated = tuple(tie for tie in ties if tie is not None)
    registrations, notes = dict[str, Registration](), dict[str, str]()
    to_register = [name for name, lidar in rig.lidars.items() if lidar.is_registered]
    sensors = dict[str, AdjustedSensor]()
    if to_register:
        _, sensors = adjust(first_cameras(rig, cameras), rig.constraints, calibrated, rig.lidars)
    for name in to_register:
        start = inverse(sensors[name].pose) if name in sensors else rig.reference(FIRST_LIDAR, name)
        if start is None:
            notes[name] = f"{NOT_REGISTERED}: nothing that is trusted says where to start"
            continue
        pairs = read_sweep_pairs(_drives_of(FIRST_LIDAR, rig, drives), _drives_of(name, rig, drives), sweeps)
        registration = register_sweeps(pairs, start)
        if isinstance(registration, NotRegistered):
            notes[name] = f"{NOT_REGISTERED}: {registration.reason}"
        else:
            registrations[name] = registration
    registered = (registration.tie(name) for name, registration in registrations.items())
    # Registrations come first, so that each camera closes a loop of its own.
    return LidarTies((*registered, *calibrated), registrations, notes)


def first_cameras(rig: Rig, cameras: Mapping[str, CalibrationDocument]) -> dict[str, CalibrationDocument]:
    """Select the calibrations with the first LiDAR."""
    return {name: calibration for name, calibration in cameras.items() if name in rig.cameras}


def _drives_of(lidar: str, rig: Rig, drives: Mapping[str, Drive]) -> list[Drive]:
    return [drives[name] for name, view in rig.views.items() if view.lidar == lidar]


def assess_lidar(
    name: str,
    rig: Rig,
    drives: Mapping[str, Drive],
    cameras: Mapping[str, CalibrationDocument],
    adjustment: Adjustment,
    sensors: Mapping[str, AdjustedSensor],
    measured: LidarTies,
) -> LidarCalibration:
    """Decide whether the transform of a further LiDAR can be used.

    Args:
        name: Name of the LiDAR.
        rig: The rig.
        drives: Drive of each view.
        cameras: Calibration of each view that has one.
        adjustment: What all sensors say together.
        sensors: Pose and uncertainty of each sensor that took part.
        measured: What is measured of the further LiDARs.
    """
    views = {view.camera: each for each, view in rig.views.items() if view.lidar == name}
    notes = [measured.notes[name]] if name in measured.notes else []
    if name not in sensors:
        statuses = {cameras[view].status if view in cameras else "failed" for view in views.values()}
        return LidarCalibration(
            name,
            views,
            "not_assessed" if statuses == {"not_assessed"} else "not_trusted",
            ("nothing that is trusted ties it to the first LiDAR",),
            tuple(notes),
        )
    pair = from_first_lidar(name, sensors[name], reference_of(name, views, rig, drives))
    reasons = (*_width(pair), *(each.reason for each in adjustment.contradictions_of(name)))
    if name in adjustment.unconfirmed:
        notes.append(UNCONFIRMED)
    own = [camera for camera in views if camera in sensors and camera not in cameras]
    doubted = {camera for camera in own if reasons or camera in adjustment.doubted}
    return LidarCalibration(
        name,
        views,
        "not_trusted" if reasons else "trusted",
        reasons,
        tuple(notes),
        replace(pair, is_doubted=bool(reasons)),
        tuple(RigPair(camera, FIRST_LIDAR, *sensors[camera], None, camera in doubted) for camera in own),
        measured.registrations.get(name),
    )


def _width(pair: RigPair) -> list[str]:
    """Describe an interval that is too wide for a transform to be trusted."""
    assert pair.uncertainty is not None
    half_widths = np.array(pair.uncertainty.half_widths)
    if (half_widths <= np.repeat([MAX_HALF_WIDTH_M, MAX_HALF_WIDTH_DEG], 3)).all():
        return []
    needed = f"needed +- {lengths([MAX_HALF_WIDTH_M])}, +- {MAX_HALF_WIDTH_DEG:g} degrees"
    return [
        f"T_{pair.a}_{pair.b} is known only to {widest(pair.uncertainty.half_widths)}, {needed}: use more frames, more "
        "cameras that see both LiDARs, or `register: true`"
    ]


def reference_of(
    name: str, views: Mapping[str, str], rig: Rig, drives: Mapping[str, Drive]
) -> Reference | None:
    """Return the reference of a LiDAR: that of the rig, or what the drives of a camera with both LiDARs imply."""
    if (T := rig.reference(FIRST_LIDAR, name)) is not None:
        return Reference(T, rig.path.name)
    for camera, view in views.items():
        first = drives[camera].T_camera_lidar if camera in rig.cameras else None
        if first is not None and (further := drives[view].T_camera_lidar) is not None:
            T = inverse(np.array(first)) @ np.array(further)
            return Reference(T, f"T_camera_lidar of the drives of {camera}")
    return None
