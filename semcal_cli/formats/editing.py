"""Documents of the user's that are changed in place: comments, order and layout stay."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from typing import Any

from semcal_cli.errors import InputError
from semcal_cli.formats.format import Source


def edited(source: Source, change: Callable[[Any], object]) -> str:
    """Give the text of a JSON file (by its suffix) or a YAML file after a change of its document.

    Raises:
        InputError: the file is not well-formed.
    """
    document = source.document  # Checked by our own reader, whatever the next one lets pass.
    if source.path.suffix.lower() == ".json":
        change(document)
        return json.dumps(document, indent=_indent(source.text), allow_nan=False, ensure_ascii=False) + "\n"
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = 2**31 - 1
    yaml.version = (1, 2)
    try:
        document = yaml.load(source.text)
    except YAMLError as error:
        raise InputError(f"{source.path}: {str(error).splitlines()[0]}, needed YAML") from None
    change(document)
    out = io.StringIO()
    yaml.version = None
    yaml.dump(document, out)
    return out.getvalue()


def _indent(text: str) -> int | None:
    """Spaces of the first line that has some; none where all is on one line."""
    inner = next((line for line in text.splitlines() if line.startswith(" ")), None)
    return None if inner is None else len(inner) - len(inner.lstrip(" "))
