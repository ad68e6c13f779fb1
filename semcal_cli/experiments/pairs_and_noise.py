"""Error against the number of pairs and the fraction of wrong labels, compared with the paper's method, SOIC and PMI.

The plots follow the box plots of Jiang, Osteen and Saripalli, arXiv 2104.12023.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from semcal_cli.errors import InputError, SemcalError, listed
from semcal_cli.experiments.drives import Pool
from semcal_cli.experiments.experiment_run import Experiment, Report
from semcal_cli.experiments.methods import METHODS, Scene
from semcal_cli.experiments.plots import GREY, draw_groups, make_logarithmic
from semcal_cli.experiments.summary import ERRORS, NUMBER, SECONDS, common, count, group_results
from semcal_cli.geometry.poses import compare_poses
from semcal_cli.geometry.twists import displace
from semcal_cli.observations.frame_selection import with_frames

if TYPE_CHECKING:
    from matplotlib.figure import Figure

START_DEG, START_M = 2.0, 0.2
"""Distance of the common start from the truth."""
SLOW_SETTINGS = ("10", "20%")
"""Settings in which slow methods run."""
SLOW_EVERY = 5
"""Slow methods run on the drives of seeds that this divides."""
NUM_INTERLEAVED = 4
"""Number of drives whose runs take turns, so that parallel runs do not make the same drive."""


@dataclass(frozen=True)
class ComparisonSetting:
    """A group of boxes: a number of pairs, and a fraction of wrong labels on both sides."""

    name: str
    num_pairs: int
    wrong: float = 0.0


EXPERIMENTS: dict[str, tuple[ComparisonSetting, ...]] = {
    "pairs": tuple(ComparisonSetting(f"{n}", n) for n in (1, 2, 5, 10, 20, 50, 70)),
    "noise": tuple(ComparisonSetting(f"{share:.0%}", 20, share) for share in (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)),
}
AXES = {"pairs": "pairs", "noise": "wrong labels"}
"""Label of the x axis of each experiment's plot, along which its settings differ."""
MEASURES = (("rotation_deg", "rotation error, degrees"), ("camera_center_cm", "camera centre error, cm"))
"""Errors of a result, with the labels of their axes."""


@dataclass(frozen=True)
class ComparisonCase:
    """One method in one setting on the drive of one seed."""

    setting: str
    """Name of the setting."""
    method: str
    """Key of `METHODS`."""
    seed: int
    """Seed of the drive."""


@dataclass(frozen=True)
class MethodError:
    """The error of one calibration against the truth."""

    setting: str
    method: str
    seed: int
    rotation_deg: float
    """Rotation error; infinite, like the other error, if the calibration failed."""
    camera_center_cm: float
    """Distance of the camera centre from the true one."""
    seconds: float
    """Time from pairs in memory to a pose."""
    failure: str = ""
    """Message of the error; empty if there was none."""

    @property
    def is_back(self) -> bool:
        """Whether the result is nearer to the truth than the common start, both in rotation and in position."""
        return self.rotation_deg < START_DEG and self.camera_center_cm < 100.0 * START_M


@dataclass(frozen=True)
class Choice:
    """The part of an experiment to run. Its runs are those of the whole experiment, which then goes on from them."""

    settings: Collection[str] = ()
    """Names of the settings; empty for all."""
    methods: Collection[str] = ()
    """Keys of `METHODS`; empty for all."""

    def has(self, setting: str) -> bool:
        """Return whether a setting is part of it."""
        return not self.settings or setting in self.settings


WHOLE = Choice()


def cases(
    settings: Sequence[ComparisonSetting], seeds: range, choice: Choice = WHOLE
) -> list[ComparisonCase]:
    """List the runs, a few drives at a time.

    Methods that compare no labels run once for each number of pairs, since wrong labels do not affect them.
    """
    chosen_pairs = {setting.num_pairs for setting in settings if choice.has(setting.name)}
    methods = {name: METHODS[name] for name in METHODS if not choice.methods or name in choice.methods}
    first_of = {setting.num_pairs: setting.name for setting in reversed(settings)}
    listed = []
    for start in range(seeds.start, seeds.stop, NUM_INTERLEAVED):
        drives = range(start, min(start + NUM_INTERLEAVED, seeds.stop))
        for setting, (name, method), seed in product(settings, methods.items(), drives):
            is_first = first_of[setting.num_pairs] == setting.name and setting.num_pairs in chosen_pairs
            is_chosen = choice.has(setting.name) if method.is_by_labels else is_first
            is_left_out = method.is_slow and (setting.name not in SLOW_SETTINGS or seed % SLOW_EVERY != 0)
            if is_chosen and not is_left_out:
                listed.append(ComparisonCase(setting.name, name, seed))
    return listed


def complete(
    settings: Sequence[ComparisonSetting], results: Sequence[MethodError], choice: Choice = WHOLE
) -> list[MethodError]:
    """Add the results of methods without labels to all chosen settings of the same number of pairs."""
    num_pairs = {setting.name: setting.num_pairs for setting in settings}
    return [
        replace(result, setting=setting.name)
        for result in results
        for setting in settings
        if choice.has(setting.name)
        if setting.name == result.setting
        or (setting.num_pairs == num_pairs[result.setting] and not METHODS[result.method].is_by_labels)
    ]


