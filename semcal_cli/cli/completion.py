"""`semcal completion`: the completion of commands in a shell."""

from __future__ import annotations

import click

PROGRAM, VARIABLE = "semcal", "_SEMCAL_COMPLETE"


@click.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    r"""Print what completes commands, options and files in SHELL.

    \b
    bash:  semcal completion bash >> ~/.bashrc
    zsh:   semcal completion zsh >> ~/.zshrc
    fish:  semcal completion fish > ~/.config/fish/completions/semcal.fish
    """
    from click.shell_completion import get_completion_class

    found = get_completion_class(shell)
    assert found is not None
    root = click.get_current_context().find_root().command
    click.echo(found(root, {}, PROGRAM, VARIABLE).source())
