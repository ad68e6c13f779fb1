"""Fields of settings classes, which become the parameters of commands.

An option takes its type, its default and its name (with hyphens) from its field. A class inherits the options that
commands share, and their rules.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field, fields
from typing import Any, TypeVar

from semcal_cli.cli.parameter_types import OUTPUT_FILE
from semcal_cli.config.setting import settings_of

Made = TypeVar("Made")
PARAMETER, IS_ARGUMENT = "parameter", "is_argument"
KNOWN_TRANSFORMS = "a calibration, a drive with a reference, or any format that `convert --formats` lists"
LIMITS = ("minimum", "maximum", "above", "below")


def option(help: str, *names: str, default: Any = None, **about: Any) -> Any:
    """Make an option field.

    Args:
        help: Help text.
        names: Names of the option; if empty, the name of the field.
        default: Default value, which the help shows.
        about: Limits of a number (`minimum`, `maximum`, `above`, `below`), and other arguments of `click.Option`.
    """
    return field(default=default, metadata={PARAMETER: {"help": help, "names": names, **about}})


def output_file(help: str, *names: str, **about: Any) -> Any:
    """Make an option field for an output file."""
    return option(help, *names, type=OUTPUT_FILE, metavar="FILE", **about)


def argument(default: Any = None, **about: Any) -> Any:
    """Make an argument field, which is required unless it may be None; a tuple takes several values."""
    return field(default=default, metadata={PARAMETER: {IS_ARGUMENT: True, **about}})


def setting_of(config: type, name: str, *, help: str = "{}", is_open: bool = False) -> Any:
    """Make an option field for a setting, whose name, limits, default and help are defined in the configuration.

    Args:
        config: Configuration class.
        name: Field of the setting.
        help: Format that surrounds the setting's own help.
        is_open: Whether the value is None if the option is not given, because its default depends on other settings.
    """
    setting = settings_of(config)[name]
    return option(
        help.format(setting.help) + (f"  [default: {setting.default}]" if is_open else ""),
        setting.option or f"--{name.replace('_', '-')}",
        default=None if is_open else setting.default,
        metavar=None if setting.choices else setting.metavar,
        **{limit: getattr(setting, limit) for limit in LIMITS},
    )


def made_of(kind: Callable[..., Made], settings: Any, **others: Any) -> Made:
    """Construct an object, such as a configuration, from the settings that share its field names.

    Args:
        kind: Its class.
        settings: The settings.
        others: Values of its other fields.
    """
    names = {attribute.name for attribute in fields(kind)}  # type: ignore[arg-type]
    shared = names & {attribute.name for attribute in fields(settings)}
    return kind(**{name: getattr(settings, name) for name in shared} | others)
