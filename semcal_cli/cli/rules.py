"""Rules about which options of a command require or exclude others, checked when the command line is parsed.

A rule names options as a user writes them: `--init` stands for an option that is given, `--cue edges` for one that has
or contains this value, given or by default. The rules of a settings class hold for every command with its options: an
option that a command lacks is never given, and no message names it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import click

COMMANDLINE, DEFAULT_MAP = click.core.ParameterSource.COMMANDLINE, click.core.ParameterSource.DEFAULT_MAP
GIVEN = (COMMANDLINE, DEFAULT_MAP)
"""Where options come from that are typed, or that the file of --config states."""
OPTIONS_FILE = "options_file"
"""Name of the parameter for a file of options."""
FOR_ONE_CAMERA = "is for one camera, but {} is a rig"
"""Why an option is refused with a rig."""


def _has(context: click.Context, term: str) -> bool:
    name = term.partition(" ")[0]
    return any(name in parameter.opts for parameter in context.command.params)


def _holds(context: click.Context, term: str) -> bool:
    """Whether an option is given and is not None, or has a value."""
    option, _, value = term.partition(" ")
    name = next(
        (str(parameter.name) for parameter in context.command.params if option in parameter.opts), None
    )
    if name is None:
        return False
    setting = context.params[name]
    if value:
        return value in setting if isinstance(setting, tuple) else setting == value
    return context.get_parameter_source(name) in GIVEN and setting is not None


@dataclass(frozen=True)
class Rule:
    """A condition on some options, or on every use of a command if there are none."""

    subjects: tuple[str, ...]
    """The options."""
    required: tuple[str, ...] = ()
    """Options of which one is required."""
    excluded: tuple[str, ...] = ()
    """Options of which none is allowed."""
    where: tuple[str, ...] = ()
    """The rule applies only with one of these; always if empty."""
    because: str = ""
    """Reason, or what to do instead."""

    def requires(self, *options: str, where: Sequence[str] = (), because: str = "") -> Rule:
        """Require one of some other options."""
        return replace(self, required=options, where=tuple(where), because=because)

    def excludes(self, *options: str, because: str = "") -> Rule:
        """Exclude some other options."""
        return replace(self, excluded=options, because=because)

    def complaint(self, context: click.Context) -> str:
        """Describe how the options of a command break the rule; empty if they do not."""
        holds = partial(_holds, context)
        needed = [option for option in self.required if _has(context, option)]
        is_met = any(map(holds, needed))
        other = next(filter(holds, self.excluded), "")
        where = next(filter(holds, self.where), "")
        reason = f": {self.because}." if self.because else "."
        if not self.subjects:
            if needed:
                return "" if is_met else f"Give {_listed(needed)}."
            return other and f"{other} cannot be used with {context.command.name}{reason}"
        subject = next(filter(holds, self.subjects), "")
        if not subject or (self.where and not where):
            return ""
        if self.required and not is_met:
            place = f" with {where}" if where else ""
            return f"{subject} requires {_listed(needed)}{place}{reason}"
        return other and f"{subject} cannot be used with {other}{reason}"


def given(*options: str) -> Rule:
    """Begin a rule about any of these options."""
    return Rule(options)


def one_of(*options: str) -> Rule:
    """Make the rule that at least one of these options is given."""
    return Rule((), options)


def none_of(*options: str, because: str) -> Rule:
    """Make the rule that a command accepts none of these options or values, which it shares with other commands."""
    return Rule((), excluded=options, because=because)


def misuse(context: click.Context, complaint: str) -> click.UsageError:
    """Make the error about options, which names the file that states some."""
    file = context.params.get(OPTIONS_FILE)
    return click.UsageError(f"{complaint} {file} states some options." if file else complaint, context)


def refuse(
    context: click.Context,
    names: Iterable[str],
    why: str,
    sources: Sequence[click.core.ParameterSource] = GIVEN,
) -> None:
    """Refuse options that the input does not allow.

    Args:
        context: The command.
        names: Names of the options to refuse.
        why: Rest of the sentence after the option's name.
        sources: Where refused options come from.

    Raises:
        click.UsageError: one is given.
    """
    source = context.get_parameter_source
    used = {
        name for item in context.command.params if source(str(item.name)) in sources for name in item.opts
    }
    if name := next(filter(used.__contains__, names), None):
        raise misuse(context, f"{name} {why}.")


def _listed(options: Sequence[str]) -> str:
    *first, last = options
    return f"{', '.join(first)} or {last}" if first else last
