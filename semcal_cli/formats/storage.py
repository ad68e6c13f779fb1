"""OpenCV's FileStorage as YAML, JSON or XML. OpenCV's own parser aborts the process on many damaged files.

Its YAML (modules/core/src/persistence_yml.cpp) differs from the standard: a first line `%YAML:1.0`, tags on
matrices, and, from older versions, no space after a key's colon. Its XML (persistence_xml.cpp) writes a key as an
element, an item of a sequence as an element `_`, and numbers with blanks between.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from semcal_cli.errors import InputError
from semcal_cli.files.documents import parse_document
from semcal_cli.files.messages import describe, listed
from semcal_cli.files.reading import read_text
from semcal_cli.formats.values import image_side, number
from semcal_cli.formats.xml import parse_xml

FIRST_LINE = re.compile(r"\A\s*%YAML[: ]1\.\d[^\n]*\n")
MATRIX_TAG = re.compile(r"!!opencv-\w+|!<tag:[^>\n]{0,200}>")
TIGHT_COLON = re.compile(r"^([ \t]*[A-Za-z_]\w*):(?=[^\s])", re.MULTILINE)
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


def is_storage(text: str) -> bool:
    """Whether a text was written by OpenCV."""
    return text.lstrip().startswith(("%YAML:", "<")) or "opencv-matrix" in text


class Storage:
    """A file that OpenCV wrote. Messages name the file, the key, what was found and what was needed."""

    def __init__(self, path: Path, text: str | None = None):
        """Read a file, or its text if that is known."""
        text = read_text(path) if text is None else text
        self.path = path
        self.document = _parse_xml(text, path) if text.lstrip().startswith("<") else _parse_yaml(text, path)

    def numbers(self, *keys: str) -> list[float]:
        """Read the numbers of a matrix or a list, in order; a single number gives a list of one.

        Raises:
            InputError: the key is missing, or its value is something else.
        """
        node: Any = self.document
        for key in keys:
            node = node.get(key) if isinstance(node, dict) else None
        if isinstance(node, dict):
            node = node.get("data")
        values = node if isinstance(node, list) else [node]
        if not values or not all(
            isinstance(value, int | float) and not isinstance(value, bool) for value in values
        ):
            raise InputError(f"{self.path}: {'.'.join(keys)}: found {describe(node)}, needed numbers")
        return [number(f"{self.path}: {'.'.join(keys)}", value) for value in values]

    def first(self, names: Sequence[str]) -> list[float]:
        """Read the numbers under the first of several names that the file has.

        Raises:
            InputError: the file has none of the names.
        """
        for name in names:
            if name in self.document:
                return self.numbers(name)
        raise InputError(
            f"{self.path}: found keys {listed(self.document)}, needed one of: {', '.join(names)}"
        )

    def number(self, *keys: str) -> float:
        """Read a single number.

        Raises:
            InputError: the key is missing, or its value is something else.
        """
        values = self.numbers(*keys)
        if len(values) != 1:
            raise InputError(f"{self.path}: {'.'.join(keys)}: found {len(values)} numbers, needed one")
        return values[0]

    def side(self, *names: str) -> int:
        """Read the pixels along a side of the image, under the first of several names that the file has.

        Raises:
            InputError: the file has none of the names, or the value is not a whole number.
        """
        values = self.first(names)
        return image_side(f"{self.path}: {names[0]}", values[0] if len(values) == 1 else values)


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
    return values if len(values) > 1 else values[0]


def _xml_reason(error: Exception) -> str:
    return "nested too deeply" if isinstance(error, RecursionError) else str(error)
