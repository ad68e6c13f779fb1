"""A setting that a user chooses, with its help and its limits next to its default in a configuration.

The command line makes its options from these, and checks the configurations that programs pass with them. Nothing
heavy is imported here.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from semcal_cli.errors import InputError, one_of

KEY = "setting"
NEEDED: dict[Any, str] = {
    int: "a whole number",
    float: "a number",
    bool: "True or False",
    tuple: "a tuple of",
}
"""How messages name a type."""
MAX_SEED = 2**63 - 1
"""Maximum seed."""


@dataclass(frozen=True)
class Setting:
    """A setting: help, limits and type."""

    help: str = ""
    """Sentence in the help."""
    minimum: float | None = None
    maximum: float | None = None
    above: float | None = None
    below: float | None = None
    """Limits of a number, the last two exclusive; None for no limit."""
    option: str = ""
    """Name of the option; empty if it follows from the name of the field."""
    metavar: str = "N"
    """Placeholder for a number in the help."""
    section: str = ""
    """Heading of the setting in a help of several sections."""
    kind: Any = None
    is_optional: bool = False
    default: Any = None
    """Type, whether it may be None, and default, all taken from the field."""

    @property
    def choices(self) -> tuple[str, ...]:
        """The words allowed; empty for other types."""
        return get_args(self.kind) if get_origin(self.kind) is Literal else ()

    def allows(self, value: Any) -> bool:
        """Return whether a value has the type and is within the limits.

        A whole number also counts as a number. Truth values, NaN and infinity do not.
        """
        plain = get_origin(self.kind) or self.kind
        if value is None or self.choices:
            return self.is_optional if value is None else value in self.choices
        if plain in (int, float):
            is_number = isinstance(value, Integral if plain is int else Real) and not isinstance(value, bool)
            with suppress(OverflowError):
                return is_number and math.isfinite(value) and self._is_within_limits(value)
            return False
        if plain is tuple and isinstance(value, tuple):
            return all(map(self.entry.allows, value))
        if plain in (Union, UnionType):
            return any(Setting(kind=kind).allows(value) for kind in get_args(self.kind))
        return isinstance(value, plain)

    @property
    def entry(self) -> Setting:
        """What each entry of a tuple is."""
        return Setting(kind=get_args(self.kind)[0])

    def _is_within_limits(self, number: float) -> bool:
        return (
            (self.minimum is None or number >= self.minimum)
            and (self.above is None or number > self.above)
            and (self.below is None or number < self.below)
            and (self.maximum is None or number <= self.maximum)
        )

    def needed(self, value: object) -> str:
        """Describe which values are allowed; among many words, those nearest to the wrong value come first."""
        if self.choices:
            return one_of(str(value), self.choices)
        plain = get_origin(self.kind) or self.kind
        if plain in (Union, UnionType):
            return " or ".join(Setting(kind=kind).needed(value) for kind in get_args(self.kind))
        words = [NEEDED.get(plain) or plain.__name__]
        if plain is tuple:
            words.append(getattr(self.entry.kind, "__name__", "words"))
        limits = ("from {:g}", self.minimum), ("above {:g}", self.above), ("below {:g}", self.below)
        words += [
            text.format(limit) for text, limit in (*limits, ("to {}", self.maximum)) if limit is not None
        ]
        is_open = self.maximum is self.below is self.above is None
        return " ".join([*words, "on"] if self.minimum is not None and is_open else words)


def setting(default: Any, help: str = "", **attributes: Any) -> Any:
    """Make a field of a dataclass that is a setting.

    Args:
        default: Its default; None where something else decides.
        help: Sentence in the help; empty if the field itself is not an option.
        attributes: Other attributes of `Setting`.
    """
    return field(default=default, metadata={KEY: Setting(help, default=default, **attributes)})


@cache
def settings_of(config: type, *, with_others: bool = False) -> dict[str, Setting]:
    """List the settings of a configuration by field name; `with_others` adds the fields that no user sets."""
    hints, settings = get_type_hints(config), {}
    for config_field in fields(config):
        if KEY in config_field.metadata or with_others:
            kind = hints[config_field.name]
            is_optional = get_origin(kind) is not Literal and NoneType in get_args(kind)
            setting = config_field.metadata.get(KEY, Setting())
            kind = get_args(kind)[0] if is_optional else kind
            settings[config_field.name] = replace(setting, kind=kind, is_optional=is_optional)
    return settings


def check_settings(config: Any) -> None:
    """Check the settings that a program passes, including those of nested configurations.

    Raises:
        InputError: a value has the wrong type, is not one of the allowed words, or is out of range.
    """
    config_type: type = type(config)
    for name, setting in settings_of(config_type, with_others=True).items():
        value = getattr(config, name)
        if not setting.allows(value):
            description = type(value).__name__ if is_dataclass(value) else repr(value)
            raise InputError(f"{name}: found {description}, expected {setting.needed(value)}")
        if is_dataclass(value):
            check_settings(value)
