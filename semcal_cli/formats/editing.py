"""Changes of a user's document in place: every byte outside the replaced values stays as it is.

The change is made to the plain document. Where a value differs then, its text is replaced; new keys and items follow
the last one of their mapping or list. The new text is read again before anything is written.
"""

from __future__ import annotations

import codecs
import json
import math
import re
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

from semcal_cli.errors import InputError
from semcal_cli.files.documents import parse_any
from semcal_cli.formats.format import Source
from semcal_cli.formats.spans import Place, place_of

LINE_END = re.compile("\r\n|[\r\n\x85\u2028\u2029]")
COMMENT = re.compile("#[^\r\n\x85\u2028\u2029]*")
MARK = "\ufeff"
"""Byte order mark."""
PLAIN_WORD = re.compile(r"[A-Za-z_]\w*", re.ASCII)
NO_TEXT = {"true", "false", "null", "yes", "no", "on", "off", "y", "n"}
"""Words that readers of YAML 1.1 or 1.2 take for something else than text."""


def edited(source: Source, change: Callable[[Any], object]) -> bytes:
    """Change the document of a JSON file (by its suffix) or a YAML file, and return the new content of the file.

    Raises:
        InputError: the file is not well-formed, or the layout of its text does not allow the change.
    """
    wanted = deepcopy(source.document)
    change(wanted)
    text = source.text
    if text.startswith(MARK):
        raise InputError(f"{source.path}: found two byte order marks, needed one or none")
    edits = _Edits(text, is_json=source.path.suffix.lower() == ".json")
    if _is_same(source.document, wanted):
        return source.content
    edits.change(place_of(text, is_json=edits.is_json), source.document, wanted)
    after = edits.apply()
    if not _is_same(_parsed(after, source), wanted):
        raise InputError(
            f"{source.path}: found values that no others can replace where they stand, needed each key and each row "
            "on a line of its own"
        )
    mark = codecs.BOM_UTF8 if source.content.startswith(codecs.BOM_UTF8) else b""
    return mark + after.encode()


def _parsed(text: str, source: Source) -> Any:
    """The document of a text; None if the text is not well-formed."""
    try:
        return parse_any(text, source.path)
    except InputError:
        return None


