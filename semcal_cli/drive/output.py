"""The file of a drive that is to be written."""

from pathlib import Path

from semcal_cli.drive.document import DRIVE_FILE

SUFFIXES = (".yaml", ".yml")
"""Suffixes of a drive's file; any other name is that of its folder."""


def output_drive_file(output: Path) -> Path:
    """Locate the file of a drive that is to be written, given by its folder or by the file; neither need exist."""
    return output if output.suffix in SUFFIXES else output / DRIVE_FILE
