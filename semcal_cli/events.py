"""Events of a running calibration: its current work and its finished stages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from semcal_cli import core
    from semcal_cli.geometry.poses import PoseError


@dataclass(frozen=True)
class Progress:
    """The current work."""

    doing: str
    """A verb and its object, such as `reading frames`: the same as long as the work is the same."""
    done: int = 0
    """Number of its parts that are done."""
    of: int = 0
    """Number of all its parts; zero if they cannot be counted."""


@dataclass(frozen=True)
class StageDone:
    """The result of a finished stage."""

    name: str
    """Name of the stage, as in the result."""
    seconds: float
    """Time that the stage took."""
    note: str
    """What the stage did, in plain words; empty if its movement says it all."""
    agreement: core.Agreement | None = None
    """Agreement of the labels at the stage's pose; None for a stage without labels."""
    moved: PoseError | None = None
    """How far the stage moved the pose from its start."""
    details: str = ""
    """Further details for experts."""


Event: TypeAlias = Progress | StageDone
Listener: TypeAlias = Callable[[Event], None]


def movement(moved: PoseError) -> str:
    """Describe how far a stage moved the pose."""
    return f"moved {moved.rotation_deg:.3f} degrees and {moved.camera_center_cm:.2f} cm"


def ignore(event: Event) -> None:
    """Ignore an event."""
