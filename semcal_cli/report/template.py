"""Templates of pages, and the files put into them unchanged, so that each page is one file."""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

ENVIRONMENT = Environment(
    loader=PackageLoader("semcal_cli", "."),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
"""Templates by their place in the package."""


def source(*names: str) -> Markup:
    """Read files of this folder, or of another one of the package, joined one after another."""
    return Markup("\n").join(Markup((Path(__file__).parent / name).read_text()) for name in names)
