"""What a check says: its limits with their sources, what it measured, and its finding."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from semcal_cli.findings.entry import Entry
from semcal_cli.findings.finding import Finding

LIMITS_FILE = Path(__file__).with_name("limits.json")
"""Limits by topic and name, with what `tests/benchmarks/check_limits.py` measured on both sides of each."""


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Values that one command measured on both sides of a limit."""

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
    """Value of the bad drive that is nearest to the limit, or farthest within it."""
    num_bad_within: int = 0
    """Number of bad drives within the limit, which other checks have to find."""
    by_rule: float | None = None
    """Limit that the rule of the command derives; None where good and bad drives overlap."""


@dataclass(frozen=True, kw_only=True)
class Limit:
    """Largest or smallest value without a finding, and where it comes from."""

    at_most: float | None = None
    at_least: float | None = None
    unit: str = ""
    """Unit of the value; "%" for a share of 1."""
    source: str = ""
    """Where the limit comes from, in addition to what was measured."""
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
        """Whether a value is within the limit."""
        return self.sign * value <= self.sign * self.value

    def words(self, value: float) -> str:
        """Format a value with its unit."""
        if self.unit == "%":
            return f"{100.0 * value:.3g} %"
        number = f"{value:.3g}" if abs(value) < 1000.0 else f"{value:,.0f}"
        return f"{number} {self.unit.removesuffix('s') if number == '1' else self.unit}".strip()


def read_limits(text: str) -> dict[str, dict[str, Limit]]:
    """Read limits by topic and name from JSON."""

    def entry(pairs: dict[str, Any]) -> object:
        if "num_good" in pairs:
            return Evidence(**pairs)
        return Limit(**pairs) if {"at_most", "at_least"} & pairs.keys() else pairs

    limits: dict[str, dict[str, Limit]] = json.loads(text, object_hook=entry)
    return limits


LIMITS = read_limits(LIMITS_FILE.read_text(encoding="utf-8"))


class Measured(NamedTuple):
    """What a check measured on a drive, with a finding if the value is beyond its limit."""

    topic: str
    limit: str
    """Name of the limit that the value is compared with."""
    value: float | None
    """The value; None for a finding that does not rest on a single value."""
    finding: Finding | None = None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The finding, if there is one."""
        return () if self.finding is None else (self.finding,)


@dataclass(frozen=True, kw_only=True)
class Check:
    """A check of a pose or of a drive, with its limits, and what to do if it fails."""

    topic: str
    """Short name that stays when sentences change, and the anchor of the entry in docs/troubleshooting.md."""
    advice: str = ""
    """What to do about it, in the imperative; empty if the sentence says it all, as many of an inspection do."""
    entry: Entry
    """The entry in docs/troubleshooting.md."""
    advice_beside_start: str = ""
    """What to do if a start was given, where `advice` is to give one."""
    explains: frozenset[str] = frozenset()
    """Topics of findings that may follow from this one, which then come after it."""
    options: tuple[str, ...] = ()
    """Options of another calibration that corrects what was found."""
    settings: Mapping[str, Limit] = field(default_factory=dict)
    """Limits by name that are settings, in addition to those in limits.json."""

    @property
    def limits(self) -> dict[str, Limit]:
        """All limits by name; a single limit has an empty name."""
        return {**self.settings, **LIMITS.get(self.topic, {})}

    def limit(self, name: str = "") -> float:
        """Look up a limit."""
        return self.limits[name].value

    def finding(self, sentence: str) -> Finding:
        """Make a finding from a sentence that gives the figure and what was needed."""
        return Finding(self.topic, sentence, self.advice)

    def without_value(self, sentence: str) -> Measured:
        """Make a finding that does not rest on a single value."""
        return Measured(self.topic, "", None, self.finding(sentence))

    def measured(self, value: float, sentence: str = "", limit: str = "") -> Measured:
        """Compare a value with a limit.

        Args:
            value: What was measured.
            sentence: Sentence of the finding; empty if the value makes no finding.
            limit: Name of the limit.
        """
        is_bad = sentence and not self.limits[limit].is_kept_by(value)
        return Measured(self.topic, limit, value, self.finding(sentence) if is_bad else None)


def findings_among(measured: Iterable[Measured]) -> tuple[Finding, ...]:
    """List the findings of all measurements."""
    return tuple(finding for value in measured for finding in value.findings)
