"""A check, its limits with where they come from, and what it measured."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from semcal_cli.result.stage import Finding

LIMITS_FILE = Path(__file__).with_name("limits.json")
"""Limits by topic and name. `semcal experiment trust --limits` measures the values on both sides of them."""


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What one command measured on both sides of a limit."""

    command: str
    first_seed: int
    num_seeds: int
    num_good: int
    """Number of calibrations of good drives."""
    worst_good: float
    """Value of the good drive that is nearest to the limit, or farthest beyond it."""
    num_good_beyond: int = 0
    """Number of good drives beyond the limit, which are not trusted."""
    bad_kind: str | None = None
    """What was wrong with the bad drives; None if no kind of bad drive belongs to the limit."""
    num_bad: int = 0
    mildest_bad: float | None = None
    """Value of the bad drive that is farthest on the good side."""
    num_bad_within: int = 0
    """Number of bad drives that keep the limit: other checks have to find what is wrong with them."""
    by_rule: float | None = None
    """Limit that the rule of the command gives; None where good and bad drives overlap."""


@dataclass(frozen=True, kw_only=True)
class Limit:
    """Largest or smallest value without a finding, and where it comes from."""

    at_most: float | None = None
    at_least: float | None = None
    unit: str = ""
    """Unit of the value; "%" for a share of 1."""
    source: str = ""
    """Where the limit comes from, beside what was measured."""
    measured: Evidence | None = None

    @property
    def value(self) -> float:
        """The limit itself."""
        value = self.at_least if self.at_most is None else self.at_most
        assert value is not None
        return value

    @property
    def sign(self) -> int:
        """1 if larger values are worse, -1 if smaller ones are."""
        return -1 if self.at_most is None else 1

    def is_kept_by(self, value: float) -> bool:
        """Whether a value does not speak against the pose."""
        return self.sign * value <= self.sign * self.value

    def words(self, value: float) -> str:
        """Format a value with its unit."""
        return f"{100.0 * value:.3g} %" if self.unit == "%" else f"{value:.3g} {self.unit}".strip()


def read_limits(text: str) -> dict[str, dict[str, Limit]]:
    """Read limits by topic and name from JSON."""

    def limit(entry: Mapping[str, object]) -> Limit:
        measured = entry.get("measured")
        evidence = None if measured is None else Evidence(**measured)  # type: ignore[arg-type]
        return Limit(**{**entry, "measured": evidence})  # type: ignore[arg-type]

    return {
        topic: {name: limit(entry) for name, entry in limits.items()}
        for topic, limits in json.loads(text).items()
    }


LIMITS = read_limits(LIMITS_FILE.read_text(encoding="utf-8"))


class Measured(NamedTuple):
    """What a check measured on a drive, and the finding if that is beyond its limit."""

    topic: str
    limit: str
    """Name of the limit that the value is compared with."""
    value: float | None
    """The value; None for a finding that no single value decides."""
    finding: Finding | None = None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The finding, if there is one."""
        return () if self.finding is None else (self.finding,)


@dataclass(frozen=True, kw_only=True)
class Check:
    """What speaks against a pose if it is beyond a limit, and what to do then."""

    topic: str
    """Short name, which stays as sentences change: the anchor of its entry in docs/troubleshooting.md."""
    advice: str
    """What to do about it, as an order: record, check, give or the like."""
    settings: Mapping[str, Limit] = field(default_factory=dict)
    """Limits that are settings, by name, beside those of limits.json."""

    @property
    def limits(self) -> dict[str, Limit]:
        """All limits by name; the name of a single one is empty."""
        return {**self.settings, **LIMITS.get(self.topic, {})}

    def limit(self, name: str = "") -> float:
        """Look up a limit."""
        return self.limits[name].value

    def finding(self, found: str) -> Finding:
        """Make the finding of what was found, a sentence with its figure and what was needed."""
        return Finding(self.topic, found, self.advice)

    def without_value(self, found: str) -> Measured:
        """Make a finding that no single value decides."""
        return Measured(self.topic, "", None, self.finding(found))

    def measured(self, value: float, found: str = "", limit: str = "") -> Measured:
        """Compare a value with a limit.

        Args:
            value: What was measured.
            found: Sentence of the finding; empty if the value alone makes none.
            limit: Name of the limit.
        """
        is_bad = found and not self.limits[limit].is_kept_by(value)
        return Measured(self.topic, limit, value, self.finding(found) if is_bad else None)


def findings_among(measured: Iterable[Measured]) -> tuple[Finding, ...]:
    """List the findings of what was measured."""
    return tuple(finding for each in measured for finding in each.findings)
