"""What every stage of the pipeline gives: a pose, its quality, and what speaks against it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from semcal_cli import _core
from semcal_cli.geometry.poses import Pose


class Finding(NamedTuple):
    """Something that speaks against a pose. No finding is no proof that the pose is right."""

    sentence: str
    """What was found, with its figure."""


@dataclass(frozen=True, kw_only=True)
class StageResult:
    """What a stage arrived at."""

    T_camera_lidar: Pose
    """(4, 4), p_camera = T_camera_lidar @ p_lidar, metres."""
    agreement: _core.Agreement
    """How well labels agree there, over all frames."""
    findings: tuple[Finding, ...] = ()
    """What the stage itself found against the pose."""
    settings: Mapping[str, object] = field(default_factory=dict)
    """Options of the stage that change the answer, by name."""
