"""OpenCV's FileStorage as YAML, JSON or XML. OpenCV's own parser aborts the process on many damaged files.

Its YAML (modules/core/src/persistence_yml.cpp) differs from the standard: a first line `%YAML:1.0`, tags on
matrices, and, from older versions, no space after a key's colon. Its XML (persistence_xml.cpp) writes a key as an
element, an item of a sequence as an element `_`, and numbers with blanks between.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

from semcal_cli.errors import InputError, describe
from semcal_cli.files.documents import parse_document
from semcal_cli.formats.xml import parse_xml

FIRST_LINE = re.compile(r"\A\s*%YAML[: ]1\.\d[^\n]*\n")
MATRIX_TAG = re.compile(r"!!opencv-\w+|!<tag:[^>\n]{0,200}>")
TIGHT_COLON = re.compile(r"^([ \t]*[A-Za-z_]\w*):(?=[^\s])", re.MULTILINE)
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


def is_storage(text: str) -> bool:
    """Whether a text was written by OpenCV."""
    return text.lstrip().startswith(("%YAML:", "<")) or "opencv-matrix" in text


def parse_storage(text: str, path: Path) -> dict[Any, Any]:
    """Parse what OpenCV wrote; `path` names it in messages.

    Raises:
        InputError: the text is not well-formed, or is not a mapping.
    """
    return _parse_xml(text, path) if text.lstrip().startswith("<") else _parse_yaml(text, path)


def _parse_yaml(text: str, path: Path) -> dict[Any, Any]:
    """Parse YAML or JSON."""
    for pattern, replacement in ((FIRST_LINE, ""), (MATRIX_TAG, ""), (TIGHT_COLON, r"\1: ")):
        text = pattern.sub(replacement, text)
    return parse_document(text, path)


def _parse_xml(text: str, path: Path) -> dict[Any, Any]:
    root = parse_xml(text, path)
    try:
        document = _node(root)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: {_xml_reason(error)}") from None
    if root.tag != "opencv_storage" or not isinstance(document, dict):
        raise InputError(
            f"{path}: found XML of {describe(root.tag)}, needed 'opencv_storage' with keys in it"
        )
    return document


def _node(element: ET.Element) -> Any:
    """Convert an element to a mapping, a list, a text, a number or a list of numbers."""
    if len(element):
        if all(child.tag == "_" for child in element):
            return [_node(child) for child in element]
        keys = [child.tag for child in element]
        if len(set(keys)) < len(keys):
            repeated = next(key for key in keys if keys.count(key) > 1)
            raise ValueError(f"key {describe(repeated)} is given twice")
        return {child.tag: _node(child) for child in element}
    text = (element.text or "").strip()
    words = text.split()
    if not words or not all(NUMBER.fullmatch(word) for word in words):
        return text.strip('"')
    values = [float(word) for word in words]
    # A matrix of one number has a list of one.
    return values if len(values) > 1 or element.tag == "data" else values[0]


def _xml_reason(error: Exception) -> str:
    return "nested too deeply" if isinstance(error, RecursionError) else str(error)
