"""Documents: YAML and JSON files that hold a mapping or a list, read strictly and written to the last bit.

YAML follows the 1.2 core schema: `no` and `1:30` are text, `1e-3` is a number. Anchors, aliases and tags are
refused, because semcal's files do not need them and a small file could expand into a large document with them.
"""

import json
import re
from collections.abc import Iterable, Mapping
from itertools import chain
from pathlib import Path
from typing import Any, Literal, TypeAlias

import yaml

from semcal_cli.config.file_limits import MAX_TABLE_BYTES
from semcal_cli.documentation import SCHEMA_KEYS, schema_address
from semcal_cli.errors import InputError, describe, mismatch
from semcal_cli.files.input_files import read_text
from semcal_cli.files.output_files import descriptor
from semcal_cli.files.yaml_values import CORE_SCHEMA, MAX_DEPTH, parse_yaml

DocumentFormat: TypeAlias = Literal["yaml", "json"]
FORMATS: dict[str, DocumentFormat] = {".yaml": "yaml", ".yml": "yaml", ".json": "json"}
LONGEST_LINE = 2**31 - 1
"""Number of columns after which a written line may be broken: the largest that libyaml accepts."""


def read_document(path: Path) -> dict[Any, Any]:
    """Read a mapping from a JSON file (by its suffix) or a YAML file.

    Raises:
        InputError: the file is missing, not UTF-8 or not well-formed, or its content is not a mapping.
    """
    return parse_document(read_text(path), path)


def parse_document(text: str, path: Path) -> dict[Any, Any]:
    """Read a mapping from the text of a JSON file (by its suffix) or a YAML file; messages name `path`.

    Raises:
        InputError: the text is not well-formed, or is not a mapping.
    """
    document = parse_any(text, path)
    if not isinstance(document, dict):
        raise InputError(f"{path}: found {describe(document)}, expected a mapping")
    return document


def read_list(path: Path) -> list[dict[Any, Any]]:
    """Read a list of mappings from a JSON file (by its suffix) or a YAML file.

    Raises:
        InputError: the file is missing, not UTF-8 or not well-formed, or its content is not a list of mappings.
    """
    document = parse_any(read_text(path), path)
    if not isinstance(document, list):
        raise InputError(f"{path}: found {describe(document)}, expected a list of mappings")
    for index, item in enumerate(document):
        if not isinstance(item, dict):
            raise InputError(f"{path}: [{index}]: found {describe(item)}, expected a mapping")
    return document


def read_json_lines(path: Path) -> list[Any]:
    """Read the lines of a file, each a JSON document of its own; blank lines are skipped.

    Raises:
        InputError: the file is missing or not UTF-8, or a line is not well-formed.
    """
    lines = enumerate(read_text(path, limit=MAX_TABLE_BYTES).split("\n"), start=1)
    return [_parse(line, "json", f"{path}: line {number}") for number, line in lines if line.strip()]


def parse_any(text: str, path: Path) -> Any:
    """Parse the text of a JSON file (by its suffix) or a YAML file; messages name `path`.

    Raises:
        InputError: the text is not well-formed.
    """
    return _parse(text, "json" if path.suffix.lower() == ".json" else "yaml", str(path))


def _parse(text: str, format: DocumentFormat, where: str) -> Any:
    try:
        return parse(text, format)
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None


def parse(text: str, format: DocumentFormat) -> Any:
    """Parse a text.

    Raises:
        ValueError: the text is not well-formed; the message names the place and the error.
    """
    try:
        if format == "yaml":
            document = parse_yaml(text)
        else:
            document = JSON.decode(text)
            check_depth(document)
        if "\\" in text:
            check_texts(document)
        return document
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError) as error:
        raise ValueError(reason(error)) from None


def check_texts(document: object) -> None:
    """Check that a document has no lone surrogates, which cannot be written as UTF-8. Only an escape can make one.

    Raises:
        ValueError: a key or a value has one.
    """
    try:
        json.dumps(document, ensure_ascii=False).encode()
    except UnicodeEncodeError as error:
        raise mismatch(ascii(error.object[error.start]), "text without lone surrogates") from None


