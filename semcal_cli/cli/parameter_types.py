"""Types of the parameters of commands: finite numbers, paths that are not empty, and names."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click

from semcal_cli.files.output_files import STANDARD_INPUT, STANDARD_OUTPUT
from semcal_cli.plugins import Plugins


class _Finite(click.ParamType[float]):
    """A number that is neither NaN nor infinity."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Parse the number, and check that it is finite."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{number} is not a finite number.", param, ctx)
        return number


class FiniteNumber(_Finite, click.types.FloatParamType):
    """A finite number: NaN and infinity are refused."""


class FiniteRange(_Finite, click.FloatRange):
    """A range of finite numbers: NaN and infinity are refused."""


class NamedPath(click.Path):
    """A path that is not empty, as those of scripts with an unset variable are."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Make the path."""
        if value == "":
            self.fail("found an empty name, expected a file or a folder.", param, ctx)
        return super().convert(value, param, ctx)


class StreamOrFile(NamedPath):
    """A file; `-` is a standard stream."""

    def __init__(self, stream: Path) -> None:
        super().__init__()
        self.stream = stream

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Make the path."""
        return self.stream if value == "-" else super().convert(value, param, ctx)


class Names(click.ParamType[tuple[str, ...]]):
    """Comma-separated names, each given once."""

    name = "names"

    def __init__(
        self,
        choices: tuple[str, ...] = (),
        alone: tuple[str, ...] = (),
        needed: str = "",
        plugins: Plugins | None = None,
    ) -> None:
        """Make the type.

        Args:
            choices: Allowed names, in the order of the value; empty accepts any.
            alone: Names that cannot be combined with others.
            needed: What messages say is needed if `choices` is empty.
            plugins: Plugins that add names.
        """
        self.choices, self.alone, self.needed, self.plugins = choices, alone, needed, plugins

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, ...]:
        """Parse the names, and sort them if it is known which there are."""
        if isinstance(value, tuple):
            return value
        names, choices = tuple(name.strip() for name in value.split(",")), self.choices
        if self.plugins is not None and not set(names) <= set(choices):
            choices = (*choices, *self.plugins.names)
        if "" in names or (choices and not set(names) <= set(choices)):
            needed = self.needed or f"one or more of {', '.join(choices)}"
            self.fail(f"found {value!r}, expected {needed}.", param, ctx)
        if len(set(names)) < len(names):
            self.fail(f"found {value!r}, expected each name once.", param, ctx)
        if single := next((name for name in self.alone if name in names and len(names) > 1), None):
            self.fail(f"found {value!r}, expected {single} alone.", param, ctx)
        return tuple(name for name in choices if name in names) or names


PATH = NamedPath()
INPUT_FILE, OUTPUT_FILE = StreamOrFile(STANDARD_INPUT), StreamOrFile(STANDARD_OUTPUT)
PLAIN_TYPES: dict[Any, click.ParamType[Any]] = {Path: PATH, str: click.STRING, bool: click.BOOL}
