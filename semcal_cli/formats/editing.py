"""Changes of a user's document in place: no byte outside the replaced values changes.

The change is made to the plain document. Where a value then differs, its text is replaced; new keys follow the last key
of their mapping. The new text is read again before anything is written. Libraries that keep comments (ruamel.yaml)
change the layout of what they write: they lose comments between brackets, indentation and line ends.
"""

from __future__ import annotations

import codecs
import json
import math
import re
from collections.abc import Callable
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import yaml

from semcal_cli.errors import InputError
from semcal_cli.files.documents import compose_yaml, parse_any, scalar_of
from semcal_cli.formats.format import Source

LINE_END = re.compile("\r\n|[\r\n\x85\u2028\u2029]")
BLANK = " \t\r\n\x85\u2028\u2029"
JSON_GAP = re.compile(r"[\s,:]*")
DECODER = json.JSONDecoder()
MARK = "\ufeff"
"""Byte order mark."""
PLAIN_WORD = re.compile(r"[A-Za-z_]\w*", re.ASCII)
NO_TEXT = {"true", "false", "null", "yes", "no", "on", "off", "y", "n"}
"""Words that readers of YAML 1.1 or 1.2 do not read as text."""


def edited(source: Source, change: Callable[[Any], object]) -> bytes:
    """Change the document of a JSON file (by its suffix) or a YAML file, and return the new content of the file.

    Raises:
        InputError: the file is not well-formed, or the layout of its text does not allow the change.
    """
    wanted, text = deepcopy(source.document), source.text
    change(wanted)
    if text.startswith(MARK):
        raise InputError(f"{source.path}: found two byte order marks, needed one or none")
    if _is_same(source.document, wanted):
        return source.content
    edits = _Edits(text, is_json=source.path.suffix.lower() == ".json")
    edits.change(edits.document, source.document, wanted)
    after = edits.apply()
    with suppress(InputError):
        if _is_same(parse_any(after, source.path), wanted):
            mark = codecs.BOM_UTF8 if source.content.startswith(codecs.BOM_UTF8) else b""
            return mark + after.encode()
    raise InputError(
        f"{source.path}: found a layout in which values cannot be replaced, needed each key and each row on a "
        "separate line"
    )


