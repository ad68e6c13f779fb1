"""OpenCV's FileStorage as YAML or JSON. OpenCV's own parser aborts the process on many a damaged file.

Its YAML (modules/core/src/persistence_yml.cpp) is YAML but for the first line, `%YAML:1.0`, tags on matrices, and, by
older versions, no space after a key's colon.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from semcal_cli.documents import describe, parse_document, read_text
from semcal_cli.errors import InputError

FIRST_LINE = re.compile(r"\A\s*%YAML[: ]1\.\d[^\n]*\n")
MATRIX_TAG = re.compile(r"!!opencv-\w+|!<tag:[^>\n]*>")
TIGHT_COLON = re.compile(r"^(\s*[A-Za-z_]\w*):(?=[^\s])", re.MULTILINE)


def is_storage(text: str) -> bool:
    """Whether a text was written by OpenCV."""
    return text.lstrip().startswith(("%YAML:", "<?xml")) or "opencv-matrix" in text


class Storage:
    """A file that OpenCV wrote. Complaints name the file, the key, what was found and what was needed."""

    def __init__(self, path: Path):
        text = read_text(path)
        if text.lstrip().startswith("<"):
            raise InputError(f"{path}: found XML, needed a FileStorage in YAML or JSON")
        for pattern, replacement in ((FIRST_LINE, ""), (MATRIX_TAG, ""), (TIGHT_COLON, r"\1: ")):
            text = pattern.sub(replacement, text)
        self.path = path
        self.document = parse_document(text, path)

    def numbers(self, *keys: str) -> list[float]:
        """The numbers of a matrix or a list, in order; of a number, itself.

        Raises:
            InputError: there is no such key, or it holds something else.
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
        return [float(value) for value in values]

    def first(self, names: Sequence[str]) -> list[float]:
        """The numbers under the first of several names that is there.

        Raises:
            InputError: none is.
        """
        for name in names:
            if name in self.document:
                return self.numbers(name)
        known = ", ".join(map(str, self.document))
        raise InputError(f"{self.path}: found keys {known}, needed one of: {', '.join(names)}")

    def number(self, *keys: str) -> float:
        """One number.

        Raises:
            InputError: there is no such key, or it holds something else.
        """
        values = self.numbers(*keys)
        if len(values) != 1:
            raise InputError(f"{self.path}: {'.'.join(keys)}: found {len(values)} numbers, needed one")
        return values[0]

    def whole_number(self, *names: str) -> int:
        """A whole number under the first of several names that is there.

        Raises:
            InputError: there is none.
        """
        (value, *others) = self.first(names)
        if others or not value.is_integer():
            raise InputError(f"{self.path}: {names[0]}: found {value}, needed a whole number")
        return int(value)
