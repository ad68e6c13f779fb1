"""Options of commands from a YAML file, so that a team runs the same thing again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from semcal_cli.errors import InputError, mismatch

VERSION_KEY = "semcal_options"
NEWEST_VERSION = 1


def read_options(path: Path, command: click.Command, known: list[str]) -> dict[str, Any]:
    """Read the options of a command, as values that click takes in place of its defaults.

    Args:
        path: A YAML or JSON file: `semcal_options: 1`, and a mapping of options for each command.
        command: The command.
        known: Names of all commands that the file may hold.

    Raises:
        InputError: the file is missing or wrong, or the command has no such option.
    """
    from semcal_cli.files.documents import read_document

    document = read_document(path)
    if document.get(VERSION_KEY) != NEWEST_VERSION:
        raise InputError(
            f"{path}: add `{VERSION_KEY}: {NEWEST_VERSION}`, which states the version of the file"
        )
    if unknown := next((key for key in document if key not in (VERSION_KEY, *known)), None):
        raise InputError(f"{path}: `semcal --help` lists no command {unknown!r}")
    of_command = document.get(str(command.name)) or {}
    if not isinstance(of_command, dict):
        raise InputError(f"{path}: {command.name}: {mismatch(repr(of_command), 'a mapping of options')}")
    options = {name: option for option in command.params for name in option.opts}
    values = {}
    for key, value in of_command.items():
        where = f"{path}: {command.name}.{key}"
        if (option := options.get(f"--{key}")) is None:
            raise InputError(f"{where}: `semcal {command.name} --help` lists no such option")
        values[str(option.name)] = _value(option, value, path.parent, where)
    return values


def _value(option: click.Parameter, value: Any, folder: Path, where: str) -> Any:
    """Make the value that click parses, as if it was typed."""
    takes_list = option.multiple or option.nargs != 1
    if isinstance(value, list) != takes_list:
        raise InputError(f"{where}: {mismatch(repr(value), 'a list' if takes_list else 'one value')}")
    if isinstance(option, click.Option) and option.is_flag:
        if not isinstance(value, bool):
            raise InputError(f"{where}: {mismatch(repr(value), 'true or false')}")
        return value
    items = [_word(option, item, folder, where) for item in (value if takes_list else [value])]
    return items if takes_list else items[0]


def _word(option: click.Parameter, value: Any, folder: Path, where: str) -> str:
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise InputError(f"{where}: {mismatch(repr(value), 'a number or a text')}")
    is_path = isinstance(option.type, click.Path) and value != "-"
    return str(folder / str(value)) if is_path else str(value)