def _is_same(a: Any, b: Any) -> bool:
    """Tell whether two values are the same; numbers differ from truth values, and NaN equals NaN."""
    if a is b:
        return True
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_is_same(item, b[key]) for key, item in a.items())
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(x is y or _is_same(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, float) and isinstance(b, float):
        return a == b or (math.isnan(a) and math.isnan(b))
    return isinstance(a, bool) == isinstance(b, bool) and bool(a == b)


@dataclass(frozen=True)
class _Place:
    """A value in a text."""

    start: int
    """Index of its first character."""
    end: int
    """Index after its last character."""
    find_items: Callable[[], dict[Any, _Place]]
    column: int | None = None
    """Column of the items of a list or mapping in YAML's block style; None for any other value."""

    @cached_property
    def items(self) -> dict[Any, _Place]:
        """Places of the values of a mapping by their keys, or of a list by their indices, in order."""
        return self.find_items()


def _json_place(text: str, start: int) -> _Place:
    def items() -> dict[Any, _Place]:
        found: dict[Any, _Place] = {}
        at = after_gap(start + 1)
        while text[at] not in "]}":
            key: Any = len(found)
            if text[start] == "{":
                key, end = DECODER.raw_decode(text, at)
                at = after_gap(end)
            found[key] = _json_place(text, at)
            at = after_gap(found[key].end)
        return found

    def after_gap(at: int) -> int:
        gap = JSON_GAP.match(text, at)
        return at if gap is None else gap.end()

    start = after_gap(start)
    return _Place(start, DECODER.raw_decode(text, start)[1], items)


def _yaml_place(text: str, node: yaml.Node) -> _Place:
    def items() -> dict[Any, _Place]:
        if isinstance(node, yaml.MappingNode):
            return {scalar_of(key): _yaml_place(text, value) for key, value in node.value}
        return {index: _yaml_place(text, value) for index, value in enumerate(node.value)}

    start, end = int(node.start_mark.index), int(node.end_mark.index)
    # PyYAML ends a block only where the next token begins.
    if isinstance(node, yaml.CollectionNode) and not node.flow_style:
        end = max(place.end for place in items().values())
        return _Place(start, end, items, int(node.start_mark.column))
    if getattr(node, "style", None) in ("|", ">"):
        end = len(text[:end].rstrip(BLANK))
    return _Place(start, end, items)


@dataclass
class _Edits:
    """Pieces of a text that our parser accepts, and their replacements."""

    text: str
    is_json: bool
    pieces: list[tuple[int, int, str]] = field(default_factory=list)

    @property
    def document(self) -> _Place:
        """Place of the whole document."""
        return _json_place(self.text, 0) if self.is_json else _yaml_place(self.text, compose_yaml(self.text))

    def apply(self) -> str:
        """Make the new text; additions at the same place keep their order, the innermost first."""
        parts, at = [], 0
        for start, end, new in sorted(self.pieces, key=lambda piece: piece[0]):
            parts += [self.text[at:start], new]
            at = end
        return "".join([*parts, self.text[at:]])

    def change(self, place: _Place, before: Any, after: Any) -> None:
        """Replace the parts in which two different values differ."""
        match before, after:
            case dict(), dict() if before.keys() <= after.keys():
                pairs = {key: (value, after[key]) for key, value in before.items()}
            case list(), list() if len(before) == len(after):
                pairs = dict(enumerate(zip(before, after, strict=True)))
            case _:
                self._replace(place, after)
                return
        for key, (old, new) in pairs.items():
            if not _is_same(old, new):
                self.change(place.items[key], old, new)
        if len(after) > len(before):
            self._add(place, {key: value for key, value in after.items() if key not in before})

    def _replace(self, place: _Place, value: Any) -> None:
        """Replace a whole value: a list in block style by one in block style, anything else by text on one line."""
        if place.column is not None and isinstance(value, list):
            rows = [f"- {self._flow(item)}" for item in value]
            new = (self._line_end(place.start) + " " * place.column).join(rows)
        else:
            follows_sign = place.start == place.end and self.text[place.start - 1 : place.start].strip()
            new = f" {self._flow(value)}" if follows_sign else self._flow(value)
        self.pieces.append((place.start, place.end, new))

    def _add(self, place: _Place, new: dict[str, Any]) -> None:
        """Add keys after the last key of a mapping, in its layout; each row of a matrix is on its own line."""
        places = list(place.items.values())
        if place.column is not None:
            found = LINE_END.search(self.text, places[-1].end)
            at = len(self.text) if found is None else found.start()
            before = self._line_end(at) + " " * place.column
            for key, value in new.items():
                rows = [self._flow(row) for row in value] if _is_matrix(value) else []
                lines = [
                    self._text(key) + (":" if rows else f": {self._flow(value)}"),
                    *(f"- {row}" for row in rows),
                ]
                self.pieces.append((at, at, "".join(before + line for line in lines)))
            return
        gap = self._gap(place, places)
        at = places[-1].end if places else place.start + 1
        for index, (key, value) in enumerate(new.items()):
            separator = f",{gap or ' '}" if places or index else ""
            text = self._flow(value)
            if gap and _is_matrix(value):
                text = f"[{gap}  {f',{gap}  '.join(map(self._flow, value))}{gap}]"
            self.pieces.append((at, at, f"{separator}{self._text(key)}: {text}"))

    def _gap(self, place: _Place, places: list[_Place]) -> str:
        """Line end and indentation before the last item between brackets; empty if it shares a line with another."""
        if not places:
            return ""
        between = self.text[places[-2].end if len(places) > 1 else place.start : places[-1].start]
        ends = list(LINE_END.finditer(between))
        if not ends:
            return ""
        line = between[ends[-1].end() :]
        return ends[-1][0] + line[: len(line) - len(line.lstrip())]

    def _line_end(self, at: int) -> str:
        """Line end after an index, or the last one in the text."""
        if (found := LINE_END.search(self.text, at)) is not None:
            return found[0]
        return next(reversed(LINE_END.findall(self.text)), "\n")

    def _flow(self, value: Any) -> str:
        """Text of a value on one line, which JSON, YAML 1.1 and YAML 1.2 all read alike."""
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
        """A text without quotation marks in YAML if it is a plain word, and otherwise with them."""
        is_plain = PLAIN_WORD.fullmatch(text) is not None and text.lower() not in NO_TEXT
        return text if is_plain and not self.is_json else json.dumps(text, ensure_ascii=False)


def _is_matrix(value: Any) -> bool:
    """Tell whether a value is a list of lists."""
    return isinstance(value, list) and bool(value) and all(isinstance(row, list) for row in value)
