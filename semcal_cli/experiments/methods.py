"""Ways to calibrate, as they are compared: each from the same pairs and the same start to a pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from semcal_cli.baselines.soic import Soic
from semcal_cli.config import Estimator, InitializationConfig, SoicConfig
from semcal_cli.drive.document import Drive
from semcal_cli.drive.observations import Observations
from semcal_cli.geometry.poses import Pose
from semcal_cli.pipeline import Given, RefinementConfig, Run


@dataclass(frozen=True)
class Scene:
    """What methods are given: the same pairs, by labels and by intensity."""

    drive: Drive
    labels: Observations
    intensity: Observations
    is_initialized: bool = False
    """The start is where an initial calibration ended; otherwise coarse levels are climbed first."""

    def climb(self, observations: Observations, T_init: Pose, estimator: Estimator) -> Pose:
        """Climb mutual information as `calibrate` does, `calibrate --init` if the start is any pose."""
        run = Run(self.drive, seed=0)
        if not self.is_initialized:
            given = Given(T_init, "start")
            T_init = run.initialize(observations, InitializationConfig(), given)[0].T_camera_lidar
        return run.refine(observations, T_init, RefinementConfig(estimator, is_assessed=False))


Method = Callable[[Scene, Pose], Pose]
"""From a start T_camera_lidar (4, 4) to a better one; raises a `SemcalError` where it finds none."""

METHODS: dict[str, Method] = {
    "semcal": lambda scene, T_init: scene.climb(scene.labels, T_init, "exact"),
    "SOIC": lambda scene, T_init: Soic(scene.labels, SoicConfig()).minimize(T_init).T_camera_lidar,
    "PMI": lambda scene, T_init: scene.climb(scene.intensity, T_init, "exact"),
    "semcal, MINE": lambda scene, T_init: scene.climb(scene.labels, T_init, "mine"),
    "PMI, MINE": lambda scene, T_init: scene.climb(scene.intensity, T_init, "mine"),
}
"""PMI is after Pandey et al.: mutual information of reflectivity and grey values, by its histogram or by MINE."""

WITH_MINE = ("semcal, MINE", "PMI, MINE")

BY_INTENSITY = ("PMI", "PMI, MINE")
