"""Commands whose parameters are the fields of a settings class."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import Field, fields
from inspect import get_annotations
from pathlib import Path
from types import NoneType
from typing import Any, Generic, Literal, TypeVar, get_args, get_origin, get_type_hints

import click

from semcal_cli.cli.examples import examples_of
from semcal_cli.cli.options_file import read_options
from semcal_cli.cli.parameter_types import OUTPUT_FILE, PLAIN_TYPES, FiniteRange, Names
from semcal_cli.cli.rules import DEFAULT_MAP, GIVEN, OPTIONS_FILE, misuse
from semcal_cli.cli.settings import IS_ARGUMENT, KNOWN_TRANSFORMS, LIMITS, PARAMETER, setting_of
from semcal_cli.config.setting import KEY
from semcal_cli.errors import ChoiceError, InputError, MisplacedError, first_of
from semcal_cli.files.output_files import descriptor

Settings = TypeVar("Settings")
WORDS = "semcal.words of "
"""Key of what was typed after the name of a command."""
MAX_RANGE = 20
"""Largest number of characters of a range in the help."""
MAX_COMMANDS = 8
"""Largest number of commands that an error lists."""
OPTIONS, FIRST = "Options", "Most used options"
"""Headings in the help: of options without a section of their own, and of those that stand first."""
HELP_ALL = "--help-all"


class SettingOption(click.Option):
    """An option with a section in the help."""

    section = OPTIONS
    brief = ""
    """Text of the short help of a command with many options; empty for that of the full help."""

    def get_help_extra(self, ctx: click.Context) -> click.types.OptionHelpExtra:
        """Leave out a range that only excludes numbers nobody types."""
        extra = super().get_help_extra(ctx)
        if len(extra.get("range", "")) > MAX_RANGE:
            del extra["range"]
        return extra

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """Append the names of plugins to the help."""
        record = super().get_help_record(ctx)
        if record is not None and self.brief and not ctx.meta.get(HELP_ALL):
            record = record[0], self.brief
        plugins = self.type.plugins if isinstance(self.type, Names) else None
        if record is None or plugins is None or not plugins.names:
            return record
        added = ", ".join(f"{name} ({plugins.package(name)})" for name in plugins.names)
        return record[0], f"{record[1]}  [plugins: {added}]"


def _parameters(settings: type) -> list[click.Parameter]:
    """Make the parameters of a settings class: its own options come before inherited ones, its own arguments after."""
    hints = get_type_hints(settings)
    declared = {declaration.name: declaration for declaration in fields(settings)}
    parameters: list[click.Parameter] = [
        _argument(name, hints[name], declaration)
        for name, declaration in declared.items()
        if IS_ARGUMENT in declaration.metadata.get(PARAMETER, {})
    ]
    for owner in settings.__mro__:
        section = vars(owner).get("section", OPTIONS)
        for name in get_annotations(owner):
            declaration = declared.pop(name, None)
            if declaration is not None and KEY in declaration.metadata:  # inherited from a configuration
                parameters.append(
                    _option(name, hints[name], setting_of(owner, name), declaration.metadata[KEY].section)
                )
            elif declaration is not None and "names" in declaration.metadata.get(PARAMETER, {}):
                parameters.append(_option(name, hints[name], declaration, section))
    return parameters


def _argument(name: str, hint: Any, declared: Field[Any]) -> click.Argument:
    is_several = get_origin(hint) is tuple
    about: dict[str, Any] = {"type": _type_of(get_args(hint)[0] if is_several else _plain(hint), {})}
    if is_several:
        about["nargs"] = -1
    about |= {key: value for key, value in declared.metadata[PARAMETER].items() if key != IS_ARGUMENT}
    if declared.default is not None:
        return click.Argument([name], default=declared.default, **about)
    return click.Argument([name], required=NoneType not in get_args(hint), **about)


def _option(name: str, hint: Any, declared: Field[Any], section: str) -> SettingOption:
    about, kind = dict(declared.metadata[PARAMETER]), _plain(hint)
    brief = about.pop("brief", "")
    names = about.pop("names") or (f"--{name.replace('_', '-')}",)
    usual: dict[str, Any] = {
        "type": _type_of(kind, {limit: about.pop(limit, None) for limit in LIMITS}),
        "show_default": declared.default is not None and kind is not bool,
        "metavar": "N" if kind is int else None,
    }
    if kind is bool:
        usual |= {"type": None, "is_flag": True, "default": declared.default}
    elif declared.default is not None:
        usual["default"] = declared.default
    option = SettingOption([*names, name], **usual | about)
    option.section, option.brief = section, brief
    return option


def _type_of(kind: Any, limits: dict[str, Any]) -> click.ParamType[Any] | None:
    if get_origin(kind) is Literal:
        return click.Choice(get_args(kind))
    if kind is int:
        return click.IntRange(limits["minimum"], limits["maximum"])
    if kind is float:
        low, high = (limits[a] if limits[b] is None else limits[b] for a, b in (LIMITS[::2], LIMITS[1::2]))
        return FiniteRange(
            low, high, min_open=limits["above"] is not None, max_open=limits["below"] is not None
        )
    return PLAIN_TYPES.get(kind)


def _plain(hint: Any) -> Any:
    """Remove None from a type."""
    is_optional = get_origin(hint) is not Literal and NoneType in get_args(hint)
    return get_args(hint)[0] if is_optional else hint


class ExampleCommand(click.Command):
    """A command whose help has its examples before the options."""

    def format_help_text(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the text of the help, and the examples."""
        super().format_help_text(ctx, formatter)
        if examples := examples_of(ctx.command_path):
            with formatter.section("Examples" if len(examples) > 1 else "Example"):
                for example in examples:
                    formatter.write(f"{'':{formatter.current_indent}}{example}\n")


