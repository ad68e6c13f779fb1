"""What a calibration tells while it runs: what it does, and what each stage arrived at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from semcal_cli import _core
    from semcal_cli.geometry.pose_error import PoseError


@dataclass(frozen=True)
class Progress:
    """What is being done now."""

    doing: str
    """A verb and what it is about, as `reading frames`."""


@dataclass(frozen=True)
class StageDone:
    """What a stage arrived at."""

    name: str
    """Name of the stage, as in the result."""
    seconds: float
    """Time that the stage took."""
    note: str
    """What is worth telling of it."""
    agreement: _core.Agreement | None = None
    """How well labels agree at its pose; None of a stage without one."""
    moved: PoseError | None = None
    """How far its pose is from the one that it began with."""


Event: TypeAlias = Progress | StageDone
Listener: TypeAlias = Callable[[Event], None]


def ignore(event: Event) -> None:
    """Listen to nothing."""
