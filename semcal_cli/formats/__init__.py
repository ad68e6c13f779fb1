"""Transforms read from and written to files of any known format; an equation states the direction of each format."""

from semcal_cli.formats.conversion import convert as convert, set_in_file as set_in_file
from semcal_cli.formats.format_table import FORMATS as FORMATS, find_format as find_format
from semcal_cli.formats.semcal import Extrinsic as Extrinsic
from semcal_cli.formats.transform_files import (
    REFERENCE_DIRECTION as REFERENCE_DIRECTION,
    WITHOUT_OPTIONS as WITHOUT_OPTIONS,
    read_extrinsic as read_extrinsic,
    read_reference as read_reference,
    read_transform as read_transform,
    write_transform as write_transform,
)
