"""Rows of a JSON list of mappings that may be larger than memory, read piece by piece."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from json import JSONDecodeError
from pathlib import Path
from typing import Any

from semcal_cli.errors import InputError, describe
from semcal_cli.files.documents import JSON, check_depth, check_texts, reason
from semcal_cli.files.input_files import check_size, open_file, size_of
from semcal_cli.files.yaml_values import MAX_DEPTH

MAX_ROWS_BYTES = 4 << 30
"""Maximum size of a list of rows. The largest table of nuScenes has 1.2 GB."""
MAX_ROW = 1 << 20
"""Maximum length of a row, in characters."""
PIECE = 1 << 20
"""Number of characters read at a time."""
TOO_LONG = f"found a row of more than {MAX_ROW:,} characters, expected a shorter one"
LONGEST_TOKEN = len("-Infinity")
"""Length of the longest word of JSON. A truncated word is an error at its beginning."""
_BLANKS = re.compile(r"[ \t\n\r]*")


def read_rows(path: Path) -> Iterator[dict[Any, Any]]:
    """Read the rows of a JSON list of mappings one by one.

    Raises:
        InputError: the file is missing, not UTF-8, too large or not well-formed, or is not a list of mappings.
    """
    with open_file(path) as file:
        check_size(path, size_of(file), MAX_ROWS_BYTES)
        text = _Text(io.TextIOWrapper(file, "utf-8-sig", newline=""))
        try:
            for index, row in enumerate(text.items()):
                if not isinstance(row, dict):
                    raise InputError(f"{path}: [{index}]: found {describe(row)}, expected a mapping")
                yield row
        except UnicodeDecodeError:
            raise InputError(f"{path}: found bytes that are not UTF-8, expected text") from None
        except (ValueError, RecursionError) as error:
            raise InputError(f"{path}: {reason(error, text.num_lines)}") from None


class _Text:
    """A text that is read piece by piece as needed, and dropped once parsed."""

    def __init__(self, file: io.TextIOBase) -> None:
        self._file = file
        self._text, self._place = "", 0
        self.num_lines = 0
        """Number of lines dropped so far."""

    def items(self) -> Iterator[Any]:
        """Parse the items of a list.

        Raises:
            ValueError: the text is not a list, or is not well-formed.
        """
        if self._next() != "[":
            raise ValueError(f"found {describe(self._value())}, expected a list of mappings")
        self._place += 1
        if self._next() != "]":
            yield self._value()
            while self._next() == ",":
                self._place += 1
                self._next()
                yield self._value()
        self._expect("]", "Expecting ',' delimiter")
        self._place += 1
        self._expect("", "Extra data")

    def _value(self) -> Any:
        has_more, start = self._reaches(MAX_ROW + LONGEST_TOKEN), self._place
        try:
            value, self._place = JSON.raw_decode(self._text, start)
        except JSONDecodeError as error:
            # A truncated row fails this far on. A truncated string fails at its beginning.
            if error.pos >= start + MAX_ROW or (has_more and error.msg.startswith("Unterminated string")):
                raise ValueError(TOO_LONG) from None
            raise
        if self._place - start > MAX_ROW:
            raise ValueError(TOO_LONG)
        if sum(self._text.count(opening, start, self._place) for opening in "[{") > MAX_DEPTH:
            check_depth(value)
        if self._text.find("\\", start, self._place) >= 0:
            check_texts(value)
        return value

    def _next(self) -> str:
        """Skip white space and return the next character; empty at the end."""
        while self._reaches(1):
            blanks = _BLANKS.match(self._text, self._place)
            self._place = blanks.end() if blanks else self._place
            if self._place < len(self._text):
                return self._text[self._place]
        return ""

    def _expect(self, character: str, complaint: str) -> None:
        if self._next() != character:
            raise JSONDecodeError(complaint, self._text, self._place)

    def _reaches(self, count: int) -> bool:
        """Read on until at least `count` characters lie ahead; return whether they do."""
        while len(self._text) - self._place < count and (more := self._file.read(PIECE)):
            self.num_lines += self._text.count("\n", 0, self._place)
            self._text, self._place = self._text[self._place :] + more, 0
        return len(self._text) - self._place >= count
