"""Templates of pages, and the files put into them unchanged, so that each page is one file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

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


def render_page(
    template: str, scripts: tuple[str, ...] = (), style: str = "report/page.css", **content: Any
) -> str:
    """Fill a template with content, styles and scripts.

    Args:
        template: Place of the template in the package, as all places.
        scripts: Places of the scripts that it needs, after that of the buttons that copy.
        style: Place of the style that it needs beside that of all pages.
        content: What the template names.
    """
    styles = dict.fromkeys(("report/page.css", style))
    page = {"style": _source(*styles), "script": _source("report/copy.js", *scripts)}
    return ENVIRONMENT.get_template(template).render(page | {"version": versions()["semcal"]} | content)


def _source(*names: str) -> Markup:
    """Read files, joined one after another."""
    return Markup("\n").join(Markup((PACKAGE / name).read_text()) for name in names)
