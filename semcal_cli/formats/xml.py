"""XML without declarations of its own, so that no small file can grow into a large document."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

from semcal_cli.errors import InputError
from semcal_cli.formats.format import Source

DECLARATION = re.compile(r"<!(DOCTYPE|ENTITY)", re.IGNORECASE)


def looks_like_xml(source: Source, element: str) -> bool:
    """Tell whether a file begins as XML does and has such an element, without parsing it."""
    return source.start.startswith("<") and f"<{element}" in source.start


def parse_xml(text: str, path: Path) -> ET.Element:
    """Parse XML.

    Raises:
        InputError: the text is not well-formed, or declares entities or a document type.
    """
    if found := DECLARATION.search(text):
        raise InputError(f"{path}: found <!{found.group(1)}, needed XML without declarations")
    try:
        return ET.fromstring(text.lstrip())
    except ET.ParseError as error:
        raise InputError(f"{path}: line {error.position[0]}: found no well-formed XML, needed it") from None
    except RecursionError:
        raise InputError(f"{path}: nested too deeply") from None
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
