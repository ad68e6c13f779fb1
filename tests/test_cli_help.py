"""The help of every command, what it loads, and the completion of what is typed."""

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from conftest import Cli

from semcal_cli.cli import SECTIONS, semcal
from semcal_cli.cli.examples import examples_of


def test_help_loads_nothing_heavy(tmp_path: Path) -> None:
    script = (
        "import sys; from semcal_cli.cli import semcal; semcal(['--help'], standalone_mode=False); "
        "heavy = 'torch', 'cv2', 'numpy', 'scipy', 'pydantic', 'rich', 'semcal_cli.cli.calibrate'; "
        "print([name for name in heavy if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], check=True, capture_output=True, text=True, cwd=tmp_path
    )
    assert "calibrate" in done.stdout
    assert done.stdout.splitlines()[-1] == "[]"


def commands(
    group: click.Group, path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    """Every command with its name, those of groups among them."""
    for name, command in group.commands.items():
        if isinstance(command, click.Group):
            yield from commands(command, (*path, name))
        else:
            yield (*path, name), command


def test_every_command_stands_in_one_section_with_a_whole_line(cli: Cli) -> None:
    listed = [name for section in SECTIONS.values() for name in section]
    assert sorted(listed) == sorted(name for name, each in semcal.commands.items() if not each.hidden)
    code, out, _ = cli("--help")
    assert code == 0
    assert max(map(len, out.splitlines())) <= 80
    for name, line in ((name, line) for section in SECTIONS.values() for name, line in section.items()):
        assert re.search(rf"^  {name} +{re.escape(line)}$", out, re.MULTILINE)


@pytest.mark.parametrize(("path", "command"), list(commands(semcal)), ids=lambda value: str(value)[:40])
def test_help_names_only_options_that_the_command_has(path: tuple[str, ...], command: click.Command) -> None:
    """Those of other commands stand in backquotes behind the command's name."""
    known = {option for each in command.params for option in (*each.opts, *each.secondary_opts)}
    texts = [command.help or "", *(getattr(each, "help", None) or "" for each in command.params)]
    for text in texts:
        others = re.sub(r"`(?:semcal )?[a-z]+ [^`]*`", "", text)
        if path == ("batch",):
            others = re.sub(r"-- --\S+.*", "", others)
        assert set(re.findall(r"(?<![\w-])--[a-z][\w-]*", others)) <= known
    with click.Context(command) as context:
        assert "None]" not in command.get_help(context)


@pytest.mark.parametrize(("path", "command"), list(commands(semcal)), ids=lambda value: str(value)[:40])
def test_every_command_has_examples_that_parse(path: tuple[str, ...], command: click.Command) -> None:
    examples = examples_of(" ".join(("semcal", *path)))
    assert examples or path == ("completion",)
    for example in examples:
        words = shlex.split(example)
        assert tuple(words[1 : 1 + len(path)]) == path
        command.make_context(" ".join(("semcal", *path)), words[1 + len(path) :])


def test_the_help_of_calibrate_is_short_and_the_full_help_has_all(cli: Cli) -> None:
    _, short, _ = cli("calibrate", "--help")
    _, full, _ = cli("calibrate", "--help-all")
    assert len(short.splitlines()) < 60
    assert (
        short.index("semcal calibrate recording.mcap")
        < short.index("-o, --output")
        < short.index("--report FILE")
    )
    assert "--mine-steps" not in short
    for parameter in semcal.commands["calibrate"].params:
        assert not isinstance(parameter, click.Option) or parameter.opts[-1] in full


@pytest.mark.parametrize(
    ("words", "completed"), [("semcal cal", "calibrate"), ("semcal convert --formats --int", "--into")]
)
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion(
    shell: str, words: str, completed: str, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, out, _ = cli("completion", shell)
    assert code == 0
    assert f"_SEMCAL_COMPLETE={shell}_complete" in out
    monkeypatch.setenv("_SEMCAL_COMPLETE", f"{shell}_complete")
    *before, last = words.split()
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", last if shell == "fish" else str(len(before)))
    out = cli()[1]
    assert completed in out
    assert "p_camera" not in out  # the table of formats
