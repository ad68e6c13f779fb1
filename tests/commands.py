"""The real command in this process, for tests of what it prints and returns."""

from click.testing import CliRunner, Result

from semcal_cli.cli import semcal


def invoke(*words: object, env: dict[str, str] | None = None, color: bool = False) -> Result:
    """Run `semcal` with these words, such as names of commands, options and paths."""
    return CliRunner().invoke(semcal, [str(word) for word in words], env=env, color=color)
