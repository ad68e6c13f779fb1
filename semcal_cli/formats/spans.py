"""Places of the values in the text of a YAML or JSON document, so that a value is replaced without its surroundings.

The text is one that our reader accepts: without anchors, aliases, tags and repeated keys.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import yaml

from semcal_cli.files.dialect import compose_yaml, scalar_of

JSON_GAP = re.compile(r"[\s,:]*")
JSON_SIGN = re.compile(r'["\[\]{}]')
JSON_WORD = re.compile(r"[^\s,\]}]+")
DECODER = json.JSONDecoder()
BLANK = " \t\r\n\x85\u2028\u2029"


class Place(Protocol):
    """A value in a text."""

    @property
    def start(self) -> int:
        """Index of its first character."""

    @property
    def end(self) -> int:
        """Index after its last character."""

    @property
    def column(self) -> int | None:
        """Column of the items of a list or mapping in YAML's block style; None for any other value."""

    @property
    def items(self) -> dict[Any, Place]:
        """Places of the values of a mapping by their keys, or of a list by their indices, in order."""


@dataclass(frozen=True)
class JsonPlace:
    """A value in JSON. What lies in it is looked at only when it is asked for."""

    text: str
    start: int

    @cached_property
    def end(self) -> int:
        """Index after its last character."""
        at, depth = self.start, 0
        while True:
            sign = JSON_SIGN.match(self.text, at) if depth == 0 else JSON_SIGN.search(self.text, at)
            if sign is None:
                word = JSON_WORD.match(self.text, at)
                return at if word is None else word.end()
            at = sign.end()
            if sign[0] == '"':
                at = _after_string(self.text, sign.start())[1]
            else:
                depth += 1 if sign[0] in "[{" else -1
            if depth == 0:
                return at

    @property
    def column(self) -> None:
        """JSON has no block style."""

    @cached_property
    def items(self) -> dict[Any, Place]:
        """Places of the values of a mapping by their keys, or of a list by their indices, in order."""
        return dict(enumerate(self._values())) if self.text[self.start] == "[" else dict(self._pairs())

    def _values(self) -> Iterator[JsonPlace]:
        at = _after_gap(self.text, self.start + 1)
        while self.text[at] not in "]}":
            value = JsonPlace(self.text, at)
            yield value
            at = _after_gap(self.text, value.end)

    def _pairs(self) -> Iterator[tuple[str, JsonPlace]]:
        at = _after_gap(self.text, self.start + 1)
        while self.text[at] not in "]}":
            key, at = _after_string(self.text, at)
            value = JsonPlace(self.text, _after_gap(self.text, at))
            yield key, value
            at = _after_gap(self.text, value.end)


def _after_gap(text: str, at: int) -> int:
    gap = JSON_GAP.match(text, at)
    return at if gap is None else gap.end()


def _after_string(text: str, at: int) -> tuple[str, int]:
    """The string that begins at a quotation mark, and the index after it."""
    string, end = DECODER.raw_decode(text, at)
    return str(string), end


@dataclass(frozen=True)
class YamlPlace:
    """A value in YAML."""

    text: str
    node: yaml.Node

    @property
    def start(self) -> int:
        """Index of its first character."""
        return int(self.node.start_mark.index)

    @cached_property
    def end(self) -> int:
        """Index after its last character; PyYAML counts what follows a block to it, up to the next sign."""
        if self.column is None:
            end = int(self.node.end_mark.index)
            is_block = isinstance(self.node, yaml.ScalarNode) and self.node.style in ("|", ">")
            return len(self.text[:end].rstrip(BLANK)) if is_block else end
        return max(place.end for place in self.items.values())

    @property
    def column(self) -> int | None:
        """Column of the items of a list or mapping in block style; None for any other value."""
        is_block = isinstance(self.node, yaml.CollectionNode) and not self.node.flow_style
        return int(self.node.start_mark.column) if is_block else None

    @cached_property
    def items(self) -> dict[Any, Place]:
        """Places of the values of a mapping by their keys, or of a list by their indices, in order."""
        if isinstance(self.node, yaml.MappingNode):
            return {scalar_of(key): YamlPlace(self.text, value) for key, value in self.node.value}
        assert isinstance(self.node, yaml.SequenceNode)
        return {index: YamlPlace(self.text, value) for index, value in enumerate(self.node.value)}


def place_of(text: str, *, is_json: bool) -> Place:
    """Find the place of the document in its text."""
    if is_json:
        return JsonPlace(text, _after_gap(text, 0))
    return YamlPlace(text, compose_yaml(text))