def _is_same(a: Any, b: Any) -> bool:
    """Tell whether two values are the same; a number is neither true nor false, and NaN is NaN."""
    if a is b:
        return True
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_is_same(item, b[key]) for key, item in a.items())
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(x is y or _is_same(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, float) and isinstance(b, float):
        return a == b or (math.isnan(a) and math.isnan(b))
    return isinstance(a, bool) == isinstance(b, bool) and bool(a == b)


@dataclass
class _Edits:
    """Pieces of a text and what replaces them, in the order of the text."""

    text: str
    is_json: bool
    pieces: list[tuple[int, int, str]] = field(default_factory=list)

    def apply(self) -> str:
        """Make the new text; what is added at one place keeps its order, the innermost first."""
        parts, at = [], 0
        for start, end, new in sorted(self.pieces, key=lambda piece: piece[0]):
            parts += [self.text[at:start], new]
            at = end
        return "".join([*parts, self.text[at:]])

    def change(self, place: Place, before: Any, after: Any) -> None:
        """Replace what differs between two values that are not the same."""
        match before, after:
            case dict(), dict() if before.keys() <= after.keys():
                old, new = list(before), [key for key in after if key not in before]
            case list(), list() if after or not before:
                old = list(range(min(len(before), len(after))))
                new = list(range(len(before), len(after)))
                self._remove(place, len(after))
            case _:
                self._replace(place, after)
                return
        changed = [key for key in old if not _is_same(before[key], after[key])]
        for key in changed:
            self.change(place.items[key], before[key], after[key])
        if new:
            self._add(place, new, after)

    def _replace(self, place: Place, value: Any) -> None:
        """Replace a whole value: a list in block style by one of its style, anything else by a text on one line."""
        if place.column is not None and isinstance(value, list):
            rows = [f"- {self._flow(item)}" for item in value]
            new = (self._line_end(place.start) + " " * place.column).join(rows)
        else:
            follows_sign = place.start == place.end and self.text[place.start - 1 : place.start].strip()
            new = f" {self._flow(value)}" if follows_sign else self._flow(value)
        self.pieces.append((place.start, place.end, new))

    def _add(self, place: Place, keys: list[Any], container: Any) -> None:
        """Add keys of a mapping or indices of a list after the last one, laid out as that one is."""
        places = list(place.items.values())
        if place.column is not None:
            found = LINE_END.search(self.text, places[-1].end)
            at = len(self.text) if found is None else found.start()
            lines = [line for key in keys for line in self._lines(key, container)]
            before = self._line_end(at) + " " * place.column
            self.pieces.append((at, at, "".join(before + line for line in lines)))
            return
        gap = self._gap(place, places)
        new = [self._entry(key, container, gap) for key in keys]
        at = places[-1].end if places else place.start + 1
        separator = f",{gap or ' '}"
        self.pieces.append((at, at, (separator if places else "") + separator.join(new)))

    def _remove(self, place: Place, count: int) -> None:
        """Remove the items of a list after the first `count`, and leave the comments beside them."""
        places = list(place.items.values())
        for last, item in zip(places[count - 1 :], places[count:], strict=False):
            start = last.end
            gap = self.text[start : item.start]
            if place.column is None and "#" not in gap:
                self.pieces.append((start, item.end, ""))
                continue
            # Between two items stand blanks, comments and one sign.
            sign = start + COMMENT.sub(lambda found: " " * len(found[0]), gap).index(
                "," if place.column is None else "-"
            )
            if place.column is None:
                self.pieces += [(sign, sign + 1, ""), (item.start, item.end, "")]
            else:
                self.pieces.append((*self._whole_line(start, sign, item.end), ""))

    def _whole_line(self, low: int, start: int, end: int) -> tuple[int, int]:
        """Extend a piece of the text to its whole lines, if they begin after `low` and nothing else stands on them."""
        first = max((found.end() for found in LINE_END.finditer(self.text, low, start)), default=low)
        after = LINE_END.search(self.text, end)
        last = len(self.text) if after is None else after.end()
        if self.text[first:start].strip() or self.text[end:last].strip():
            return start, end
        return first, last

    def _lines(self, key: Any, container: Any) -> list[str]:
        """Lines of an item in block style; the rows of a matrix stand on a line each."""
        value = container[key]
        if isinstance(container, list):
            return [f"- {self._flow(value)}"]
        if _is_matrix(value):
            return [f"{self._text(key)}:", *(f"- {self._flow(row)}" for row in value)]
        return [f"{self._text(key)}: {self._flow(value)}"]

    def _entry(self, key: Any, container: Any, gap: str) -> str:
        """Text of an item between brackets; if each has a line of its own, so have the rows of a matrix."""
        value = container[key]
        if gap and _is_matrix(value):
            inner = gap + "  "
            text = f"[{inner}{f',{inner}'.join(map(self._flow, value))}{gap}]"
        else:
            text = self._flow(value)
        return text if isinstance(container, list) else f"{self._text(key)}: {text}"

    def _gap(self, place: Place, places: list[Place]) -> str:
        """Line end and indentation before the last item between brackets; empty if it stands beside another one."""
        if not places:
            return ""
        between = self.text[places[-2].end if len(places) > 1 else place.start : places[-1].start]
        ends = list(LINE_END.finditer(between))
        if not ends:
            return ""
        line = between[ends[-1].end() :]
        return ends[-1][0] + line[: len(line) - len(line.lstrip())]

    def _line_end(self, at: int) -> str:
        """End of the line at an index, or of the last line that has one."""
        if (found := LINE_END.search(self.text, at)) is not None:
            return found[0]
        return next(reversed(LINE_END.findall(self.text)), "\n")

    def _flow(self, value: Any) -> str:
        """Text of a value on one line, which readers of JSON and of YAML 1.1 and 1.2 take for the same."""
        match value:
            case dict():
                pairs = (f"{self._text(key)}: {self._flow(item)}" for key, item in value.items())
                return f"{{{', '.join(pairs)}}}"
            case list():
                return f"[{', '.join(map(self._flow, value))}]"
            case str():
                return self._text(value)
            case float():
                number = json.dumps(float(value) + 0.0, allow_nan=False)
                return number if "." in number else number.replace("e", ".0e")
        return json.dumps(value)

    def _text(self, text: str) -> str:
        """A text as it is in YAML, if it is a plain word, else in quotation marks."""
        is_plain = PLAIN_WORD.fullmatch(text) is not None and text.lower() not in NO_TEXT
        return text if is_plain and not self.is_json else json.dumps(text, ensure_ascii=False)


def _is_matrix(value: Any) -> bool:
    """Tell whether a value is a list of lists."""
    return isinstance(value, list) and bool(value) and all(isinstance(row, list) for row in value)
