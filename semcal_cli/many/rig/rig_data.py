"""The drives of a rig, loaded one at a time, and the estimate of all its sensors together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from semcal_cli.config import CalibrationConfig
from semcal_cli.drive.document import Drive
from semcal_cli.events import Listener, ignore
from semcal_cli.files.point_clouds import SweepCache
from semcal_cli.geometry.arrays import Pose
from semcal_cli.many.rig.adjusted_calibration import adjusted_calibration
from semcal_cli.many.rig.adjustment import adjust
from semcal_cli.many.rig.adjustment_document import Adjustment
from semcal_cli.many.rig.further_lidar import LidarCalibration, assess_lidar, first_cameras, measure_lidars
from semcal_cli.many.rig.rig_document import Rig
from semcal_cli.observations.loading import LoadedDrive, load
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.skew import Skew
from semcal_cli.result.calibration_document import CalibrationDocument


@dataclass(frozen=True)
class RigData:
    """A rig, the drives of its cameras, and how they are loaded."""

    rig: Rig
    drives: Mapping[str, Drive]
    """Drive of each camera with each LiDAR, by the names of the results."""
    config: CalibrationConfig
    """Settings of the calibrations."""
    sweeps: SweepCache
    """Sweeps that were read before."""

    def load(
        self, name: str, calibration: CalibrationDocument | None = None, on_event: Listener = ignore
    ) -> LoadedDrive:
        """Load a drive, by the name of its result, with the camera and the clock of a calibration if there is one.

        Raises:
            InputError: as `load`.
            CalibrationError: as `load`.
        """
        drive = self.drives[name]
        drive = drive if calibration is None else calibration.applied_to(drive)
        return load(drive, self.config, on_event, self.sweeps)

    def seen(self, name: str, calibration: CalibrationDocument, T_camera_lidar: Pose) -> Observations:
        """Load the observations that a calibration was made from, as a pose (4, 4) sees them.

        Raises:
            InputError: as `load`.
            CalibrationError: as `load`.
        """
        data = self.load(name, calibration).along_scans(T_camera_lidar).unrolled(T_camera_lidar)
        return Skew.undone(data.observations, data.drive, T_camera_lidar, calibration.deskewed_m_s)

    def adjusted(
        self, cameras: dict[str, CalibrationDocument]
    ) -> tuple[Adjustment | None, tuple[LidarCalibration, ...]]:
        """Make one estimate of all sensors, and replace the calibrations with the first LiDAR that it moves.

        Args:
            cameras: Calibration of each camera that has one.

        Returns:
            What the sensors say together, None without constraints and further LiDARs; and the further LiDARs.

        Raises:
            InputError: a sweep is missing or wrong.
        """
        rig, drives = self.rig, self.drives
        if not rig.constraints and not rig.lidars:
            return None, ()
        measured = measure_lidars(rig, cameras, drives, self.sweeps)
        first, by = first_cameras(rig, cameras), "the other measurements" if rig.lidars else "constraints"
        adjustment, sensors = adjust(first, rig.constraints, measured.ties, rig.lidars)
        lidars = tuple(
            assess_lidar(name, rig, drives, cameras, adjustment, sensors, measured) for name in rig.lidars
        )
        for name, before in first.items():
            if name in sensors and not np.array_equal(sensors[name].pose, before.pose):
                seen = self.seen(name, before, sensors[name].pose)
                cameras[name] = adjusted_calibration(before, seen, sensors[name], by)
        return adjustment, lidars
