"""Which options of a command need others, and which exclude others: a line of a table each, checked when it is parsed.

A rule names options as a user writes them: `--init` is one that is given, `--cue edges` one that has this value or
holds it, given or by default. The rules of a class of settings hold for all commands that have its options: an option
that a command lacks is never given, and no message names it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import click

COMMANDLINE, DEFAULT_MAP = click.core.ParameterSource.COMMANDLINE, click.core.ParameterSource.DEFAULT_MAP


class Options:
    """The options of a command, as they are given."""

    def __init__(self, context: click.Context) -> None:
        self.context = context
        self._parameters = {name: each for each in context.command.params for name in each.opts}

    def given(self) -> list[click.Parameter]:
        """List the parameters that stand on the command line."""
        return [
            each
            for each in self.context.command.params
            if self.context.get_parameter_source(str(each.name)) is COMMANDLINE
        ]

    def has(self, term: str) -> bool:
        """Whether the command has the option."""
        return term.partition(" ")[0] in self._parameters

    def holds(self, term: str) -> bool:
        """Whether an option is given, and names something, or has a value."""
        name, _, value = term.partition(" ")
        if name not in self._parameters:
            return False
        parameter = str(self._parameters[name].name)
        found = self.context.params[parameter]
        if value:
            return value in found if isinstance(found, tuple) else found == value
        is_given = self.context.get_parameter_source(parameter) in (COMMANDLINE, DEFAULT_MAP)
        return is_given and found is not None


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

    def complaint(self, options: Options) -> str:
        """Tell how the options break the rule; empty if they do not."""
        needed = list(filter(options.has, self.required))
        is_met = any(map(options.holds, needed))
        other = next(filter(options.holds, self.excluded), "")
        where = next(filter(options.holds, self.where), "")
        reason = f": {self.because}." if self.because else "."
        if not self.subjects:
            if needed:
                return "" if is_met else f"Give {_listed(needed)}."
            return other and f"{other} is not for {options.context.command.name}{reason}"
        subject = next(filter(options.holds, self.subjects), "")
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


def refuse(options: Options, names: Iterable[str], why: str) -> None:
    """Refuse options that what is worked on does not have.

    Args:
        options: The options of the command.
        names: Names of those to refuse.
        why: End of the sentence after the option's name.

    Raises:
        click.UsageError: one is given.
    """
    given = {name for each in options.given() for name in each.opts}
    if name := next(filter(given.__contains__, names), None):
        raise click.UsageError(f"{name} {why}.", options.context)


def _listed(options: Sequence[str]) -> str:
    *first, last = options
    return f"{', '.join(first)} or {last}" if first else last
