"""YAML and JSON documents: read without surprises, written so that a crash leaves no half a file.

YAML follows the 1.2 core schema: `no` and `1:30` are text, `1e-3` is a number. Anchors, aliases and tags are
refused: no file of ours needs them, and so no small file can grow into a large document.
"""

import difflib
import json
import os
import re
import secrets
import stat
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal, TypeAlias

import yaml

from semcal_cli.errors import InputError

Format: TypeAlias = Literal["yaml", "json"]
FORMATS: dict[str, Format] = {".yaml": "yaml", ".yml": "yaml", ".json": "json"}

MAX_LISTED = 8
MAX_LISTED_LENGTH = 40

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
    """Writes for readers of YAML 1.1 and 1.2: text that either would take for something else is quoted."""

    def represent_list(self, data: Iterable[Any]) -> yaml.SequenceNode:
        """Put numbers side by side, so that a matrix has a row a line."""
        flow_style = all(isinstance(item, int | float) for item in data)
        return self.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=flow_style)


for _name, (_pattern, _first) in _SCALARS.items():
    for _class in (_Loader, _Dumper):
        _class.add_implicit_resolver(f"tag:yaml.org,2002:{_name}", re.compile(f"^(?:{_pattern})$"), _first)
_Dumper.add_representer(list, _Dumper.represent_list)


def read_document(path: Path) -> dict[Any, Any]:
    """Read a mapping from a JSON file (by its suffix) or a YAML file.

    Raises:
        InputError: there is no such file, it is not UTF-8 or not well-formed, or holds something else.
    """
    return parse_document(read_text(path), path)


def parse_document(text: str, path: Path) -> dict[Any, Any]:
    """Read a mapping from the text of a JSON file (by its suffix) or a YAML file; `path` is for complaints.

    Raises:
        InputError: the text is not well-formed, or holds something else.
    """
    document = parse_any(text, path)
    if not isinstance(document, dict):
        raise InputError(f"{path}: found {describe(document)}, needed a mapping")
    return document


def read_list(path: Path) -> list[dict[Any, Any]]:
    """Read a list of mappings from a JSON file (by its suffix) or a YAML file.

    Raises:
        InputError: there is no such file, it is not UTF-8 or not well-formed, or holds something else.
    """
    document = parse_any(read_text(path), path)
    if not isinstance(document, list):
        raise InputError(f"{path}: found {describe(document)}, needed a list of mappings")
    for index, item in enumerate(document):
        if not isinstance(item, dict):
            raise InputError(f"{path}: [{index}]: found {describe(item)}, needed a mapping")
    return document


def read_json_lines(path: Path) -> list[Any]:
    """Read what the lines of a file hold, each a JSON document of its own; blank lines hold none.

    Raises:
        InputError: there is no such file, it is not UTF-8, or a line is not well-formed.
    """
    lines = enumerate(read_text(path).split("\n"), start=1)
    return [_parse(_parse_json, line, f"{path}: line {number}") for number, line in lines if line.strip()]


def parse_any(text: str, path: Path) -> Any:
    """Read what the text of a JSON file (by its suffix) or a YAML file holds; `path` is for complaints.

    Raises:
        InputError: the text is not well-formed.
    """
    return _parse(_parse_json if path.suffix.lower() == ".json" else _parse_yaml, text, str(path))


def _parse(parse: Callable[[str], Any], text: str, where: str) -> Any:
    try:
        document = parse(text)
        # Only an escape can stand for a lone surrogate.
        texts = _texts(document) if "\\" in text else iter(())
        text_found = next(filter(_is_no_text, texts), None)
    except RecursionError:
        raise InputError(f"{where}: nested too deeply") from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        raise InputError(f"{where}: {_reason(error)}") from None
    if text_found is not None:
        raise InputError(f"{where}: found {ascii(text_found)[:60]}, needed text without lone surrogates")
    return document


def _texts(document: object) -> Iterator[str]:
    """All keys and values that are text."""
    if isinstance(document, str):
        yield document
    elif isinstance(document, dict):
        for item in document.items():
            yield from _texts(item)
    elif isinstance(document, list | tuple):
        for item in document:
            yield from _texts(item)


def _is_no_text(text: str) -> bool:
    """Tell whether an escape stands for half a character, which no file can hold."""
    return any("\ud800" <= character <= "\udfff" for character in text)


def document_text(document: Mapping[str, Any], format: Format) -> str:
    """Write a document of plain values as text, keys in the order given, every float to its last bit."""
    plain = _plain(document)
    if format == "json":
        return json.dumps(plain, indent=2, allow_nan=False) + "\n"
    return yaml.dump(plain, Dumper=_Dumper, sort_keys=False, width=float("inf"))


