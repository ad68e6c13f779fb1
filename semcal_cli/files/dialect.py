"""The dialects of YAML and JSON that are read without surprises, and written to the last bit.

YAML follows the 1.2 core schema: `no` and `1:30` are text, `1e-3` is a number. Anchors, aliases and tags are
refused: semcal's files do not need them, and with them a small file could grow into a large document.
"""

import json
import re
from collections.abc import Hashable, Iterable, Iterator, Mapping
from typing import Any, Literal, TypeAlias

import yaml

from semcal_cli.files.messages import describe

Format: TypeAlias = Literal["yaml", "json"]
FORMATS: dict[str, Format] = {".yaml": "yaml", ".yml": "yaml", ".json": "json"}


_SCALARS = {  # YAML 1.2.2, section 10.3.2
    "null": (r"~|null|Null|NULL|", [*"~nN", ""]),
    "bool": (r"true|True|TRUE|false|False|FALSE", "tTfF"),
    "int": (r"[-+]?(0|[1-9][0-9]*)", "-+0123456789"),
    "float": (
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        "-+0123456789.",
    ),
}


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers: dict[str, Any] = {}

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.AliasEvent) or event.anchor or getattr(event, "tag", None):
            problem = "anchors, aliases and tags are not used here"
            raise yaml.composer.ComposerError(problem=problem, problem_mark=event.start_mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        mapping = super().construct_mapping(node, deep=deep)
        keys = [self.construct_object(key) for key, _ in node.value]
        if (index := _repeated(keys)) is not None:
            mark = node.value[index][0].start_mark
            raise yaml.constructor.ConstructorError(problem=_given_twice(keys[index]), problem_mark=mark)
        return mapping


class _Dumper(yaml.SafeDumper):
    """Writes for readers of YAML 1.1 and 1.2: text that either would read as another type is quoted."""

    def represent_list(self, data: Iterable[Any]) -> yaml.SequenceNode:
        """Put numbers side by side, so that each row of a matrix is on one line."""
        flow_style = all(isinstance(item, int | float) for item in data)
        return self.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=flow_style)


for _name, (_pattern, _first) in _SCALARS.items():
    for _class in (_Loader, _Dumper):
        _class.add_implicit_resolver(f"tag:yaml.org,2002:{_name}", re.compile(f"^(?:{_pattern})$"), _first)
_Dumper.add_representer(list, _Dumper.represent_list)


def parse(text: str, format: Format) -> Any:
    """Parse a text.

    Raises:
        ValueError: the text is not well-formed; the message names the place and the error.
    """
    try:
        document = _parse_json(text) if format == "json" else yaml.load(text, _Loader)
        # A lone surrogate can only come from an escape.
        texts = _texts(document) if "\\" in text else iter(())
        text_found = next(filter(_is_no_text, texts), None)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        raise ValueError(_reason(error)) from None
    if text_found is not None:
        raise ValueError(f"found {ascii(text_found)[:60]}, needed text without lone surrogates")
    return document


def compose_yaml(text: str) -> yaml.Node:
    """Find the nodes of a YAML text that `parse` accepts, with their places in it."""
    node = yaml.compose(text, _Loader)
    assert node is not None
    return node


def scalar_of(node: yaml.Node) -> Any:
    """Give the value of a scalar of `compose_yaml`, as `parse` gives it."""
    return _Loader("").construct_object(node)


def document_text(document: Mapping[str, Any], format: Format) -> str:
    """Format a document of plain values as text, with keys in the order given and floats exact to the last bit."""
    plain = _plain(document)
    if format == "json":
        return json.dumps(plain, indent=2, allow_nan=False) + "\n"
    return yaml.dump(plain, Dumper=_Dumper, sort_keys=False, width=float("inf"))


def _parse_json(text: str) -> Any:
    return json.loads(text, object_pairs_hook=_mapping, parse_constant=_refuse_constant)


def _texts(document: object) -> Iterator[str]:
    """All keys and values of a document that are text."""
    if isinstance(document, str):
        yield document
    elif isinstance(document, dict):
        for item in document.items():
            yield from _texts(item)
    elif isinstance(document, list | tuple):
        for item in document:
            yield from _texts(item)


def _is_no_text(text: str) -> bool:
    """Tell whether a text contains a lone surrogate, which no file can hold."""
    return any("\ud800" <= character <= "\udfff" for character in text)


def _mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    keys = [key for key, _ in pairs]
    if (index := _repeated(keys)) is not None:
        raise ValueError(_given_twice(keys[index]))
    return dict(pairs)


def _refuse_constant(name: str) -> float:
    raise ValueError(f"found {name}, needed a finite number")


def _repeated(keys: Iterable[Hashable]) -> int | None:
    """Index of the first key that repeats an earlier one."""
    seen: set[Hashable] = set()
    for index, key in enumerate(keys):
        if key in seen:
            return index
        seen.add(key)
    return None


def _given_twice(key: object) -> str:
    return f"key {describe(key)} is given twice"


def _reason(error: Exception) -> str:
    match error:
        case json.JSONDecodeError():
            return f"line {error.lineno}: {error.msg}"
        case yaml.MarkedYAMLError():
            line = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
            return line + ", ".join(filter(None, (error.context, error.problem)))
        case yaml.reader.ReaderError():
            return f"character {error.position} is a control character"
    if "set_int_max_str_digits" in str(error):  # This is Python's advice to programmers.
        return "found a whole number of too many digits"
    return str(error)


def _plain(value: Any) -> Any:
    """Reduce a value to types of both formats: plain floats without negative zero, lists, dicts."""
    match value:
        case dict():
            return {key: _plain(item) for key, item in value.items()}
        case list() | tuple():
            return [_plain(item) for item in value]
        case float():
            return float(value) + 0.0
    return value
