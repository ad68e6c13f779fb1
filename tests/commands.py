"""The real command in this process, for tests of what it prints and returns."""

import re

from click.testing import CliRunner, Result

from semcal_cli.cli import semcal


def invoke(
    *words: object, env: dict[str, str] | None = None, color: bool = False, stdin: str | bytes | None = None
) -> Result:
    """Run `semcal` with these words, such as names of commands, options and paths."""
    return CliRunner().invoke(semcal, [str(word) for word in words], input=stdin, env=env, color=color)


def unwrapped(output: str, indent: int) -> str:
    """Join the lines that go on under their label, which takes so many columns."""
    return re.sub(rf"\n {{{indent}}}(?=\S)", " ", output)
