"""Something that speaks against a pose."""

from __future__ import annotations

from typing import NamedTuple


class Finding(NamedTuple):
    """Something that speaks against a pose. The absence of findings does not prove that a pose is right."""

    topic: str
    """Short name that stays when sentences change, and the anchor of the entry in docs/troubleshooting.md."""
    found: str
    """What was found, with its figure and what was needed."""
    advice: str
    """What to do about it, in the imperative; empty if the sentence says it all."""

    @property
    def sentence(self) -> str:
        """The sentence to show: what was found, and what to do about it."""
        return f"{self.found}: {self.advice}" if self.advice else self.found


class Leading(NamedTuple):
    """The first reasons against a pose, which the others may follow from."""

    num: int
    """Number of them."""
    options: tuple[str, ...] = ()
    """Options of another calibration that corrects what the first one found."""
