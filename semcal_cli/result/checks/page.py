"""The page docs/troubleshooting.md, made from the table of checks."""

from __future__ import annotations

import textwrap

from semcal_cli.result.checks.check import Check, Evidence, Limit
from semcal_cli.result.checks.table import SECTIONS

WIDTH = 120
HEAD = """\
# Troubleshooting: the reasons of a verdict

<!-- Written from the table of checks by `python -m semcal_cli.result.checks docs/troubleshooting.md`. -->

A verdict of `not_trusted` or `inconclusive` names each reason with its figure, and after the colon what to do.
Every reason has an entry here, quoted as it is printed; the figures in quotes are examples. Where there are
several, begin with the first: one wrong input often brings several reasons. Before all else, let `semcal inspect
DRIVE` look for mistakes in the files, and look at `semcal overlay DRIVE calibration.yaml -o overlays`: most
mistakes are seen on one picture.

Each entry with a figure has its limit, with what `semcal experiment trust --limits` measured on synthetic drives on
both sides of it, and where else it comes from.
"""
TAIL = """\
## <a id="looks-like"></a>Other commands

`semcal verify` gives the same reasons where it is inconclusive. Where it fails, it names what the stored transform
looks like, such as the inverse, the body frame, or millimetres: convert the file anew with the option that says so
([formats.md](formats.md#into-your-robot)). `semcal fleet` names drives that are far off or disagree, and says when
too few can be used ([many_drives.md](many_drives.md#what-they-say-of-the-rig)).
"""


def page() -> str:
    """Write the whole page."""
    sections = (
        f"## {title}\n\n" + "\n".join(entry(check) for check in checks) for title, checks in SECTIONS.items()
    )
    return "\n".join([HEAD, *sections, TAIL])


def entry(check: Check) -> str:
    """Write the entry of a check."""
    advices = check.advices or (check.advice,)
    quotes = [f"> {found}: {advice}\n" for found in check.examples for advice in advices]
    parts = {
        "What it means.": check.means,
        "Why it comes up.": check.why,
        "What to do.": check.to_do,
        "Limit.": limit_words(check),
    }
    items = (_item(f"- **{name}** {text}") for name, text in parts.items() if text)
    return f'### <a id="{check.topic}"></a>{check.title}\n\n' + "\n".join(quotes) + "\n" + "".join(items)


def limit_words(check: Check) -> str:
    """Say what a check measures, with its limits and where they come from; nothing if it has none."""
    if not check.limits:
        return ""
    needs = f" It needs {check.needs}." if check.needs else ""
    limits = " ".join(_one_limit(name, limit) for name, limit in check.limits.items())
    return f"The figure is the {check.measures}.{needs} {limits}"


def _one_limit(name: str, limit: Limit) -> str:
    most = "at least" if limit.at_most is None else "at most"
    of = f"For {name}, at" if name else "At"
    sentence = f"{of}{most.removeprefix('at')} {limit.words(limit.value)}"
    source = limit.source[:1].upper() + limit.source[1:]
    if limit.measured is None:
        return f"{sentence}: {limit.source}."
    return f"{sentence}: {_evidence(limit, limit.measured)}." + (f" {source}." if source else "")


def _evidence(limit: Limit, found: Evidence) -> str:
    """Say what was measured on both sides of a limit."""
    worst, mildest = ("least", "most") if limit.at_most is None else ("most", "least")
    beyond = f" ({found.num_good_beyond} of them beyond the limit)" if found.num_good_beyond else ""
    good = f"{found.num_good} good drives had at {worst} {limit.words(found.worst_good)}{beyond}"
    if found.mildest_bad is None:
        return good
    within = f" ({found.num_bad_within} of them within the limit)" if found.num_bad_within else ""
    return (
        f"{good}, {found.num_bad} with {found.bad_kind} at {mildest} {limit.words(found.mildest_bad)}{within}"
    )


def _item(text: str) -> str:
    lines = textwrap.wrap(text, WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
    return "\n".join(lines) + "\n"
