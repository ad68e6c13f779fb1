"""Plain values of a YAML text, composed directly from the events of the parser.

PyYAML itself builds a tree of nodes first, which takes ten times the time and memory. The parser is libyaml's where
PyYAML was built with it, and otherwise PyYAML's own, which is slower.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Iterable
from typing import Any, NamedTuple

import yaml
from yaml.events import AliasEvent, Event, MappingStartEvent, ScalarEvent, SequenceStartEvent
from yaml.reader import Reader

from semcal_cli.config.file_limits import MAX_WHOLE_KEY
from semcal_cli.errors import describe

MAX_DEPTH = 100
"""Maximum depth of nested lists and mappings."""
MAX_VALUES = 8_000_000
"""Maximum number of values in a text, including keys; lists and mappings count twice. A drive of 10,000 frames has
140,000."""


class Scalar(NamedTuple):
    """A type of plain scalars other than text."""

    pattern: str
    first: Iterable[str]
    """Characters that they begin with."""
    convert: Callable[[str], Any]
    """Conversion of the text to the value."""


def _float(text: str) -> float:
    return float(text.replace(".", "", 1) if text[-1] in "fFnN" else text)


CORE_SCHEMA = {  # YAML 1.2.2, section 10.3.2
    "null": Scalar(r"~|null|Null|NULL|", [*"~nN", ""], lambda text: None),
    "bool": Scalar(r"true|True|TRUE|false|False|FALSE", "tTfF", lambda text: text[0] in "tT"),
    "int": Scalar(r"[-+]?(0|[1-9][0-9]*)", "-+0123456789", int),
    "float": Scalar(
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        "-+0123456789.",
        _float,
    ),
}
_RULES: dict[str, list[tuple[Callable[[str], object], Callable[[str], Any]]]] = {}
for _scalar in CORE_SCHEMA.values():
    for _character in _scalar.first:
        _RULES.setdefault(_character, []).append((re.compile(_scalar.pattern).fullmatch, _scalar.convert))


def yaml_loader() -> Any:
    """Choose libyaml's loader if PyYAML was built with it, or else PyYAML's own."""
    return yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader


def parse_yaml(text: str) -> Any:
    """Parse a text of one document; an empty text is None.

    Raises:
        yaml.YAMLError: the text is not well-formed, has several documents, repeats a key, or has anchors, aliases or
            tags, which are refused.
        ValueError: the text has too many values, or they are nested too deeply.
    """
    if (control := Reader.NON_PRINTABLE.search(text)) is not None:
        raise yaml.reader.ReaderError("", control.start(), ord(control[0]), "unicode", "control character")
    next_event = yaml_loader()(text).get_event
    next_event()  # The stream starts.
    event = next_event()
    if isinstance(event, yaml.StreamEndEvent):
        return None
    document = _compose(next_event)
    next_event()  # The document ends.
    event = next_event()
    if not isinstance(event, yaml.StreamEndEvent):
        context, problem = "expected a single document in the stream", "but found another document"
        raise yaml.composer.ComposerError(context, None, problem, event.start_mark)
    return document


def _compose(next_event: Callable[[], Event]) -> Any:
    """Compose the value that the next events describe, without recursion."""
    root: list[Any] = []
    inner: list[Any] | dict[Hashable, Any] = root
    outer: list[tuple[list[Any] | dict[Hashable, Any], Hashable]] = []
    key: Hashable = _NO_KEY
    for _ in range(MAX_VALUES):
        event: Any = next_event()
        kind = type(event)
        if kind is ScalarEvent:
            _check_plain(event)
            value = plain_value(event.value) if event.implicit[0] else event.value
        elif kind is SequenceStartEvent or kind is MappingStartEvent:
            _check_plain(event)
            if len(outer) == MAX_DEPTH:
                raise ValueError("nested too deeply")
            if key is _NO_KEY and type(inner) is dict:
                raise _error("found unhashable key", event, "while constructing a mapping")
            outer.append((inner, key))
            inner, key = [] if kind is SequenceStartEvent else {}, _NO_KEY
            continue
        elif kind is AliasEvent:
            raise _refusal(event)
        else:
            value = inner
            inner, key = outer.pop()
        if type(inner) is list:
            inner.append(value)
            if inner is root:
                return value
        elif key is _NO_KEY:
            if type(value) is int and abs(value) > MAX_WHOLE_KEY:
                raise _error(
                    f"found key {describe(value)}, expected text or at most {MAX_WHOLE_KEY:,}", event
                )
            if value in inner:
                raise _error(f"key {describe(value)} is given twice", event)
            key = value
        else:
            inner[key] = value  # type: ignore[call-overload]
            key = _NO_KEY
    raise ValueError(f"found more than {MAX_VALUES:,} values, needed fewer")


_NO_KEY = object()


def plain_value(text: str) -> Any:
    """Return the value of a plain scalar: a number, a truth value, None or text."""
    for matches, convert in _RULES.get(text[:1], ()):
        if matches(text):
            return convert(text)
    return text


def _check_plain(event: Any) -> None:
    if event.anchor or event.tag:
        raise _refusal(event)


def _refusal(event: Event) -> yaml.MarkedYAMLError:
    return _error("anchors, aliases and tags are not supported", event)


def _error(problem: str, event: Event, context: str | None = None) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(context, None, problem, event.start_mark)  # type: ignore[arg-type]
