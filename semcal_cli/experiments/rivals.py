"""Error against the number of pairs, and against wrong labels, in comparison with the paper's method, SOIC and PMI."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from time import perf_counter

import numpy as np

from semcal_cli.errors import SemcalError
from semcal_cli.experiments.methods import METHODS, Scene
from semcal_cli.experiments.pool import Pool, with_frames
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displaced

START_DEG, START_M = 2.0, 0.2
"""Distance of the common start from the truth."""
SLOW_SETTINGS = ("10", "20%")
"""Settings in which slow methods are run."""
SLOW_EVERY = 5
"""Divisor of the seeds on whose drives slow methods are run."""
TAKING_TURNS = 4
"""Number of drives whose runs take turns, so that parallel runs do not make the same drive."""


@dataclass(frozen=True)
class Setting:
    """A group of boxes: a number of pairs, and a share of wrong labels on both sides."""

    name: str
    num_pairs: int
    wrong: float = 0.0


EXPERIMENTS: dict[str, tuple[Setting, ...]] = {
    "pairs": tuple(Setting(f"{n}", n) for n in (1, 2, 5, 10, 20, 50, 70)),
    "noise": tuple(Setting(f"{share:.0%}", 20, share) for share in (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)),
}
AXES = {"pairs": "pairs", "noise": "wrong labels"}
"""Axis of the plot of each experiment, along which its settings differ."""


@dataclass(frozen=True)
class Case:
    """One method in one setting on the drive of one seed."""

    setting: str
    """Name of the setting."""
    method: str
    """Key of `METHODS`."""
    seed: int
    """Seed of the drive."""


@dataclass(frozen=True)
class Finding:
    """The error of one calibration against the truth."""

    setting: str
    """Name of the setting."""
    method: str
    """Key of `METHODS`."""
    seed: int
    """Seed of the drive."""
    rotation_deg: float
    """Rotation error; infinite, as the other error is, if the calibration failed."""
    camera_center_cm: float
    """Distance of the camera from its true place."""
    seconds: float
    """Time from pairs in memory to a pose."""
    failure: str = ""
    """Message of the error; empty if there was none."""

    @property
    def is_back(self) -> bool:
        """Whether the result is nearer to the truth than the common start, in rotation and in place."""
        return self.rotation_deg < START_DEG and self.camera_center_cm < 100.0 * START_M


def cases(settings: Sequence[Setting], seeds: range) -> list[Case]:
    """List the runs, some drives at a time.

    Wrong labels have no effect on methods that compare no labels. These have one run for each number of pairs.
    """
    first_of = {setting.num_pairs: setting.name for setting in reversed(settings)}
    found = []
    for start in range(seeds.start, seeds.stop, TAKING_TURNS):
        drives = range(start, min(start + TAKING_TURNS, seeds.stop))
        for setting, (name, method), seed in product(settings, METHODS.items(), drives):
            is_known = not method.is_by_labels and first_of[setting.num_pairs] != setting.name
            is_left_out = method.is_slow and (setting.name not in SLOW_SETTINGS or seed % SLOW_EVERY != 0)
            if not is_known and not is_left_out:
                found.append(Case(setting.name, name, seed))
    return found


def complete(findings: Sequence[Finding], settings: Sequence[Setting]) -> list[Finding]:
    """Add the results of methods without labels to all settings of the same number of pairs."""
    num_pairs = {setting.name: setting.num_pairs for setting in settings}

    def all_of(finding: Finding) -> Iterator[Finding]:
        for setting in settings:
            is_same = setting.num_pairs == num_pairs[finding.setting]
            if setting.name == finding.setting or (is_same and not METHODS[finding.method].is_by_labels):
                yield replace(finding, setting=setting.name)

    return [each for finding in findings for each in all_of(finding)]


@dataclass(frozen=True)
class Runner:
    """What all runs share; a call makes one run. It can be pickled for other processes."""

    settings: tuple[Setting, ...]
    pool: Pool
    """Drives, with their pictures."""
    is_mended: bool = True
    """Whether isolated wrong pixels are mended for all methods but the paper's."""
    changes: dict[str, object] = field(default_factory=dict)
    """Changes of the drives' `SynthConfig`."""

    def __call__(self, case: Case) -> list[Finding]:
        """Cut a drive down to a setting, and calibrate it by one method."""
        setting = next(setting for setting in self.settings if setting.name == case.setting)
        num_frames = max(setting.num_pairs for setting in self.settings)
        drive, truth = self.pool.read("drive", {**self.changes, "num_frames": num_frames}, case.seed)
        rng = np.random.default_rng(case.seed)
        order, T_init = rng.permutation(num_frames), displaced(truth, START_DEG, START_M, rng)
        scene = Scene(
            with_frames(drive, sorted(order[: setting.num_pairs])),
            wrong=setting.wrong,
            seed=case.seed,
            is_mended=self.is_mended,
        )
        method, start = METHODS[case.method], perf_counter()
        try:
            seen, start = method.prepare(scene), perf_counter()
            error = compare_poses(method.find(scene, seen, T_init), truth)
        except SemcalError as failure:
            deg, cm, reason = math.inf, math.inf, str(failure)
        else:
            deg, cm, reason = error.rotation_deg, error.camera_center_cm, ""
        seconds = perf_counter() - start
        return [Finding(case.setting, case.method, case.seed, deg, cm, seconds, reason)]
