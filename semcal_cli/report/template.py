"""What all pages have in common: the verdict at their head, and their templates, styles and scripts in one file."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import repeat
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from semcal_cli.documentation import entry_address
from semcal_cli.result.provenance import versions

PACKAGE = Path(__file__).parents[1]
ENVIRONMENT = Environment(
    loader=PackageLoader("semcal_cli", "."),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
"""Templates by their place in the package."""
ENVIRONMENT.filters |= {"signed": lambda text: text.replace("+-", "\u00b1"), "counted": "{:,}".format}


class Reason(NamedTuple):
    """A reason of a verdict, as a page shows it."""

    sentence: str
    """What was found, and what to do about it."""
    address: str | None = None
    """Where the documentation explains it; None if it has no entry."""


def linked(reasons: Sequence[str], topics: Sequence[str]) -> tuple[Reason, ...]:
    """Link reasons to their entries in the documentation; without topics, as in older files, none is linked."""
    addresses = map(entry_address, topics) if topics else repeat(None, len(reasons))
    return tuple(Reason(*each) for each in zip(reasons, addresses, strict=True))


class Verdict(NamedTuple):
    """The verdict at the head of a page."""

    status: str
    """A status of a calibration or a verdict of a verification, as the page is coloured."""
    title: str
    """The status in words."""
    sentence: str
    """What it means."""
    figures: str = ""
    """How good the transform is: intervals, and pixels some way ahead."""
    reasons: tuple[Reason, ...] = ()
    """What speaks against the transform."""


def render_page(
    template: str, scripts: tuple[str, ...] = (), style: str = "report/page.css", **content: Any
) -> str:
    """Fill a template with content, styles and scripts.

    Args:
        template: Place of the template in the package, as all places.
        scripts: Places of the scripts that it needs, after that of all pages.
        style: Place of the style that it needs beside that of all pages.
        content: What the template names.
    """
    styles = dict.fromkeys(("report/page.css", style))
    page = {"style": _source(*styles), "script": _source("report/page.js", *scripts)}
    return ENVIRONMENT.get_template(template).render(page | {"version": versions()["semcal"]} | content)


def _source(*names: str) -> Markup:
    """Read files, joined one after another."""
    return Markup("\n").join(Markup((PACKAGE / name).read_text()) for name in names)