def run(
    settings: Sequence[ComparisonSetting],
    pool: Pool,
    changes: Mapping[str, object],
    removes_speckle: bool,
    case: ComparisonCase,
) -> list[MethodError]:
    """Reduce a drive to a setting and calibrate it by one method.

    Args:
        settings: All settings.
        pool: Drives, with their images.
        changes: Changes of the drives' `SynthConfig`.
        removes_speckle: Whether isolated wrong pixels are replaced for all methods but the paper's.
        case: The run.
    """
    setting = next(setting for setting in settings if setting.name == case.setting)
    num_frames = max(setting.num_pairs for setting in settings)
    drive, truth = pool.read("drive", {**changes, "num_frames": num_frames}, case.seed)
    rng = np.random.default_rng(case.seed)
    order, T_init = rng.permutation(num_frames), displace(truth, START_DEG, START_M, rng)
    chosen = with_frames(drive, sorted(order[: setting.num_pairs]))
    scene = Scene(chosen, wrong=setting.wrong, seed=case.seed, removes_speckle=removes_speckle)
    method, start = METHODS[case.method], perf_counter()
    try:
        observations, start = method.prepare(scene), perf_counter()
        error = compare_poses(method.find(scene, observations, T_init), truth)
    except SemcalError as failure:
        deg, cm, reason = math.inf, math.inf, str(failure)
    else:
        deg, cm, reason = error.rotation_deg, error.camera_center_cm, ""
    return [MethodError(case.setting, case.method, case.seed, deg, cm, perf_counter() - start, reason)]


def report(name: str, removes_speckle: bool, results: Sequence[MethodError]) -> Report:
    """Summarise the results by setting, in the order of the results, and by method, in the order of `METHODS`."""
    columns = (
        common("setting", AXES[name]),
        common("method", "method"),
        NUMBER,
        *ERRORS,
        count("came back", lambda result: result.is_back, "num_back"),
        SECONDS,
    )
    settings, methods = list(dict.fromkeys(result.setting for result in results)), list(METHODS)
    ordered = sorted(
        results, key=lambda result: (settings.index(result.setting), methods.index(result.method))
    )
    start = {"rotation_deg": START_DEG, "camera_center_m": START_M}
    facts = {"start": start, "is_mended": removes_speckle}
    return Report.of(ordered, columns, draw=partial(_plot, AXES[name], results), facts=facts)


def experiment(
    out: Path, seeds: range, name: str, choice: Choice = WHOLE, *, removes_speckle: bool
) -> Experiment[ComparisonCase, MethodError]:
    """Declare an experiment of `EXPERIMENTS`.

    Args:
        out: Folder of all experiments.
        seeds: Seeds of the drives.
        name: Key of `EXPERIMENTS`.
        choice: The part to run.
        removes_speckle: Whether isolated wrong pixels are replaced for all methods but the paper's.

    Raises:
        InputError: no run is part of the choice.
    """
    settings = EXPERIMENTS[name]
    chosen = cases(settings, seeds, choice)
    if not chosen:
        raise InputError(
            f"found no run of {listed(choice.methods)}, which run only at {' or '.join(SLOW_SETTINGS)} and on seeds "
            f"that {SLOW_EVERY} divides"
        )
    folder = out / (name if removes_speckle else f"{name}_unmended")
    drives = folder / "drives"
    return Experiment(
        name,
        folder,
        chosen,
        partial(run, settings, Pool(drives, has_images=True), {}, removes_speckle),
        MethodError,
        partial(report, name, removes_speckle),
        complete=partial(complete, settings, choice=choice),
        scratch=drives,
    )


def _plot(axis: str, results: Sequence[MethodError]) -> Figure:
    """Draw each method's errors in each setting, side by side as in the paper, and the percentage that came back."""
    from matplotlib.figure import Figure

    settings = list(dict.fromkeys(result.setting for result in results))
    groups = group_results(results, lambda error: (error.method, error.setting))
    colors = {name: METHODS[name].color for name in METHODS if any(error.method == name for error in results)}
    figure = Figure(figsize=(13.0, 9.0))
    *error_axes, share_axes = figure.subplots(3, 1, height_ratios=(3, 3, 2))
    for axes, (field, label) in zip(error_axes, MEASURES, strict=True):
        errors = [
            [[getattr(error, field) for error in groups.get((m, s), ())] for s in settings] for m in colors
        ]
        above = {"transform": axes.get_xaxis_transform(), "rotation": 90.0, "va": "top", "ha": "center"}
        for place, values in draw_groups(axes, errors, colors):
            if num_failed := sum(not math.isfinite(value) for value in values):
                axes.text(place, 1.0, f"{num_failed} failed", **above)
        make_logarithmic(axes)
        axes.set_ylabel(label)
    # The first method is drawn last: lines at 100 % cover one another.
    for method, color in reversed(colors.items()):
        groups_at = [(place, groups[method, s]) for place, s in enumerate(settings) if (method, s) in groups]
        shares = [
            100.0 * sum(error.is_back for error in errors_at) / len(errors_at) for _, errors_at in groups_at
        ]
        share_axes.plot([place for place, _ in groups_at], shares, "o-", color=color, markersize=4)
    share_axes.set_ylabel("nearer to the truth\nthan the start, %")
    share_axes.set_ylim(-5.0, 105.0)
    for axes in (*error_axes, share_axes):
        axes.set_xticks(range(len(settings)), settings)
        axes.set_xlim(-0.5, len(settings) - 0.5)
        axes.grid(axis="y")
        for border in range(1, len(settings)):
            axes.axvline(border - 0.5, color=GREY, linewidth=0.5)
    share_axes.set_xlabel(axis)
    figure.legend(*error_axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=len(colors))
    return figure
