"""What all pages share: the verdict at the top, and templates, styles and scripts in one file."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import repeat
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from semcal_cli.documentation import entry_address
from semcal_cli.readable import signed
from semcal_cli.report.notations import T_notation, pair_notation
from semcal_cli.result.provenance import versions

PACKAGE = Path(__file__).parents[1]


def _shown(value: Any) -> Any:
    """Write the intervals of a text with plus-minus signs; all pages are UTF-8."""
    return type(value)(signed(value)) if isinstance(value, str) and "+- " in value else value


ENVIRONMENT = Environment(
    loader=PackageLoader("semcal_cli", "."),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
    finalize=_shown,
)
"""Templates by their path in the package."""
ENVIRONMENT.globals |= {"T_notation": T_notation, "pair_notation": pair_notation}
ENVIRONMENT.filters |= {"counted": "{:,}".format}


class Reason(NamedTuple):
    """A reason of a verdict, as a page shows it."""

    sentence: str
    """What was found, and what to do about it."""
    address: str | None = None
    """Address of the documentation that explains it; None if it has no entry."""


def link_reasons(reasons: Sequence[str], topics: Sequence[str] = (), prefix: str = "") -> tuple[Reason, ...]:
    """Link reasons to their entries in the documentation.

    Args:
        reasons: Sentences.
        topics: Topic of each reason; empty if there are none, as in older files, so that nothing is linked.
        prefix: Text before each reason.
    """
    addresses = map(entry_address, topics) if topics else repeat(None, len(reasons))
    return tuple(Reason(prefix + reason, address) for reason, address in zip(reasons, addresses, strict=True))


class PageVerdict(NamedTuple):
    """The verdict at the head of a page."""

    status: str
    """Status of a calibration or verdict of a verification, which gives the page its colour."""
    title: str
    """The status in words."""
    sentence: str
    """What it means."""
    figures: str = ""
    """How good the transform is: intervals, and pixels at some depth."""
    reasons: tuple[Reason, ...] = ()
    """What speaks against the transform."""


def render_page(
    template: str, scripts: tuple[str, ...] = (), style: str = "report/page.css", **content: Any
) -> str:
    """Fill a template with content, styles and scripts.

    Args:
        template: Path of the template in the package, as all paths here.
        scripts: Paths of the scripts that it needs, besides that of all pages.
        style: Path of the style that it needs besides that of all pages.
        content: Variables of the template.
    """
    styles = dict.fromkeys(("report/page.css", style))
    page = {"style": _source(*styles), "script": _source("report/page.js", *scripts)}
    return ENVIRONMENT.get_template(template).render(page | {"version": versions()["semcal"]} | content)


def _source(*names: str) -> Markup:
    """Read and join files."""
    return Markup("\n").join(Markup((PACKAGE / name).read_text()) for name in names)
