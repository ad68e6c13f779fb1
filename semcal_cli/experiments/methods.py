"""The calibration methods to compare: each estimates a pose from the same pairs and the same start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from semcal_cli.baselines.config import SoicConfig
from semcal_cli.baselines.soic import Soic
from semcal_cli.config import Estimator, InitializationConfig, RefinementConfig
from semcal_cli.drive.document import Drive
from semcal_cli.drive.loading import LoadedDrive
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.poses import Pose
from semcal_cli.initialization.initial_pose import InitialPose
from semcal_cli.pipeline import initialize, refine_and_polish, start_at
from semcal_cli.result.stage import StageResult


@dataclass(frozen=True)
class Scene:
    """The input of a method: the same pairs with labels and with intensity."""

    drive: Drive
    labels: Observations
    intensity: Observations
    is_initialized: bool = False
    """Whether the start is that of an initial calibration; otherwise coarse levels are ascended first."""

    def ascend(self, observations: Observations, T_init: Pose, estimator: Estimator) -> Pose:
        """Ascend mutual information as `calibrate` does, or as `calibrate --init` does if the start is any pose."""
        data = LoadedDrive(self.drive, observations)
        given = InitialPose(T_init, "start")
        initial: StageResult = (
            start_at(data, given)
            if self.is_initialized
            else initialize(data, InitializationConfig(), initial_pose=given)
        )
        return refine_and_polish(data, initial, RefinementConfig(estimator)).T_camera_lidar


Method = Callable[[Scene, Pose], Pose]
"""Function from a start T_camera_lidar (4, 4) to a better one; raises a `SemcalError` if it finds none."""

METHODS: dict[str, Method] = {
    "semcal": lambda scene, T_init: scene.ascend(scene.labels, T_init, "exact"),
    "SOIC": lambda scene, T_init: Soic(scene.labels, SoicConfig()).minimize(T_init).T_camera_lidar,
    "PMI": lambda scene, T_init: scene.ascend(scene.intensity, T_init, "exact"),
    "semcal, MINE": lambda scene, T_init: scene.ascend(scene.labels, T_init, "mine"),
    "PMI, MINE": lambda scene, T_init: scene.ascend(scene.intensity, T_init, "mine"),
}
"""Methods by name. PMI follows Pandey et al.: mutual information of reflectivity and grey values, by its histogram or
by MINE."""

WITH_MINE = ("semcal, MINE", "PMI, MINE")

BY_INTENSITY = ("PMI", "PMI, MINE")
