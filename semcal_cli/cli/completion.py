"""`semcal completion`: completion of commands in a shell."""

from __future__ import annotations

import click

PROGRAM, VARIABLE = "semcal", "_SEMCAL_COMPLETE"


HELP = """Print a script that completes commands, options and files in a shell. To install it:

    \b
    bash:  semcal completion bash >> ~/.bashrc
    zsh:   semcal completion zsh >> ~/.zshrc
    fish:  semcal completion fish > ~/.config/fish/completions/semcal.fish
"""


@click.command(help=HELP)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the completion script of a shell."""
    from click.shell_completion import get_completion_class

    completer = get_completion_class(shell)
    assert completer is not None
    root = click.get_current_context().find_root().command
    click.echo(completer(root, {}, PROGRAM, VARIABLE).source())
