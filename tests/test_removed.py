"""The error about a command, an option or a value that was removed says what to use instead."""

from pathlib import Path

import click
import pytest
from conftest import Cli

from semcal_cli.cli import semcal
from semcal_cli.cli.removed import REMOVED

EXIT_USAGE = 2


@pytest.mark.parametrize(("command", "name"), REMOVED)
def test_the_error_says_what_to_use_instead(command: str, name: str, cli: Cli) -> None:
    words = name.split() if command == "semcal" else [*command.split(), *name.split()]
    if not name.startswith("-"):
        words.append("--help")  # a command that exists after all does nothing
    code, out, err = cli(*words)
    assert (code, out) == (EXIT_USAGE, "")
    assert err.splitlines()[0] == f"semcal: error: {name} was removed: {REMOVED[command, name]}."


@pytest.mark.parametrize(("command", "name"), REMOVED)
def test_nothing_that_exists_is_said_to_be_removed(command: str, name: str) -> None:
    context, owner = click.Context(semcal), semcal
    for word in [] if command == "semcal" else command.split():
        owner = owner.get_command(context, word)
        assert owner is not None
    option, _, value = name.partition(" ")
    found = next((each for each in owner.params if option in each.opts), None)
    if found is None:
        assert not isinstance(owner, click.Group) or name not in owner.list_commands(context)
    else:
        assert isinstance(found.type, click.Choice)
        assert value
        assert value not in found.type.choices


def test_the_options_of_many_drives_are_explained(cli: Cli, tmp_path: Path) -> None:
    code, _, err = cli("batch", "d", "-o", tmp_path / "r", "--", "--method", "soic")
    assert code == EXIT_USAGE
    assert (
        err.splitlines()[0]
        == f"semcal: error: --method soic was removed: {REMOVED['calibrate', '--method soic']}."
    )


@pytest.mark.parametrize(
    "line", ["no-command", "convert --no-option", "calibrate d --method other", "calibrate d extra"]
)
def test_other_errors_stay_as_click_has_them(line: str, cli: Cli) -> None:
    code, _, err = cli(*line.split())
    assert code == EXIT_USAGE
    assert "was removed" not in err
