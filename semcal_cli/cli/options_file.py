"""Options of commands from a YAML file, so that a team runs the same thing again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from semcal_cli.errors import InputError, mismatch

VERSION_KEY = "semcal_options"
NEWEST_VERSION = 1


def read_options(path: Path, command: click.Command, takes_file: Callable[[str], bool]) -> dict[str, Any]:
    """Read the options of a command, as values that click takes in place of its defaults.

    Args:
        path: A YAML or JSON file: `semcal_options: 1`, and a mapping of options for each command.
        command: The command.
        takes_file: Tells whether another command has options from a file, too.

    Raises:
        InputError: the file is missing or wrong, or the command has no such option.
    """
    from semcal_cli.files.documents import read_document

    document = read_document(path)
    version = document.pop(VERSION_KEY, None)
    if type(version) is not int or version != NEWEST_VERSION:
        found = "add" if version is None else f"found version {version!r}, expected"
        raise InputError(f"{path}: {found} `{VERSION_KEY}: {NEWEST_VERSION}`")
    others = (key for key in document if key != command.name)
    if unknown := next((key for key in others if not takes_file(str(key))), None):
        raise InputError(f"{path}: found {unknown!r}, expected a command that has --config")
    command_options = document.get(str(command.name)) or {}
    if not isinstance(command_options, dict):
        raise InputError(f"{path}: {command.name}: {mismatch(repr(command_options), 'a mapping of options')}")
    options = {
        name.lstrip("-"): option
        for option in command.params
        for name in option.opts
        if isinstance(option, click.Option)
        and option.expose_value
        and not option.is_eager
        and name != "--config"
    }
    values = {}
    for key, value in command_options.items():
        where = f"{path}: {command.name}.{key}"
        if (option := options.get(str(key))) is None:
            raise InputError(f"{where}: `semcal {command.name}` takes no such option from a file")
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
    if isinstance(value, float) and isinstance(option.type, click.types.StringParamType):
        raise InputError(f"{where}: found the number {value:g}; write names in quotes")
    if value == "":
        raise InputError(f"{where}: found nothing, expected a value")
    path, metavar = folder / str(value), option.metavar or ""
    # Some options take a file or a name.
    is_path = isinstance(option.type, click.Path) or ("|" in metavar and "FILE" in metavar and path.exists())
    return str(path) if is_path and value != "-" else str(value)
