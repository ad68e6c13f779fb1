"""The commands of `semcal` in sections, each with a line that is never cut."""

from __future__ import annotations

from importlib import import_module
from keyword import iskeyword

import click

SECTIONS: dict[str, dict[str, str]] = {
    "Start": {
        "demo": "Calibrate a synthetic street from nothing, and look at it.",
        "import": "Make a drive of a recording, a data set or your own files.",
        "label": "Label pictures or sweeps with a network.",
        "inspect": "Show what a drive holds, and what looks wrong with it.",
        "synth": "Write a synthetic drive whose transform is known.",
        "completion": "Print what completes commands in bash, zsh or fish.",
    },
    "Calibrate": {
        "calibrate": "Find the transform from nothing, and how sure it is.",
        "initialize": "Only search all mounting directions.",
        "refine": "Only refine a transform that is known roughly.",
    },
    "Check": {
        "verify": "Check on a drive whether a transform still holds.",
        "compare": "Tell how two transforms differ, beside what is allowed.",
        "report": "Write a page about a transform, to send around.",
        "overlay": "Draw the points on the pictures.",
        "view": "Move the points on the pictures by hand, and save.",
    },
    "Export": {
        "convert": "Write a transform in the format of another tool.",
        "export": "Write a drive for a viewer.",
    },
    "Many drives": {
        "batch": "Calibrate or verify many drives.",
        "fleet": "Put the results of many drives of one rig together.",
    },
    "Research": {
        "experiment": "Measure the figures of the documentation.",
    },
}
"""Line of help of each command that is not hidden, by the headings of the sections. Each has a module of its name."""
HIDDEN = ("evaluate",)


class Sections(click.Group):
    """A group that lists its commands in sections, and imports one when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """List the names of all commands."""
        return [*(name for section in SECTIONS.values() for name in section), *HIDDEN]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command; None if there is none of this name."""
        if cmd_name in self.list_commands(ctx):
            self._load(cmd_name)
        else:  # click looks among all for one that is meant
            self.load_all()
        return self.commands.get(cmd_name)

    def load_all(self) -> None:
        """Import all commands."""
        for name in self.list_commands(click.Context(self)):
            self._load(name)

    def _load(self, command: str) -> None:
        if command not in self.commands:
            name = f"{command}_" if iskeyword(command) else command
            self.add_command(getattr(import_module(f"semcal_cli.cli.{name}"), name))

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the sections."""
        width = max(len(name) for section in SECTIONS.values() for name in section)
        for heading, section in SECTIONS.items():
            with formatter.section(heading):
                formatter.write_dl([(f"{name:<{width}}", line) for name, line in section.items()])
