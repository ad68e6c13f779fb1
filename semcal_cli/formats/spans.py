"""Places of the values in the text of a YAML or JSON document, so that a value is replaced without its surroundings.

The text is one that our reader accepts: without anchors, aliases, tags and repeated keys.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import yaml

from semcal_cli.files.documents import compose_yaml, scalar_of

JSON_GAP = re.compile(r"[\s,:]*")
DECODER = json.JSONDecoder()
BLANK = " \t\r\n\x85\u2028\u2029"


@dataclass(frozen=True)
class Place:
    """A value in a text."""

    start: int
    """Index of its first character."""
    end: int
    """Index after its last character."""
    find_items: Callable[[], dict[Any, Place]]
    column: int | None = None
    """Column of the items of a list or mapping in YAML's block style; None for any other value."""

    @cached_property
    def items(self) -> dict[Any, Place]:
        """Places of the values of a mapping by their keys, or of a list by their indices, in order."""
        return self.find_items()


def place_of(text: str, *, is_json: bool) -> Place:
    """Find the place of the document in its text."""
    return _json_place(text, _after_gap(text, 0)) if is_json else _yaml_place(text, compose_yaml(text))


def _json_place(text: str, start: int) -> Place:
    def items() -> dict[Any, Place]:
        found: dict[Any, Place] = {}
        at = _after_gap(text, start + 1)
        while text[at] not in "]}":
            key: Any = len(found)
            if text[start] == "{":
                key, end = DECODER.raw_decode(text, at)
                at = _after_gap(text, end)
            found[key] = _json_place(text, at)
            at = _after_gap(text, found[key].end)
        return found

    return Place(start, DECODER.raw_decode(text, start)[1], items)


def _after_gap(text: str, at: int) -> int:
    gap = JSON_GAP.match(text, at)
    return at if gap is None else gap.end()


def _yaml_place(text: str, node: yaml.Node) -> Place:
    def items() -> dict[Any, Place]:
        if isinstance(node, yaml.MappingNode):
            return {scalar_of(key): _yaml_place(text, value) for key, value in node.value}
        return {index: _yaml_place(text, value) for index, value in enumerate(node.value)}

    start, end = int(node.start_mark.index), int(node.end_mark.index)
    # PyYAML counts what follows a block to it, up to the next sign.
    if isinstance(node, yaml.CollectionNode) and not node.flow_style:
        end = max(place.end for place in items().values())
        return Place(start, end, items, int(node.start_mark.column))
    if getattr(node, "style", None) in ("|", ">"):
        end = len(text[:end].rstrip(BLANK))
    return Place(start, end, items)
