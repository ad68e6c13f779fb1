"""Documents: YAML and JSON files of a mapping or a list, read with messages that name the file."""

from pathlib import Path
from typing import Any

from semcal_cli.errors import InputError, describe
from semcal_cli.files.dialect import FORMATS, Format, parse
from semcal_cli.files.reading import MAX_TABLE_BYTES, read_text
from semcal_cli.files.streams import descriptor


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
        raise InputError(f"{path}: found {describe(document)}, needed a mapping")
    return document


def read_list(path: Path) -> list[dict[Any, Any]]:
    """Read a list of mappings from a JSON file (by its suffix) or a YAML file.

    Raises:
        InputError: the file is missing, not UTF-8 or not well-formed, or its content is not a list of mappings.
    """
    document = parse_any(read_text(path), path)
    if not isinstance(document, list):
        raise InputError(f"{path}: found {describe(document)}, needed a list of mappings")
    for index, item in enumerate(document):
        if not isinstance(item, dict):
            raise InputError(f"{path}: [{index}]: found {describe(item)}, needed a mapping")
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


def _parse(text: str, format: Format, where: str) -> Any:
    try:
        return parse(text, format)
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None


def output_format(path: Path) -> Format:
    """Choose the output format by the suffix; a descriptor as /dev/stdout gets YAML.

    Raises:
        InputError: the suffix is neither YAML's nor JSON's.
    """
    if not path.suffix and descriptor(path) is not None:
        return "yaml"
    try:
        return FORMATS[path.suffix.lower()]
    except KeyError:
        raise InputError(f"{path}: found suffix {path.suffix!r}, needed {', '.join(FORMATS)}") from None
