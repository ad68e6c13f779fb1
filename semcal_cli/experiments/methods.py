"""The calibration methods to compare: each estimates a pose from the same pairs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from semcal_cli.config import Estimator, InitializationConfig, RefinementConfig
from semcal_cli.config.mine_config import MINE_WITH_VECTORS
from semcal_cli.config.paper_config import PaperConfig
from semcal_cli.drive.document import Drive
from semcal_cli.estimation.search.initial_pose import InitialPose
from semcal_cli.estimation.stage import StageResult
from semcal_cli.experiments.plots import ACCENT, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILION
from semcal_cli.experiments.soic import Soic
from semcal_cli.experiments.soic_config import SoicConfig
from semcal_cli.geometry.arrays import Pose
from semcal_cli.observations.cues.cue_table import load_cues
from semcal_cli.observations.loading import LoadedDrive
from semcal_cli.observations.observations import Observations
from semcal_cli.observations.reading import read_observations, remove_speckle
from semcal_cli.pipeline import initialize, paper, refine_and_polish, start_at
from semcal_cli.synthetic.label_noise import with_wrong_labels


@dataclass(eq=False)
class Scene:
    """The input of the methods: the labels and the intensities of the same pairs, read when needed."""

    drive: Drive
    """The drive, all of whose frames are used."""
    wrong: float = 0.0
    """Fraction of the labels on both sides that are replaced by wrong ones."""
    seed: int = 0
    """Seed of the wrong labels."""
    removes_speckle: bool = True
    """Whether isolated wrong pixels are replaced for all methods but the paper's."""
    is_initialized: bool = False
    """Whether the common start comes from an initial calibration; if not, coarse levels are ascended first."""

    @cached_property
    def raw_labels(self) -> Observations:
        """The labels as read; isolated pixels stay."""
        return with_wrong_labels(read_observations(self.drive), self.wrong, np.random.default_rng(self.seed))

    @cached_property
    def labels(self) -> Observations:
        """The labels as semcal uses them."""
        return remove_speckle(self.raw_labels) if self.removes_speckle else self.raw_labels

    @cached_property
    def intensity(self) -> Observations:
        """Levels of intensities and grey values, relative to their surroundings."""
        return load_cues(self.drive, ("intensity",))

    @cached_property
    def raw_intensity(self) -> Observations:
        """Raw intensities and grey values, as vectors of one number."""
        return load_cues(self.drive, ("intensity",), is_raw=True)

    def ascend(self, observations: Observations, T_init: Pose, estimator: Estimator) -> Pose:
        """Ascend mutual information as `calibrate` does or, from any other start, as `calibrate --init` does."""
        data = LoadedDrive(self.drive, observations)
        start = InitialPose(T_init, "start")
        initial: StageResult = (
            start_at(data, start)
            if self.is_initialized
            else initialize(data, InitializationConfig(), initial_pose=start)
        )
        return refine_and_polish(data, initial, RefinementConfig(estimator)).T_camera_lidar


@dataclass(frozen=True)
class Method:
    """A calibration method."""

    source: str
    """Attribute of `Scene` that holds the observations that it uses."""
    find: Callable[[Scene, Observations, Pose], Pose]
    """Function that estimates a pose from the scene, these observations and a start; it may raise a `SemcalError`."""
    color: str
    """Colour of the method in plots."""
    is_slow: bool = False
    """Whether it runs only on some drives and settings."""
    is_by_labels: bool = True
    """Whether it compares labels; otherwise wrong labels have no effect on it."""

    def prepare(self, scene: Scene) -> Observations:
        """Read what the method uses; the time of that counts for no method.

        Raises:
            SemcalError: the drive does not have it.
        """
        observations: Observations = getattr(scene, self.source)
        _ = observations.core
        return observations


PAPER = PaperConfig()
PMI_AS_PUBLISHED = replace(
    PAPER,
    mine=MINE_WITH_VECTORS,
    pyramid=replace(PAPER.pyramid, coarsest_block_deg=1.0),
)
"""Intensity guides the pose only locally: on both drives that were tried, coarser blocks led raw values farther
away."""


def _published(scene: Scene, observations: Observations, T_init: Pose) -> Pose:
    config = PMI_AS_PUBLISHED if observations.has_vectors else PAPER
    return paper.refine(observations, T_init, config, seed=0).T_camera_lidar


def _published_from_nothing(scene: Scene, observations: Observations, T_init: Pose) -> Pose:
    best, *_ = paper.initialize(observations, PAPER, seed=0)
    return _published(scene, observations, best.T_camera_lidar)


def _soic(scene: Scene, observations: Observations, T_init: Pose) -> Pose:
    return Soic(observations, SoicConfig()).minimize(T_init).T_camera_lidar


_exact, _mine = partial(Scene.ascend, estimator="exact"), partial(Scene.ascend, estimator="mine")
METHODS: dict[str, Method] = {
    "semcal": Method("labels", _exact, ACCENT),
    "paper": Method("raw_labels", _published, PURPLE),
    "paper, own start": Method("raw_labels", _published_from_nothing, ORANGE),
    "SOIC": Method("labels", _soic, VERMILION),
    "PMI": Method("intensity", _exact, GREEN, is_by_labels=False),
    "PMI as published": Method("raw_intensity", _published, SKY, is_by_labels=False),
    "semcal, MINE and polish": Method("labels", _mine, INK, is_slow=True),
    "PMI, MINE and polish": Method("intensity", _mine, GREY, is_slow=True, is_by_labels=False),
}
"""Methods by name. `paper` is Jiang et al.'s as published. PMI follows Pandey et al., mutual information of
reflectivity and grey values: with semcal's levels and polish, or by MINE on raw values as in Jiang et al."""