def output_format(path: Path) -> Format:
    """Choose the format by the suffix.

    Raises:
        InputError: the suffix is neither YAML's nor JSON's.
    """
    try:
        return FORMATS[path.suffix.lower()]
    except KeyError:
        raise InputError(f"{path}: found suffix {path.suffix!r}, needed {', '.join(FORMATS)}") from None


def write_text(text: str, path: Path) -> None:
    """Write a UTF-8 file as `write_bytes` does."""
    write_bytes(text.encode("utf-8"), path)


def is_same_file(a: Path, b: Path) -> bool:
    """Tell whether two names are of one file, by links or otherwise."""
    return os.path.realpath(a) == os.path.realpath(b)


def write_bytes(content: bytes, path: Path) -> None:
    """Write a file as a whole or not at all: to a temporary file beside it, which is then renamed.

    Devices and pipes are written to, not replaced. A file that is replaced keeps its permissions.

    Raises:
        InputError: the file cannot be written. An existing one is untouched then.
    """
    target = Path(os.path.realpath(path))
    try:
        mode = target.stat().st_mode
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
            target.write_bytes(content)
            return
    except FileNotFoundError:
        mode = None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {_os_reason(error)}") from None
    temporary = target.with_name(f".{secrets.token_hex(8)}.tmp")
    try:
        with temporary.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        if mode is not None:
            temporary.chmod(stat.S_IMODE(mode))
        temporary.replace(target)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {_os_reason(error)}") from None
    finally:
        with suppress(OSError):
            temporary.unlink()


def describe(value: object) -> str:
    """Say in a few words, on one line, what was found in a document."""
    match value:
        case None:
            return "nothing"
        case dict():
            return "a mapping"
        case list() | tuple():
            return f"a list of {len(value)}"
        case bool():
            return str(value).lower()
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def one_of(wanted: str, known: Iterable[str]) -> str:
    """List what there is, the nearest first, if it is much."""
    names = list(known)
    if not names:
        return "one, but there is none"
    if len(names) > MAX_LISTED:
        near = difflib.get_close_matches(wanted, names, n=MAX_LISTED, cutoff=0.0)
        return f"one of {len(names)}, nearest: {', '.join(map(_cut, near))}"
    return f"one of: {', '.join(map(_cut, names))}" if len(names) > 1 else _cut(names[0])


def listed(names: Iterable[object]) -> str:
    """List the first of what was found in a file."""
    first = [_cut(str(name)) for name in names]
    more = [f"and {len(first) - MAX_LISTED:,} more"] if len(first) > MAX_LISTED else []
    return ", ".join(first[:MAX_LISTED] + more) or "none"


def _cut(name: str) -> str:
    return name if len(name) <= MAX_LISTED_LENGTH else f"{name[: MAX_LISTED_LENGTH - 3]}..."


def is_folder(path: Path) -> bool:
    """Tell whether there is a folder, also for names that are too long to ask for."""
    with suppress(OSError):
        return path.is_dir()
    return False


def read_bytes(path: Path, count: int | None = None) -> bytes:
    """Read a regular file, or its first `count` bytes: neither a pipe that nobody writes to nor an endless device.

    Raises:
        InputError: there is no such file, or it cannot be read.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            found = "a folder" if path.is_dir() else "no regular file"
            raise InputError(f"{path}: found {found}, needed a file")
        with path.open("rb") as file:
            return file.read() if count is None else file.read(count)
    except OSError as error:
        raise InputError(f"{path}: {_os_reason(error)}") from None


def read_text(path: Path) -> str:
    """Read a UTF-8 file, with or without a byte order mark.

    Raises:
        InputError: there is no such file, or it is not UTF-8.
    """
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8 text") from None


def _os_reason(error: OSError) -> str:
    if isinstance(error, FileNotFoundError | NotADirectoryError):
        return "no such file or folder"
    return (error.strerror or str(error)).lower()


def _parse_yaml(text: str) -> Any:
    return yaml.load(text, _Loader)


def _parse_json(text: str) -> Any:
    return json.loads(text, object_pairs_hook=_mapping, parse_constant=_refuse_constant)


def _mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    keys = [key for key, _ in pairs]
    if (index := _repeated(keys)) is not None:
        raise ValueError(_given_twice(keys[index]))
    return dict(pairs)


def _refuse_constant(name: str) -> float:
    raise ValueError(f"found {name}, needed a finite number")


def _repeated(keys: Iterable[Hashable]) -> int | None:
    """Find the first key that was there before."""
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
    if "set_int_max_str_digits" in str(error):  # Python's advice to programmers
        return "found a whole number of too many digits"
    return str(error)


def _plain(value: Any) -> Any:
    """Reduce to what both formats hold: plain floats without negative zero, lists, dicts."""
    match value:
        case dict():
            return {key: _plain(item) for key, item in value.items()}
        case list() | tuple():
            return [_plain(item) for item in value]
        case float():
            return float(value) + 0.0
    return value