def check_depth(document: object) -> None:
    """Check that a JSON document is no deeper than a YAML document may be, whatever the interpreter's limit.

    Raises:
        ValueError: it nests more than `MAX_DEPTH` lists and mappings.
    """
    level = [document]
    for _ in range(MAX_DEPTH + 1):
        nodes = [value for value in level if isinstance(value, dict | list)]
        if not nodes:
            return
        level = list(chain.from_iterable(node.values() if isinstance(node, dict) else node for node in nodes))
    raise ValueError("nested too deeply")


def reason(error: Exception, num_lines: int = 0) -> str:
    """Describe in a few words why a text is not well-formed; `num_lines` lines precede the parsed text."""
    match error:
        case RecursionError():
            return "nested too deeply"
        case json.JSONDecodeError():
            return f"line {num_lines + error.lineno}: {error.msg}"
        case yaml.MarkedYAMLError(problem="exceeded maximum nesting depth"):  # from PyYAML 6.0.4 on
            return "nested too deeply"
        case yaml.MarkedYAMLError():
            line = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
            return line + ", ".join(filter(None, (error.context, error.problem)))
        case yaml.reader.ReaderError():
            return f"character {error.position} is a control character"
    if "set_int_max_str_digits" in str(error):  # Python's own message advises programmers.
        return "found a whole number with too many digits"
    return str(error)


def _mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    mapping: dict[str, Any] = {}
    for key, value in pairs:
        if key in mapping:
            raise ValueError(f"key {describe(key)} is given twice")
        mapping[key] = value
    return mapping


def _refuse_constant(name: str) -> float:
    raise ValueError(f"found {name}, expected a finite number")


JSON = json.JSONDecoder(object_pairs_hook=_mapping, parse_constant=_refuse_constant)
"""The parser of JSON's dialect."""


def make_dumper(base: Any) -> Any:
    """Make a dumper for readers of YAML 1.1 and 1.2: text that either would read as another type is quoted.

    Args:
        base: PyYAML's own dumper, or libyaml's faster one, which writes the same bytes.
    """
    dumper: Any = type("Dumper", (base,), {})
    for name, scalar in CORE_SCHEMA.items():
        pattern = re.compile(f"^(?:{scalar.pattern})$")
        dumper.add_implicit_resolver(f"tag:yaml.org,2002:{name}", pattern, scalar.first)
    dumper.add_representer(list, _represent_list)
    return dumper


def _represent_list(dumper: Any, data: Iterable[Any]) -> yaml.SequenceNode:
    """Write a list of numbers on one line, so that each row of a matrix is a line."""
    flow_style = all(isinstance(item, int | float) for item in data)
    node: yaml.SequenceNode = dumper.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=flow_style)
    return node


_DUMPER = make_dumper(yaml.CSafeDumper if yaml.__with_libyaml__ else yaml.SafeDumper)


def document_text(document: Mapping[str, Any], format: DocumentFormat) -> str:
    """Format a document of plain values as text, with keys in the order given and floats exact to the last bit.

    YAML of a document that has a JSON Schema begins with a comment that gives editors its address.
    """
    plain = _plain(document)
    if format == "json":
        return json.dumps(plain, indent=2, allow_nan=False) + "\n"
    key, comment = next(iter(plain), ""), ""
    if key in SCHEMA_KEYS:
        comment = f"# yaml-language-server: $schema={schema_address(key, plain[key])}\n"
    return comment + yaml.dump(plain, Dumper=_DUMPER, sort_keys=False, width=LONGEST_LINE)


def _plain(value: Any) -> Any:
    """Reduce a value to types that both formats have: plain floats without negative zero, lists, dicts."""
    match value:
        case dict():
            return {key: _plain(item) for key, item in value.items()}
        case list() | tuple():
            return [_plain(item) for item in value]
        case float():
            return float(value) + 0.0
    return value


def output_format(path: Path) -> DocumentFormat:
    """Choose the output format by the suffix; a descriptor such as /dev/stdout gets YAML.

    Raises:
        InputError: the suffix is neither YAML's nor JSON's.
    """
    if not path.suffix and descriptor(path) is not None:
        return "yaml"
    try:
        return FORMATS[path.suffix.lower()]
    except KeyError:
        raise InputError(f"{path}: found suffix {path.suffix!r}, expected {', '.join(FORMATS)}") from None
