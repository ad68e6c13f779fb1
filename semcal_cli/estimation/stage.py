"""Result of a stage of the pipeline: a pose and its quality."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from time import perf_counter
from typing import TypeVar

from semcal_cli import core
from semcal_cli.events import Listener, Progress, StageDone
from semcal_cli.geometry.arrays import Pose
from semcal_cli.geometry.poses import compare_poses


@dataclass(frozen=True, kw_only=True)
class StageResult:
    """Pose that a stage found, with its quality."""

    T_camera_lidar: Pose
    """(4, 4), p_camera = T_camera_lidar @ p_lidar, metres."""
    agreement: core.Agreement
    """Agreement of the labels at this pose, over all frames."""
    bound_nats: float | None = None
    """Final Donsker-Varadhan bound of MINE on the mutual information (eq. 5); None for other stages."""
    note: str = ""
    """What the stage did, in plain words; empty if its movement says it all."""
    details: str = ""
    """Further details for experts."""
    settings: Mapping[str, object] = field(default_factory=dict)
    """Options of the stage that affect the result, by name."""


Result = TypeVar("Result", bound=StageResult)


def announced(
    name: str, doing: str, stage: Callable[[], Result], on_event: Listener, T_before: Pose | None = None
) -> Result:
    """Run a stage, and notify a listener when it starts and of its result.

    Args:
        name: Name of the stage, as in the result.
        doing: What it does, such as `refining`.
        stage: Function that finds the pose.
        on_event: Called with both events.
        T_before: (4, 4) pose that the stage starts from; None without one.
    """
    on_event(Progress(doing))
    start = perf_counter()
    result = stage()
    moved = None
    # A stage that keeps the previous pose returns the same object, and has not moved it.
    if T_before is not None and result.T_camera_lidar is not T_before:
        moved = compare_poses(result.T_camera_lidar, T_before)
    seconds = perf_counter() - start
    on_event(StageDone(name, seconds, result.note, result.agreement, moved, result.details))
    return result
