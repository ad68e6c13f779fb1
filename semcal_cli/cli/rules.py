"""Which options of a command need others, and which exclude others: a line of a table each, checked when it is parsed.

A rule names options as a user writes them: `--init` is one that is given, `--cue edges` one that has this value or
holds it, given or by default. The rules of a class of settings hold for all commands that have its options: an option
that a command lacks is never given, and no message names it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import click

COMMANDLINE, DEFAULT_MAP = click.core.ParameterSource.COMMANDLINE, click.core.ParameterSource.DEFAULT_MAP


def given_parameters(context: click.Context) -> list[click.Parameter]:
    """List the parameters of a command that stand on the command line."""
    source = context.get_parameter_source
    return [each for each in context.command.params if source(str(each.name)) is COMMANDLINE]


def _has(context: click.Context, term: str) -> bool:
    name = term.partition(" ")[0]
    return any(name in each.opts for each in context.command.params)


def _holds(context: click.Context, term: str) -> bool:
    """Whether an option is given, and names something, or has a value."""
    option, _, value = term.partition(" ")
    name = next((str(each.name) for each in context.command.params if option in each.opts), None)
    if name is None:
        return False
    found = context.params[name]
    if value:
        return value in found if isinstance(found, tuple) else found == value
    return context.get_parameter_source(name) in (COMMANDLINE, DEFAULT_MAP) and found is not None


@dataclass(frozen=True)
class Rule:
    """What holds of any of some options, or of all uses of a command if it is about none."""

    subjects: tuple[str, ...]
    """The options."""
    required: tuple[str, ...] = ()
    """Options of which one has to be there."""
    excluded: tuple[str, ...] = ()
    """Options of which none may be there."""
    where: tuple[str, ...] = ()
    """The rule holds only where one of these is there; always without any."""
    because: str = ""
    """Reason, or what to do instead."""

    def requires(self, *options: str, where: Sequence[str] = (), because: str = "") -> Rule:
        """Say that one of some options has to be there, too."""
        return replace(self, required=options, where=tuple(where), because=because)

    def excludes(self, *options: str, because: str = "") -> Rule:
        """Say that none of some options may be there."""
        return replace(self, excluded=options, because=because)

    def complaint(self, context: click.Context) -> str:
        """Tell how the options of a command break the rule; empty if they do not."""
        holds = partial(_holds, context)
        needed = [option for option in self.required if _has(context, option)]
        is_met = any(map(holds, needed))
        other = next(filter(holds, self.excluded), "")
        where = next(filter(holds, self.where), "")
        reason = f": {self.because}." if self.because else "."
        if not self.subjects:
            if needed:
                return "" if is_met else f"Give {_listed(needed)}."
            return other and f"{other} is not for {context.command.name}{reason}"
        subject = next(filter(holds, self.subjects), "")
        if not subject or (self.where and not where):
            return ""
        if self.required and not is_met:
            place = f" where {where} is given" if where else ""
            return f"{subject} requires {_listed(needed)}{place}{reason}"
        return other and f"{subject} excludes {other}{reason}"


def given(*options: str) -> Rule:
    """Begin a rule about any of these options."""
    return Rule(options)


def one_of(*options: str) -> Rule:
    """Make the rule that at least one of these options is given."""
    return Rule((), options)


def none_of(*options: str, because: str) -> Rule:
    """Make the rule that a command takes none of these options, or values, of those that it shares with others."""
    return Rule((), excluded=options, because=because)


def refuse(context: click.Context, names: Iterable[str], why: str) -> None:
    """Refuse options that what is worked on does not have.

    Args:
        context: The command.
        names: Names of those to refuse.
        why: End of the sentence after the option's name.

    Raises:
        click.UsageError: one is given.
    """
    given = {name for each in given_parameters(context) for name in each.opts}
    if name := next(filter(given.__contains__, names), None):
        raise click.UsageError(f"{name} {why}.", context)


def _listed(options: Sequence[str]) -> str:
    *first, last = options
    return f"{', '.join(first)} or {last}" if first else last
