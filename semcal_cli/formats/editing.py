"""Changes of a user's document in place: keys, order and comments stay.

The layout stays as far as ruamel.yaml keeps it: it indents all lists and mappings like the first ones. JSON is
formatted again with its former indentation.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from typing import Any

from semcal_cli.errors import InputError
from semcal_cli.formats.format import Source


def edited(source: Source, change: Callable[[Any], object]) -> str:
    """Change the document of a JSON file (by its suffix) or a YAML file, and return the new text.

    Raises:
        InputError: the file is not well-formed.
    """
    document = source.document  # Our own reader checks the file first, whatever the next one accepts.
    if source.path.suffix.lower() == ".json":
        change(document)
        return json.dumps(document, indent=_indent(source.text), allow_nan=False, ensure_ascii=False) + "\n"
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError
    from ruamel.yaml.util import load_yaml_guess_indent

    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = 2**31 - 1
    yaml.version = (1, 2)
    try:
        document, indent, offset = load_yaml_guess_indent(source.text, yaml=yaml)
    except (YAMLError, ValueError) as error:
        raise InputError(f"{source.path}: {str(error).splitlines()[0]}, needed YAML") from None
    yaml.indent(mapping=indent, sequence=indent, offset=offset)
    change(document)
    _set_in_rows(document)
    out = io.StringIO()
    yaml.version = None
    yaml.dump(document, out)
    return out.getvalue()


def _set_in_rows(document: Any) -> Any:
    """Write new lists of numbers on one line each."""
    from ruamel.yaml.comments import CommentedSeq

    if isinstance(document, dict):
        for key, value in document.items():
            document[key] = _set_in_rows(value)
    if type(document) is not list:
        return document
    rows = CommentedSeq(map(_set_in_rows, document))
    if all(isinstance(item, int | float) for item in document):
        rows.fa.set_flow_style()
    return rows


def _indent(text: str) -> int | None:
    """Number of spaces of the first indented line; None if no line is indented."""
    inner = next((line for line in text.splitlines() if line.startswith(" ")), None)
    return None if inner is None else len(inner) - len(inner.lstrip(" "))
