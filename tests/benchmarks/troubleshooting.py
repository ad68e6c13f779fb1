"""Command that generates docs/troubleshooting.md from the entries of all checks."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path

from semcal_cli.checks.registry import ALL_CHECKS
from semcal_cli.experiments.summary import markdown_table
from semcal_cli.findings.check import Check, Evidence, Limit

WIDTH = 120
TEMPLATE = Path(__file__).with_name("troubleshooting_template.md")
"""The page without the table of findings and the entries."""


def page(checks: Iterable[Check] = ALL_CHECKS) -> str:
    """Make the page from checks in its order."""
    checks = tuple(checks)
    entries = "\n\n".join(_sections(checks))
    template = TEMPLATE.read_text(encoding="utf-8")
    return template.replace("@@TABLE@@", _table(checks).rstrip()).replace("@@ENTRIES@@", entries)


def _table(checks: Iterable[Check]) -> str:
    """List all findings, with links to their entries."""
    rows = [[f"[{check.topic}](#{check.topic})", check.entry.title, _limits(check)] for check in checks]
    return markdown_table(("finding", "what it says", "limit"), rows)


def _limits(check: Check) -> str:
    """List the limits of a check."""
    bounds = [f"{f'{name}: ' if name else ''}{_bound(limit)}" for name, limit in check.limits.items()]
    return "; ".join(bounds)


def _sections(checks: Iterable[Check]) -> Iterator[str]:
    """Write the sections, each with its entries."""
    for section, of_section in groupby(checks, lambda check: check.entry.section):
        yield "\n\n".join([f"## {section.value}", *map(_entry, of_section)])


def _entry(check: Check) -> str:
    """Write the entry of a check: its title, its quotes, its explanation and its limits."""
    entry = check.entry
    parts = {
        "What it means": entry.meaning,
        "Why it comes up": entry.cause,
        "What to do": entry.remedy,
        "Figure": entry.figure,
        "Limit": " ".join(_words(name, limit) for name, limit in check.limits.items()),
    }
    items = [_wrapped(f"- **{name}.** {text}") for name, text in parts.items() if text]
    quotes = [f"> {quote}" for quote in entry.quotes]
    heading = f'### <a id="{check.topic}"></a>{entry.title}'
    return "\n\n".join([heading, *quotes, "\n".join(items)])


def _wrapped(item: str) -> str:
    return textwrap.fill(item, WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


def _bound(limit: Limit) -> str:
    """Describe a limit without its source."""
    return f"{'at least' if limit.at_most is None else 'at most'} {limit.words(limit.value)}"


def _words(name: str, limit: Limit) -> str:
    """Describe a limit and its source."""
    bound = _bound(limit)
    sentence = f"For {name}, {bound}" if name else f"{bound[:1].upper()}{bound[1:]}"
    if limit.measured is None:
        return f"{sentence}: {limit.source}."
    source = limit.source[:1].upper() + limit.source[1:]
    return f"{sentence}: {_evidence(limit, limit.measured)}." + (f" {source}." if source else "")


def _evidence(limit: Limit, evidence: Evidence) -> str:
    """Describe what was measured on both sides of a limit."""
    worst, mildest = ("least", "most") if limit.at_most is None else ("most", "least")
    beyond = f" ({evidence.num_good_beyond} of them beyond the limit)" if evidence.num_good_beyond else ""
    good = f"{evidence.num_good} good drives had at {worst} {limit.words(evidence.worst_good)}{beyond}"
    if evidence.mildest_bad is None:
        return good
    within = f" ({evidence.num_bad_within} of them within the limit)" if evidence.num_bad_within else ""
    bad = f"{evidence.num_bad} with {evidence.bad_kind} at {mildest} {limit.words(evidence.mildest_bad)}{within}"
    return f"{good}, {bad}"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page(), encoding="utf-8")
