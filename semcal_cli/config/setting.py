"""A setting that a user chooses: its help and its limits, which stand beside its default in a configuration.

The command line makes its options of these, and `checking` checks with them what a program gives. Nothing heavy is
imported here.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import cache
from numbers import Integral, Real
from types import NoneType
from typing import Any, Literal, cast, get_args, get_origin, get_type_hints

KEY = "setting"
NEEDED: dict[Any, str] = {int: "a whole number", float: "a number", bool: "True or False", tuple: "a tuple"}
"""What messages say of a type."""
MAX_SEED = 2**63 - 1
"""Largest seed of random choices."""


@dataclass(frozen=True)
class Setting:
    """What is known of a setting beside its name and its default."""

    help: str
    """Sentence about it."""
    least: float | None = None
    most: float | None = None
    above: float | None = None
    below: float | None = None
    """Limits of a number, of which it may not reach the last two; None for no limit."""
    option: str = ""
    """Its option; empty if that has the name of the field."""
    metavar: str = "N"
    """Word for a number in the help."""
    section: str = ""
    """Heading in the help of a command that has many."""
    kind: Any = None
    default: Any = None
    """Type and default, which the field tells."""

    @property
    def choices(self) -> tuple[str, ...]:
        """The words that it can be; empty for a number."""
        return get_args(self.kind) if get_origin(self.kind) is Literal else ()

    def allows(self, value: object) -> bool:
        """Whether a value is one of the words, or a number within the limits; NaN and infinity are not."""
        if self.choices:
            return value in self.choices
        if not is_of(self.kind, value):
            return False
        number = cast(float, value)
        return (
            (self.least is None or number >= self.least)
            and (self.above is None or number > self.above)
            and (self.below is None or number < self.below)
            and (self.most is None or number <= self.most)
        )

    def needed(self) -> str:
        """Say which numbers are allowed."""
        limits = (
            ("from {:g}", self.least),
            ("above {:g}", self.above),
            ("below {:g}", self.below),
            ("to {}", self.most),
        )
        told = [text.format(limit) for text, limit in limits if limit is not None]
        return " ".join(
            [NEEDED[self.kind], *told, *(["on"] if self.most is self.below is self.above is None else [])]
        )


def setting(default: Any, help: str = "", **about: Any) -> Any:
    """Make the field of a dataclass that is a setting.

    Args:
        default: Its default; None where something else decides.
        help: Sentence about it; empty if it is no option as it stands.
        about: Other attributes of `Setting`.
    """
    return field(default=default, metadata={KEY: Setting(help, default=default, **about)})


@cache
def settings_of(config: type) -> dict[str, Setting]:
    """List the settings of a configuration by the names of its fields."""
    hints = get_type_hints(config)
    found = {each.name: each.metadata[KEY] for each in fields(config) if KEY in each.metadata}
    return {name: replace(about, kind=_without_none(hints[name])) for name, about in found.items()}


def is_of(kind: Any, value: object) -> bool:
    """Whether a value is of a type: whole numbers are numbers, too, and truth values, NaN and infinity are none."""
    if kind in (int, float):
        is_number = isinstance(value, Integral if kind is int else Real) and not isinstance(value, bool)
        with suppress(OverflowError):
            return is_number and math.isfinite(value)  # type: ignore[arg-type]
        return False
    if get_origin(kind) is tuple and isinstance(value, tuple):
        return all(is_of(get_args(kind)[0], each) for each in value)
    if get_origin(kind) is Literal:
        return value in get_args(kind)
    return isinstance(value, get_origin(kind) or kind)


@cache
def types_of(config: type) -> dict[str, tuple[Any, bool]]:
    """List the type of each field of a configuration, and whether it may be None."""
    hints = get_type_hints(config)
    return {
        each.name: (_without_none(hints[each.name]), NoneType in get_args(hints[each.name]))
        for each in fields(config)
    }


def _without_none(hint: Any) -> Any:
    is_union = get_origin(hint) is not Literal and NoneType in get_args(hint)
    return get_args(hint)[0] if is_union else hint
