"""`semcal import`: drives from recordings, data sets, and folders of the user's own files."""

from __future__ import annotations

import inspect
import re
from dataclasses import make_dataclass
from pathlib import Path
from types import FunctionType

import click

from semcal_cli.cli.import_bag import bag
from semcal_cli.cli.import_datasets import (
    OWN_SETTINGS,
    SETTINGS_OF_OPTIONS,
    DatasetSettings,
    dataset_command,
)
from semcal_cli.cli.import_folder import folder
from semcal_cli.importing import DATASETS, PLUGINS

SECTION = r"\n+(Args|Returns|Raises):\n"
"""Begin of what the docstring of a plugin's function says to programmers."""


class Imports(click.Group):
    """semcal's imports, followed by those of plugins."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """List the names of all imports."""
        return [*super().list_commands(ctx), *PLUGINS.names]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Find an import; None if there is none with this name, or if its plugin is broken."""
        if (command := super().get_command(ctx, cmd_name)) is not None:
            return command
        if (read := PLUGINS.get(cmd_name, FunctionType)) is None:
            return None
        about, package = inspect.getdoc(read) or cmd_name, PLUGINS.package(cmd_name)
        about = re.split(SECTION, about)[0]
        summary = f"{about.splitlines()[0]} ({package})"
        declared = [SETTINGS_OF_OPTIONS[name] for name in getattr(read, "request_options", ())]
        settings = make_dataclass(
            "PluginSettings", (), bases=(*declared, DatasetSettings), kw_only=True, frozen=True
        )
        return dataset_command(cmd_name, summary, f"{about}\n\nThe data set comes from {package}.", settings)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the import that is typed, or suggest one."""
        if not ctx.resilient_parsing and self.get_command(ctx, args[0]) is None:
            self._suggest(ctx, args[0])
        return super().resolve_command(ctx, args)

    def _suggest(self, ctx: click.Context, name: str) -> None:
        """Suggest the right import for a path, and for a name that begins as several do; else click suggests one.

        Raises:
            click.UsageError: there is a suggestion.
        """
        from semcal_cli.importing.recognition import recognise

        if (source := recognise(Path(name))) is not None:
            command = source.command(source.drive)
            raise click.UsageError(f"{name} is {source.name}. Type `{command}`.", ctx)
        if name.lower() in NAMES_OF_RECORDINGS:
            raise click.UsageError(
                f"No such command {name!r}. Recordings: `semcal import bag PATH -o DRIVE`.", ctx
            )
        names = [known for known in self.list_commands(ctx) if name.lower() in known]
        if names:
            raise click.UsageError(f"No such command {name!r}. Did you mean one of {', '.join(names)}?", ctx)


NAMES_OF_RECORDINGS = ("ros", "ros1", "ros2", "rosbag", "rosbag2", "mcap", "db3", "foxglove", "recording")
"""Words that somebody may type for `bag`."""


@click.group(name="import", cls=Imports)
def import_() -> None:
    """Make a drive from a recording, a data set, or a folder of your own files.

    Writes a drive.yaml that points to the original files, with intrinsics, class names and ignored ids. The calibration
    of a data set becomes the reference, T_camera_lidar.
    """


for _command in (bag, folder):
    import_.add_command(_command)
for _name, _dataset in DATASETS.items():
    _kind = OWN_SETTINGS.get(_name, DatasetSettings)
    import_.add_command(dataset_command(_name, _dataset.summary, f"Import {_dataset.summary}", _kind))
