"""`semcal import NAME`: drives from data sets, also those of plugins."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from semcal_cli.cli.import_settings import ImportSettings
from semcal_cli.cli.settings import argument, made_of, option
from semcal_cli.cli.settings_command import SettingsCommand
from semcal_cli.errors import ChoiceError, InputError
from semcal_cli.importing import read_dataset

if TYPE_CHECKING:
    from semcal_cli.importing.drive_folder import WrittenDrive


@dataclass(frozen=True, kw_only=True)
class DatasetSettings(ImportSettings):
    """Options of the import of a data set."""

    root: Path = argument()
    sequences: tuple[str, ...] = option(
        "Name of the sequence; needed if there are several. Give the option again for more of the same camera.",
        "--sequence",
        metavar="NAME",
        multiple=True,
        default=(),
    )
    image_labels: Path | None = option("Take the label images from this folder.", metavar="DIR")
    point_labels: Path | None = option("Take the point labels from this folder.", metavar="DIR")


@dataclass(frozen=True, kw_only=True)
class NuscenesSettings(DatasetSettings):
    """Options of the import of nuScenes."""

    version: str | None = option(
        "Folder of the tables, such as v1.0-mini; needed if there are several.", metavar="NAME"
    )


@dataclass(frozen=True, kw_only=True)
class CarlaSettings(DatasetSettings):
    """Options of the import of CARLA."""

    version: str | None = option(
        "Release that wrote the data, such as 0.9.15; at least 0.9.10. Tags changed in 0.9.14.",
        metavar="NAME",
    )


@dataclass(frozen=True, kw_only=True)
class Kitti360Settings(DatasetSettings):
    """Options of the import of KITTI-360."""

    rectified: bool | None = option(
        "Which images of image_00 and image_01 to use. Rectified: data_rect, with P_rect and a reference that is "
        "rotated by R_rect. Raw: data_rgb, with K, D and the reference as in calib_cam_to_velo.txt.  "
        "[default: rectified]",
        "--rectified/--raw",
    )


@dataclass(frozen=True, kw_only=True)
class LidarSettings(DatasetSettings):
    """Options of the import of a data set of several LiDARs."""

    lidar: str | None = option("Name of the LiDAR.", metavar="NAME")


OWN_SETTINGS = {"nuscenes": NuscenesSettings, "carla": CarlaSettings, "kitti-360": Kitti360Settings}
"""Settings of the data sets that have options of their own."""
SETTINGS_OF_OPTIONS: dict[str, type[DatasetSettings]] = {"lidar": LidarSettings, "version": NuscenesSettings}
"""Settings with each option that a plugin's data set may declare."""


def import_dataset(
    name: str, settings: DatasetSettings, *, is_last: bool = True, read: Path | None = None
) -> WrittenDrive:
    """Make a drive from a data set, and print what was written, and which command comes next if this one is the last.

    Of a temporary drive, `read` is the data set that is named in its place.

    Raises:
        ChoiceError: there are several sequences or cameras.
        InputError: a file or an option is wrong.
    """
    from semcal_cli.importing.joined_sequences import join_sequences
    from semcal_cli.importing.recognition import recognise
    from semcal_cli.importing.recording import Request

    sequences: list[str | None] = [*dict.fromkeys(settings.sequences)] or [None]
    try:
        recordings = {
            str(sequence): read_dataset(name, made_of(Request, settings, sequence=sequence))
            for sequence in sequences
        }
    except ChoiceError:
        raise
    except InputError as error:
        source = recognise(settings.root)
        if source is None or (source.kind, source.root) == (name, settings.root):
            raise
        command = source.command(settings.output)
        raise InputError(f"{error}; {settings.root} looks like {source.name}: `{command}`") from None
    by_name = settings.image_labels is not None or settings.point_labels is not None
    recording = join_sequences(recordings, are_labelled_by_name=by_name, by_odometry=settings.odometry)
    return settings.write(recording, is_last=is_last, read=read)


def dataset_command(name: str, summary: str, help: str, kind: type[DatasetSettings]) -> click.Command:
    """Make the command that imports a data set."""

    def read(settings: DatasetSettings) -> None:
        import_dataset(name, settings)

    return SettingsCommand(
        name,
        callback=read,
        settings=kind,
        help=help,
        short_help=summary,
    )
