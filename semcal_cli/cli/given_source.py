"""A recording or a data set in the place of a drive: its import on the way to a calibration or a verification."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import click

from semcal_cli.cli.output_checks import check_image_folder, check_outputs, check_page, folder_of
from semcal_cli.cli.rules import COMMANDLINE, refuse
from semcal_cli.cli.settings_command import typed_words, without_option
from semcal_cli.cli.tables import labelled, wrapped
from semcal_cli.drive.document import DRIVE_FILE, RIG_FILE
from semcal_cli.errors import (
    ChoiceError,
    InputError,
    OccupiedError,
    describe_extra,
    is_installed,
    shell,
)
from semcal_cli.files.documents import FORMATS, output_format
from semcal_cli.files.output_files import write_bytes
from semcal_cli.importing.recognition import Recognised, recognise

if TYPE_CHECKING:
    from semcal_cli.cli.calibrate_options import CalibrateSettings
    from semcal_cli.cli.options import RecordingSettings
    from semcal_cli.cli.terminal import Terminal

OF_RECORDINGS, OF_DATASETS = ("--points", "--image", "--intrinsics"), ("--sequence", "--camera")
"""Options that choose from a recording, and from a data set."""
ODOMETRY = "kiss_icp"
"""Library that estimates the motion."""


def with_drive(settings: CalibrateSettings, terminal: Terminal) -> CalibrateSettings:
    """Import what is given in the place of a drive into one beside the output; a drive stays as it is.

    The result of an import also gets a report and overlays beside it.

    Raises:
        click.UsageError: an option is for something else than what is given.
        ChoiceError: there are several topics, sequences or cameras.
        InputError: nothing can be calibrated, or the import fails.
    """
    given = settings.drive
    if (source := _source_of(given, settings)) is None:
        return settings
    drive, typed = folder_of(settings.output) / source.drive, settings
    settings = _illustrated(settings)
    _check_outputs(given, drive, typed, settings)
    options = _options(settings, is_recording=source.is_recording)
    path = drive / DRIVE_FILE
    before = path.read_bytes() if path.is_file() else None
    try:
        with _choices_of_import(source, drive, options):
            _import(settings, source, drive, terminal)
        if before is not None and path.read_bytes() != before:
            write_bytes(before, path)
            kept = "found values that this import does not write, of another hand or other options"
            raise OccupiedError(f"{path}: {kept}; `{shell('calibrate', drive)}` takes them")
    except OccupiedError as error:
        command = source.command(drive, *options, "--force")
        raise InputError(f"{error.problem}, expected -o in another folder, or first `{command}`") from None
    terminal.print(labelled("same as", source.command(drive, *options)))
    return replace(settings, drive=drive)


@contextmanager
def temporary_drive(
    given: Path, settings: RecordingSettings, terminal: Terminal, *outputs: Path | None
) -> Iterator[Path]:
    """Import what is given in the place of a drive into a temporary one; a drive stays as it is.

    Args:
        given: The path.
        settings: The choices of the import.
        terminal: Where to print what is left out of it.
        outputs: Files that the command will write, which must not replace what is given.

    Yields:
        The drive.

    Raises:
        click.UsageError: an option is for something else than what is given.
        ChoiceError: there are several topics, sequences or cameras.
        InputError: the import fails.
    """
    if (source := _source_of(given, settings)) is None:
        yield given
        return
    check_outputs([given], *outputs)
    options = _options(settings, is_recording=source.is_recording)
    with TemporaryDirectory(prefix="semcal_") as folder:
        drive = Path(folder) / source.drive
        with _choices_of_import(source, source.drive, options):
            _import(settings, source, drive, terminal, is_temporary=True)
        yield drive


def _source_of(given: Path, settings: RecordingSettings) -> Recognised | None:
    """Recognise what is given in the place of a drive; None for a drive or a rig.

    A file of options may state choices for other inputs than this one.

    Raises:
        click.UsageError: an option is for something else than what is given.
        InputError: it is neither, or makes no drive by itself.
    """
    context = click.get_current_context()
    source = recognise(given)
    if source is None:
        why = f"is for a recording or a data set, but {given} is none"
        refuse(context, (*OF_RECORDINGS, *OF_DATASETS), why, sources=[COMMANDLINE])
        return None
    if not source.is_importable:
        raise InputError(source.advice(given))
    others = OF_DATASETS if source.is_recording else OF_RECORDINGS
    refuse(context, others, f"cannot be used with {source.name}", sources=[COMMANDLINE])
    return replace(source, sequence=settings.sequence or source.sequence)


@contextmanager
def _choices_of_import(source: Recognised, drive: Path, options: list[str]) -> Iterator[None]:
    """Write the imports with each choice that only an import has an option for."""
    try:
        yield
    except ChoiceError as error:
        own = (*OF_RECORDINGS, *OF_DATASETS)
        imports = [words for words in error.choices if words[0] not in own]
        commands = [f"`{source.command(drive, *options, *words)}`" for words in imports]
        if len(imports) < len(error.choices):
            problem = f"{error.problem} (or {', '.join(commands)})" if commands else error.problem
            raise ChoiceError(problem, choices=error.choices) from None
        raise InputError(f"{error.problem}, choose one: {', '.join(commands)}") from None


def _import(
    settings: RecordingSettings,
    source: Recognised,
    drive: Path,
    terminal: Terminal,
    *,
    is_temporary: bool = False,
) -> None:
    """Make the drive of a recording or a data set."""
    from semcal_cli.cli.import_datasets import OWN_SETTINGS, DatasetSettings, import_dataset

    about: dict[str, Any] = {"output": drive, "quiet": terminal.console.quiet}
    read = source.root if is_temporary else None
    if source.is_recording:
        _import_recording(settings, source.root, terminal, about, read)
        return
    about |= {
        "camera": settings.camera,
        "sequences": () if source.sequence is None else (source.sequence,),
    }
    dataset = OWN_SETTINGS.get(source.kind, DatasetSettings)(root=source.root, **about)
    import_dataset(source.kind, dataset, is_last=False, read=read)


def _check_outputs(given: Path, drive: Path, typed: CalibrateSettings, settings: CalibrateSettings) -> None:
    """Check before an import that the outputs can be written, and that those of no given name replace nothing.

    Args:
        given: The recording or the data set.
        drive: Folder of the drive to make.
        typed: Settings as they were typed.
        settings: The same with the names of a report and overlays.

    Raises:
        InputError: an output cannot be written, or a file is in the place of one whose name was not given.
    """
    check_outputs([given], settings.output, settings.log, settings.page)
    if settings.output is not None and settings.output.name in (DRIVE_FILE, RIG_FILE):
        raise InputError(f"{settings.output}: found the name of a drive or a rig; choose another -o")
    outputs, is_first = settings.outputs, settings.output is None or not settings.output.is_file()
    outputs.check_replaced()
    if settings.output is not None and settings.to is None:
        output_format(settings.output)
    check_page(settings.page)
    if settings.images is not None:
        check_image_folder(settings.images, [given])
    for folder in (drive, settings.images):
        if folder is not None and folder.is_symlink() and folder != typed.images:
            raise InputError(f"{folder}: found a link, expected a folder or nothing")
    if not is_first or settings.force:
        return
    page = settings.page if typed.page is None else None
    images = sorted(settings.images.glob("*.png")) if settings.images and typed.images is None else []
    for path in filter(None, [page, *images]):
        if path.exists():
            raise InputError(
                f"{path}: found a file of no calibration here; choose another -o, or add --force"
            )


def typed_for(drive: Path) -> str:
    """Write the command that was typed for a recording or a data set, for the drive that was made of it."""
    context = click.get_current_context()
    words, given = typed_words(context), context.params["drive"]
    for name in (*OF_RECORDINGS, *OF_DATASETS):
        words = without_option(words, name)
    typed = (drive if Path(word) == given else word for word in words)
    return shell(*context.command_path.split()[1:], *typed)


def _illustrated(settings: CalibrateSettings) -> CalibrateSettings:
    """Ask for a report and overlays beside the result, unless it goes to a stream or in another format."""
    output = settings.output
    if output is None or settings.to is not None or output.suffix.lower() not in FORMATS:
        return settings
    page = settings.page or output.with_suffix(".html")
    images = settings.images or output.with_name(f"{output.stem}_overlay")
    return replace(settings, page=page, images=images)


def _options(settings: RecordingSettings, *, is_recording: bool) -> list[str]:
    """List the options of the import of a recording or a data set."""
    chosen = {
        "--points": settings.points,
        "--image": settings.image,
        "--intrinsics": settings.camera_file,
        "--camera": settings.camera,
    }
    options = [str(word) for name, value in chosen.items() if value is not None for word in (name, value)]
    return [*options, "--odometry"] if is_recording and is_installed(ODOMETRY) else options


def _import_recording(
    settings: RecordingSettings,
    path: Path,
    terminal: Terminal,
    about: dict[str, Any],
    read: Path | None,
) -> None:
    """Make the drive of a recording, with the motion by its sweeps where the library for it is installed."""
    from semcal_cli.cli.import_bag import BagSettings, import_recording

    has_odometry = is_installed(ODOMETRY)
    chosen = {"points": settings.points, "image": settings.image, "intrinsics": settings.camera_file}
    bag = BagSettings(paths=(path,), odometry=has_odometry, **chosen | about)
    import_recording(bag, is_last=False, read=read)
    if not has_odometry:
        missing = f"the motion of the LiDAR is not estimated: found no {ODOMETRY}; install {describe_extra('odometry')}"
        terminal.print(*wrapped("note:", missing, indent=6))
