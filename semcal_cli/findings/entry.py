"""The entry of a check in docs/troubleshooting.md."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class PageSection(Enum):
    """Sections of docs/troubleshooting.md, in order, by their titles."""

    MOUNTING = "The mounting is not clear"
    DETERMINATION = "The labels do not determine the pose"
    CONVERGENCE = "The search for the pose did not converge"
    FILES = "Files do not belong together"
    CAMERA = "Camera, clocks and motion"
    STATED = "What you stated contradicts the data"
    INSPECTION = "What `semcal inspect` finds"


@dataclass(frozen=True, kw_only=True)
class Entry:
    """What docs/troubleshooting.md says of a check, in Markdown."""

    title: str
    section: PageSection
    quotes: tuple[str, ...]
    """Sentences as they are printed, with figures that are examples."""
    meaning: str
    """What the finding means."""
    cause: str
    """Why it comes up."""
    remedy: str
    """What to do."""
    figure: str = ""
    """What the limits apply to; empty for a check without limits."""
