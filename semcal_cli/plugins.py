"""Formats, data sets and cues from other installed packages, found by their entry points.

Entry points are read only when all names are listed, or for a name that semcal itself does not have.
"""

from __future__ import annotations

import re
import sys
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, redirect_stdout
from functools import cached_property, wraps
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec, TypeVar

from semcal_cli.errors import SemcalError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

Kind = TypeVar("Kind")
Arguments = ParamSpec("Arguments")
NAME = re.compile(r"\w[\w.-]*")
"""Names that a command line can take: those that the specification of entry points recommends, with no dash first."""


class PluginError(SemcalError):
    """The code of a plugin failed, or returned something wrong."""


class PluginWarning(UserWarning):
    """A plugin is left out: the warning names its package, its entry point and the reason."""


class Plugins:
    """The plugins of one group of entry points."""

    def __init__(self, group: str, own_names: Iterable[str]) -> None:
        """Make the plugins of a group.

        Args:
            group: Name of the group, such as semcal.cues.
            own_names: semcal's own names, which no plugin can have.
        """
        self.group, self.own_names = group, tuple(own_names)
        self._loaded: dict[str, object] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the plugins, in the order of their packages, without those known to be broken."""
        return tuple(self._entries)

    def package(self, name: str) -> str:
        """Return the name and the version of a plugin's package."""
        return _package(self._entries[name])

    def get(self, name: str, kind: type[Kind]) -> Kind | None:
        """Load a plugin; None if there is none with this name, or, after one warning, if it is broken.

        Args:
            name: Name of the plugin.
            kind: Required class of the object that its entry point names.
        """
        if name not in self._entries:
            return None
        try:
            # What a module prints when it is imported is not the output of a command.
            with redirect_stdout(sys.stderr):
                plugin = self._loaded[name] if name in self._loaded else self._entries[name].load()
        except (Exception, SystemExit) as error:  # a foreign module may raise anything when it is imported
            self._leave_out(name, f"cannot be imported: {type(error).__name__}: {error}")
            return None
        if not isinstance(plugin, kind):
            self._leave_out(
                name, f"found an object of class {type(plugin).__name__}, expected {kind.__name__}"
            )
            return None
        self._loaded[name] = plugin
        return plugin

    def all(self, kind: type[Kind]) -> dict[str, Kind]:
        """Load all plugins, by name; broken ones are left out after one warning each."""
        plugins = {name: self.get(name, kind) for name in self.names}
        return {name: plugin for name, plugin in plugins.items() if plugin is not None}

    def guard(self, name: str, function: Callable[Arguments, Kind]) -> Callable[Arguments, Kind]:
        """Wrap a function of a plugin, so that whatever it raises names the plugin."""

        @wraps(function)
        def call(*arguments: Arguments.args, **keywords: Arguments.kwargs) -> Kind:
            with self.name_in_errors(name):
                return function(*arguments, **keywords)

        return call

    @contextmanager
    def name_in_errors(self, name: str) -> Iterator[None]:
        """Name a plugin in the errors of its code, which are not semcal's own.

        Raises:
            PluginError: the code raised anything else than an error that semcal reports itself.
        """
        try:
            yield
        except (SemcalError, RecursionError):  # a file that is nested too deeply is named by the reader
            raise
        except (Exception, SystemExit) as error:  # foreign code may raise anything, or end the program
            entry = self._entries[name]
            line = f"{_words(entry)}: {_place(entry, error)}{type(error).__name__}: {error}"
            raise PluginError(line) from error

    @cached_property
    def _entries(self) -> dict[str, EntryPoint]:
        # The import and the search take 30 ms; `semcal --help` takes 60 ms.
        from importlib.metadata import entry_points

        entries: dict[str, EntryPoint] = {}
        for entry in sorted(entry_points(group=self.group), key=lambda entry: (_package(entry), entry.name)):
            if not NAME.fullmatch(entry.name):
                _warn(
                    entry, "found this name, expected letters, digits, '_', '.' and '-', not '-' or '.' first"
                )
                continue
            if entry.name not in (*self.own_names, *entries):
                entries[entry.name] = entry
                continue
            holder = "semcal" if entry.name in self.own_names else _package(entries[entry.name])
            _warn(entry, f"found a name that {holder} already has; choose another")
        return entries

    def _leave_out(self, name: str, reason: str) -> None:
        _warn(self._entries.pop(name), reason)


def _package(entry: EntryPoint) -> str:
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else "an unknown package"


def _warn(entry: EntryPoint, reason: str) -> None:
    warnings.warn(" ".join(f"{_words(entry)}: {reason}".split()), PluginWarning, stacklevel=2)


def _words(entry: EntryPoint) -> str:
    return f"{_package(entry)}: entry point {entry.name} of {entry.group}"


def _place(entry: EntryPoint, error: BaseException) -> str:
    """Name the last line of the plugin's own code that led to an error."""
    own = entry.module.partition(".")[0]
    places = [
        f"{Path(frame.f_code.co_filename).name}, line {line}: "
        for frame, line in traceback.walk_tb(error.__traceback__)
        if str(frame.f_globals.get("__name__")).partition(".")[0] == own
    ]
    return places[-1] if places else ""
