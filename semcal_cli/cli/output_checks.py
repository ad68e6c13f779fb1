"""Checks before the work begins that output files can be written, and that they replace nothing that is needed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from semcal_cli.drive.document import Drive, drive_file
from semcal_cli.errors import InputError
from semcal_cli.files.input_files import is_folder
from semcal_cli.files.output_files import (
    check_descriptor,
    check_replaceable,
    check_suffix,
    descriptor,
    is_standard_stream,
)

PLOTS: dict[str, Literal["png", "svg"]] = {".png": "png", ".svg": "svg"}
"""Formats of plots by their suffixes."""


def folder_of(output: Path | None) -> Path:
    """Return the folder that paths in a result are relative to: its file's, or the working folder for a stream."""
    return Path() if output is None or descriptor(output) is not None else output.parent


def files_read(drive: Drive, *others: Path | None) -> list[Path]:
    """List the files of a drive, and those of other transforms or drives."""
    files = [drive_file(path) for path in others if path is not None]
    return [drive.path, *map(drive.resolve, drive.files()), *files]


def check_outputs(read: Sequence[Path], *outputs: Path | None) -> None:
    """Check that outputs have a folder, and overwrite neither an input nor one another; None is no output.

    Raises:
        InputError: a folder is missing or cannot be written to, or an output would overwrite a file.
    """
    real_paths = set(map(os.path.realpath, read))
    for path in filter(None, outputs):
        if not is_folder(path.absolute().parent):
            raise InputError(f"{path}: found no folder {path.parent}, expected one to write to")
        if is_folder(path):
            raise InputError(f"{path}: found a folder, expected a file to write to")
        check_descriptor(path)
        if os.path.realpath(path) in real_paths:
            raise InputError(f"{path}: found a file that this run reads or writes; choose another name")
        if descriptor(path) is not None or path.is_char_device():
            continue  # It takes several outputs one after another.
        if is_standard_stream(path):
            raise InputError(f"{path}: found the file that the shell writes to; choose another name")
        if not path.exists() or path.is_file():
            check_replaceable(path)
        real_paths.add(os.path.realpath(path))


def check_vacant(*outputs: Path | None, force: bool) -> None:
    """Check that no file is replaced that the user may want to keep; None is no output.

    Args:
        outputs: Files to write, of kinds that semcal cannot recognise as its own.
        force: Whether they may be replaced.

    Raises:
        InputError: a file is there.
    """
    for path in filter(None, outputs):
        if not force and descriptor(path) is None and path.is_file() and path.stat().st_size:
            raise InputError(f"{path}: found a file; choose another name, or add --force")


def check_image_folder(folder: Path, read: Sequence[Path], suffix: str = ".png") -> None:
    """Check that a folder has a place for images, or files of another suffix, and that these replace nothing read.

    Raises:
        InputError: an image of the folder is such a file.
    """
    if folder.exists() and not is_folder(folder):
        raise InputError(f"{folder}: found a file, expected a folder for images")
    real_paths = set(map(os.path.realpath, read))
    for path in sorted(folder.glob(f"*{suffix}")):
        if os.path.realpath(path) in real_paths:
            raise InputError(f"{path}: found a file that this run reads; choose another folder")
        if is_folder(path):
            raise InputError(f"{path}: found a folder, expected a place for an image")


def check_page(path: Path | None) -> None:
    """Check the suffix of a page, if there is one; a descriptor such as /dev/stdout needs none.

    Raises:
        InputError: the suffix is not .html.
    """
    if path is None or (not path.suffix and descriptor(path) is not None):
        return
    if path.suffix.lower() != ".htm":
        check_suffix(path, ".html")
