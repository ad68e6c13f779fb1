"""Result of a stage of the pipeline: a pose, its quality and its findings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from semcal_cli import _core
from semcal_cli.geometry.poses import Pose


class Finding(NamedTuple):
    """Something that speaks against a pose. The absence of findings does not prove that a pose is right."""

    topic: str
    """Short name of what it is about, which stays as sentences change: the anchor of its entry in
    docs/troubleshooting.md."""
    found: str
    """What was found, with its figure and what was needed."""
    advice: str
    """What to do about it, as an order: record, check, give or the like."""

    @property
    def sentence(self) -> str:
        """The sentence for a person: what was found, and what to do about it."""
        return f"{self.found}: {self.advice}"


@dataclass(frozen=True, kw_only=True)
class StageResult:
    """Pose that a stage found, with its quality and findings."""

    T_camera_lidar: Pose
    """(4, 4), p_camera = T_camera_lidar @ p_lidar, metres."""
    agreement: _core.Agreement
    """Agreement of the labels at this pose, over all frames."""
    bound_nats: float | None = None
    """Donsker-Varadhan bound on the mutual information (eq. 5) with which MINE ended; None for other stages."""
    findings: tuple[Finding, ...] = ()
    """Findings of the stage against the pose."""
    settings: Mapping[str, object] = field(default_factory=dict)
    """Options of the stage that change the answer, by name."""