class SettingsCommand(ExampleCommand, Generic[Settings]):
    """A command that receives its settings, once their rules are checked.

    If its settings list the options that are `shown_first`, `--help` shows no others, and `--help-all` shows all.
    """

    def __init__(self, *args: Any, settings: type[Settings], **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.shown_first: tuple[str, ...] = getattr(settings, "shown_first", ())
        self.settings, self.params = settings, [*_parameters(settings), *self.params]
        if self.shown_first:
            self.params.append(_help_all_option())
        self.rules = [rule for owner in reversed(settings.__mro__) for rule in vars(owner).get("rules", ())]

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments, and check the rules about options.

        Raises:
            click.UsageError: the options break a rule, or both --json and another output go to standard output.
        """
        ctx.meta[f"{WORDS}{ctx.command_path}"] = [*args]
        file = self._read_options_file(ctx, args)
        try:
            rest = super().parse_args(ctx, args)
        except click.BadParameter as error:
            name = None if error.param is None else str(error.param.name)
            if file is None or name is None or ctx.get_parameter_source(name) is not DEFAULT_MAP:
                raise
            key = str(error.param and error.param.opts[-1]).removeprefix("--")
            raise InputError(f"{file}: {self.name}.{key}: {error.message}") from None
        if ctx.resilient_parsing:
            return rest
        if complaint := next(filter(None, (rule.complaint(ctx) for rule in self.rules)), None):
            raise misuse(ctx, complaint)
        if ctx.params.get("as_json"):
            _check_stdout_is_free(ctx)
        return rest

    def _read_options_file(self, ctx: click.Context, args: list[str]) -> Path | None:
        """Let what the file of --config states replace the defaults. Returns the file; None without one."""
        if ctx.resilient_parsing or not any(parameter.name == OPTIONS_FILE for parameter in self.params):
            return None
        values, _, _ = self.make_parser(ctx).parse_args(args=[*args])
        if (file := values.get(OPTIONS_FILE)) is None:
            return None
        root = ctx.find_root()

        def takes_file(name: str) -> bool:
            group = root.command
            other = group.get_command(root, name) if isinstance(group, click.Group) else None
            return other is not None and any(parameter.name == OPTIONS_FILE for parameter in other.params)

        ctx.default_map = read_options(Path(file), self, takes_file) | dict(ctx.default_map or {})
        return Path(file)

    def settings_in(self, ctx: click.Context) -> Settings:
        """Make the settings from the parsed parameters."""
        names = [attribute.name for attribute in fields(self.settings)]  # type: ignore[arg-type]
        return self.settings(**{name: ctx.params[name] for name in names if name in ctx.params})

    def invoke(self, ctx: click.Context) -> Any:
        """Call the command with its settings; errors about its input say what to type instead."""
        assert self.callback is not None
        try:
            return ctx.invoke(self.callback, self.settings_in(ctx))
        except MisplacedError as error:
            raise self._with_order(ctx, error) from None
        except ChoiceError as error:
            raise InputError(self._with_commands(ctx, error)) from None
        except InputError:
            if (advice := self._advice(ctx)) is None:
                raise
            raise InputError(advice) from None

    def _with_order(self, ctx: click.Context, error: MisplacedError) -> MisplacedError:
        """State the order of the arguments in an error about a misplaced file."""
        needed = [item for item in self.params if item.required or isinstance(item, click.Argument)]
        if not any(item.name == "drive" for item in needed):
            return error
        words = [ctx.command_path]
        for parameter in needed:
            words += [parameter.opts[0]] if isinstance(parameter, click.Option) else []
            words.append(parameter.make_metavar(ctx))
        return MisplacedError(f"{error}; the order is `{' '.join(words)}`")

    def _with_commands(self, ctx: click.Context, error: ChoiceError) -> str:
        """Write what was typed once with each choice, if the command has their options."""
        known = {name for parameter in self.params for name in parameter.opts}
        choices = [words for words in error.choices if known.issuperset(words[::2])]
        if not choices:
            return str(error)
        typed = [*ctx.command_path.split(), *typed_words(ctx)]
        commands = [f"`{shlex.join([*typed, *words])}`" for words in choices]
        return f"{error.problem}, choose one: {', '.join(first_of(commands, MAX_COMMANDS))}"

    def _advice(self, ctx: click.Context) -> str | None:
        """Describe what to do with a recording, a data set or a folder in place of a drive; None if there is none."""
        from semcal_cli.importing.recognition import recognise

        if getattr(self.settings, "takes_recordings", False):
            return None
        names, several = ("drive", "a", "b"), ctx.params.get("drives") or ()
        for path in map(Path, filter(None, (*map(ctx.params.get, names), *several))):
            source = recognise(path)
            # A folder of drives stands for several.
            if source is not None and not (several and source.num_drives):
                return source.advice(path)
        return None

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options by section: the most used ones first, and those without a section last."""
        sections: dict[str, list[tuple[str, str]]] = {FIRST: []} if self.shown_first else {}
        options = [parameter for parameter in self.get_params(ctx) if isinstance(parameter, click.Option)]
        first = [option for name in self.shown_first for option in options if name in option.opts]
        if self.shown_first and not ctx.meta.get(HELP_ALL):
            options = [option for option in options if {HELP_ALL, "--help"} & {*option.opts}]
        for option in [*first, *(option for option in options if option not in first)]:
            if (record := option.get_help_record(ctx)) is not None:
                section = FIRST if option in first else getattr(option, "section", OPTIONS)
                sections.setdefault(section, []).append(record)
        for title in sorted(sections, key=OPTIONS.__eq__):
            with formatter.section(title):
                formatter.write_dl(sections[title])


def _help_all_option() -> click.Option:
    """Make the option that shows the help of all options."""

    def show(ctx: click.Context, param: click.Parameter, is_asked: bool) -> None:
        if is_asked and not ctx.resilient_parsing:
            ctx.meta[HELP_ALL] = True
            click.echo(ctx.get_help(), color=ctx.color)
            ctx.exit()

    return click.Option(
        [HELP_ALL],
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=show,
        help="Show all options, with those of the paper's method, and exit.",
    )


def typed_words(context: click.Context) -> list[str]:
    """List what was typed after the name of a command."""
    return [*context.meta[f"{WORDS}{context.command_path}"]]


def without_option(words: Sequence[str], name: str) -> list[str]:
    """Leave out an option with a value from what was typed, wherever it stands."""
    kept, left = [], iter(words)
    for word in left:
        if word == name:
            next(left, None)
        elif not word.startswith(f"{name}="):
            kept.append(word)
    return kept


def _check_stdout_is_free(context: click.Context) -> None:
    """Check that no file goes to standard output, to which --json prints the result."""
    for parameter in context.command.params:
        if context.get_parameter_source(str(parameter.name)) not in GIVEN:
            continue
        path, name = context.params[str(parameter.name)], parameter.opts[0]
        # Standard output is None as the file of the result.
        if parameter.type is OUTPUT_FILE and (path is None or descriptor(path) == 1):
            raise click.UsageError(
                f"--json and {name} would both write to standard output; give {name} a file", context
            )


def command(
    settings: type[Settings], group: click.Group | None = None, **about: Any
) -> Callable[[Callable[[Settings], None]], Any]:
    """Turn a function of settings into a command. Its help is the docstring, with `KNOWN_TRANSFORMS` filled in.

    Args:
        settings: Class of the settings.
        group: Group that the command belongs to, if there is one.
        about: Other arguments of `click.command`.
    """

    def made(run: Callable[[Settings], None]) -> Any:
        text = (run.__doc__ or "").replace("{KNOWN_TRANSFORMS}", KNOWN_TRANSFORMS)
        make: Any = click if group is None else group
        return make.command(**{"cls": SettingsCommand, "settings": settings, "help": text, **about})(run)

    return made
