"""Which options of a command need others, and which exclude others: a line of a table each, checked when it is parsed.

A rule names options as a user writes them: `--init` is one that is given, `--cue edges` one that has this value or
holds it, given or by default. A table may stand beside options that several commands have: an option that a command
lacks is never given, and no message names it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import click

from semcal_cli.cli.options import OutputFile
from semcal_cli.files.writing import descriptor

COMMANDLINE, DEFAULT_MAP = click.core.ParameterSource.COMMANDLINE, click.core.ParameterSource.DEFAULT_MAP


class Options:
    """The options of a command, as they are given."""

    def __init__(self, context: click.Context) -> None:
        self.context = context
        self._parameters = {name: each for each in context.command.params for name in each.opts}

    def given(self) -> list[click.Parameter]:
        """List the parameters that stand on the command line."""
        sources = {
            each: self.context.get_parameter_source(str(each.name)) for each in self._parameters.values()
        }
        return [each for each, source in sources.items() if source is COMMANDLINE]

    def has(self, term: str) -> bool:
        """Whether the command has the option."""
        return term.partition(" ")[0] in self._parameters

    def value(self, name: str) -> Any:
        """Value of an option."""
        return self.context.params[str(self._parameters[name].name)]

    def holds(self, term: str) -> bool:
        """Whether an option is given, and names something, or has a value."""
        name, _, value = term.partition(" ")
        if name not in self._parameters:
            return False
        found = self.value(name)
        if value:
            return value in found if isinstance(found, tuple) else found == value
        source = self.context.get_parameter_source(str(self._parameters[name].name))
        return source in (COMMANDLINE, DEFAULT_MAP) and found is not None


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
        where = next(filter(options.holds, self.where), None)
        if self.where and where is None:
            return ""
        needed = list(filter(options.has, self.required))
        if needed and not self.subjects:
            return "" if any(map(options.holds, needed)) else f"Give {_listed(needed)}."
        if not self.subjects:
            other = next(filter(options.holds, self.excluded), None)
            return (
                "" if other is None else self._sentence(f"{other} is not for {options.context.command.name}")
            )
        for subject in filter(options.holds, self.subjects):
            if self.required and not any(map(options.holds, needed)):
                return self._sentence(f"{subject} requires {_listed(needed)}", where)
            if (other := next(filter(options.holds, self.excluded), None)) is not None:
                return self._sentence(f"{subject} excludes {other}", where)
        return ""

    def _sentence(self, told: str, where: str | None = None) -> str:
        return f"{told}{f' where {where} is given' if where else ''}{f': {self.because}' if self.because else ''}."


def given(*options: str) -> Rule:
    """Begin a rule about any of these options."""
    return Rule(options)


def one_of(*options: str) -> Rule:
    """Make the rule that at least one of these options is given."""
    return Rule((), options)


def none_of(*options: str, because: str) -> Rule:
    """Make the rule that a command takes none of these options, or values, of those that it shares with others."""
    return Rule((), excluded=options, because=because)


class CheckedCommand(click.Command):
    """A command that checks the rules of its options when it is parsed."""

    def __init__(self, *args: Any, rules: Iterable[Rule] = (), **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.rules = tuple(rules)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments, and check that the options go together.

        Raises:
            click.UsageError: they break a rule, or --json and another output both go to standard output.
        """
        rest = super().parse_args(ctx, args)
        if ctx.resilient_parsing:
            return rest
        options = Options(ctx)
        if complaint := next(filter(None, (rule.complaint(options) for rule in self.rules)), None):
            raise click.UsageError(complaint, ctx)
        if ctx.params.get("as_json"):
            _check_stdout_is_free(options)
        return rest


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


def _check_stdout_is_free(options: Options) -> None:
    """Check that no file goes to standard output, where --json prints the result."""
    for parameter in options.given():
        path = options.value(parameter.opts[0])
        # Standard output is None as the file of the result.
        if isinstance(parameter.type, OutputFile) and (path is None or descriptor(path) == 1):
            name = parameter.opts[0]
            raise click.UsageError(
                f"--json, {name}: would both write to standard output: give {name} a file", options.context
            )


def _listed(options: Sequence[str]) -> str:
    *first, last = options
    return f"{', '.join(first)} or {last}" if first else last
