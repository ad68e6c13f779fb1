"""Command that regenerates the limits of all checks in a page, docs/troubleshooting.md."""

from __future__ import annotations

import re
import sys
import textwrap
from pathlib import Path

from semcal_cli.findings.check import CHECKS, Check, Evidence, Limit

WIDTH = 120
ENTRY = re.compile(r'^### <a id="([a-z-]+)"></a>.*?(?=^##|\Z)', re.MULTILINE | re.DOTALL)
"""Entry of a check, with its topic; the limits come last."""
LIMITS = "- **Limit.** "


def with_limits(page: str) -> str:
    """Regenerate the limits of all checks in the page."""
    return ENTRY.sub(lambda entry: _with_limits(entry[0], CHECKS[entry[1]]), page)


def _with_limits(entry: str, check: Check) -> str:
    text, _, _ = entry.partition(LIMITS)
    limits = " ".join(_words(name, limit) for name, limit in check.limits.items())
    lines = textwrap.wrap(
        LIMITS + limits, WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
    return "\n".join([text.rstrip(), *(lines if limits else []), "", ""])


def _words(name: str, limit: Limit) -> str:
    """Describe a limit and its source."""
    most = "at least" if limit.at_most is None else "at most"
    sentence = f"{f'For {name}, {most}' if name else most.capitalize()} {limit.words(limit.value)}"
    if limit.measured is None:
        return f"{sentence}: {limit.source}."
    source = limit.source[:1].upper() + limit.source[1:]
    return f"{sentence}: {_evidence(limit, limit.measured)}." + (f" {source}." if source else "")


def _evidence(limit: Limit, found: Evidence) -> str:
    """Say what was measured on both sides of a limit."""
    worst, mildest = ("least", "most") if limit.at_most is None else ("most", "least")
    beyond = f" ({found.num_good_beyond} of them beyond the limit)" if found.num_good_beyond else ""
    good = f"{found.num_good} good drives had at {worst} {limit.words(found.worst_good)}{beyond}"
    if found.mildest_bad is None:
        return good
    within = f" ({found.num_bad_within} of them within the limit)" if found.num_bad_within else ""
    bad = f"{found.num_bad} with {found.bad_kind} at {mildest} {limit.words(found.mildest_bad)}{within}"
    return f"{good}, {bad}"


if __name__ == "__main__":
    path = Path(sys.argv[1])
    path.write_text(with_limits(path.read_text(encoding="utf-8")), encoding="utf-8")
